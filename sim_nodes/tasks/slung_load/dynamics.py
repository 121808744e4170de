"""Equations of the quadrotor with a slung load (T IV-B): pure, and compiled."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.tasks.base import G

Array = NDArray[np.float64]

RELEASE = 3
"""Index of the action that lets the load go; the quadrotor does not accelerate with it."""

DUNK, MISS, CABLE, WALL = 100.0, -10.0, -50.0, -150.0
"""Rewards of the four ways in which the task ends (T Eq. 20)."""

ACCELERATIONS = (-3.0, 0.0, 3.0, 0.0)
"""Of the quadrotor, by action [m/s²]."""
SAMPLING_TIME = 0.1
"""T_s [s]."""
LENGTH = 1.0  # L of the cable [m]
GOAL = 0.0  # x_goal [m]
MARGIN = 1.5  # x_gmargin [m]: half the basket's width
RIM = 0.9  # z_goal [m], below the quadrotor
WALLS = (-6.5, 3.0)  # x [m]
PARAMETERS = (G, LENGTH, GOAL, MARGIN, RIM, *WALLS, SAMPLING_TIME)


class Outcome(IntEnum):
    """How a step, and with it an episode, ended."""

    OPEN = 0
    """It did not; as an episode's last, the clock cut it."""
    DUNK = 1
    """The load fell into the basket."""
    MISS = 2
    """The load fell elsewhere."""
    CABLE = 3
    """The cable came into the rotors."""
    WALL = 4
    """The quadrotor hit a wall."""


_REWARD_OF = {
    Outcome.DUNK: DUNK, Outcome.MISS: MISS, Outcome.CABLE: CABLE, Outcome.WALL: WALL,
}  # fmt: skip


def outcome(reward: Any, terminated: Any) -> NDArray[np.int64]:
    """How steps ended, from what they gave: T Eq. 20 has a reward of its own for each ending.

    Parameters
    ----------
    reward : float or ndarray of shape (...)
    terminated : bool or ndarray of bool, of the same shape

    Returns
    -------
    ndarray of int, of the same shape
        Values of `Outcome`.
    """
    ended = np.zeros(np.shape(reward), np.int64)
    for way, value in _REWARD_OF.items():
        ended[np.equal(reward, value) & terminated] = way
    return ended


@cached_njit()
def fall(state: Array, parameters: Array) -> tuple[float, float]:
    """Time until a load released here crosses the rim's plane from above [s], and x there [m].

    A parabola, z pointing down. Both are NaN when it hangs below the plane already.
    """
    x, speed, angle, rate = state
    g, L, rim = parameters[0], parameters[1], parameters[4]
    sine, cosine = math.sin(angle), math.cos(angle)
    above = rim - L * cosine
    if above < 0.0:
        return math.nan, math.nan
    sinking = -L * sine * rate
    time = (math.sqrt(sinking * sinking + 2.0 * g * above) - sinking) / g  # the later crossing
    return time, x + L * sine + (speed + L * cosine * rate) * time


@cached_njit()
def _dunks(state: Array, parameters: Array) -> bool:
    """Whether a load released here falls into the basket."""
    goal, margin = parameters[2:4]
    _, landing = fall(state, parameters)
    return abs(landing - goal) <= margin  # not for NaN


@cached_njit()
def judge(state: Array, next_state: Array, parameters: Array) -> tuple[float, bool]:
    """Reward and end of a step with the load on its cable (T Eq. 20)."""
    left, right = parameters[5:7]
    if next_state[0] < left or next_state[0] > right:
        return WALL, True
    if abs(next_state[2]) > math.pi / 2:
        return CABLE, True
    return -0.5 * abs(state[0] - parameters[2]), False


@cached_njit()
def step(
    state: Array, action: int, noise: float, parameters: Array, next_state: Array
) -> tuple[float, bool]:
    """One T_s by Euler's method (T Eqs. 18, 19); reward and end of T Eq. 20."""
    x, speed, angle, rate = state
    g, L = parameters[:2]
    h = parameters[7]
    a = ACCELERATIONS[action] + noise
    next_state[0] = x + speed * h
    next_state[1] = speed + a * h
    next_state[2] = angle + rate * h
    next_state[3] = rate - (math.cos(angle) * a + math.sin(angle) * g / L) * h
    if action == RELEASE:
        return (DUNK if _dunks(state, parameters) else MISS), True
    return judge(state, next_state, parameters)


@cached_njit()
def steps(
    states: Array,
    actions: NDArray[np.int64],
    noise: Array,
    parameters: Array,
    next_states: Array,
    rewards: Array,
    terminated: NDArray[np.bool_],
) -> None:
    """`step` of many states, shape (n, n_dims)."""
    for n in range(len(states)):
        rewards[n], terminated[n] = step(
            states[n], actions[n], noise[n], parameters, next_states[n]
        )


def landing(state: Array) -> float | None:
    """Where a load released here crosses the rim's plane, x [m]; None if it hangs below."""
    _, x = fall(state, np.array(PARAMETERS))
    return None if math.isnan(x) else float(x)


def falling(state: Array, times: Array) -> Array:
    """Positions of a load released here: x to the right, z upwards from the quadrotor [m].

    Parameters
    ----------
    state : ndarray of shape (4,)
    times : ndarray of shape (n,)
        Since the release [s].

    Returns
    -------
    ndarray of shape (n, 2)
    """
    x, speed, angle, rate = state.tolist()
    sine, cosine = math.sin(angle), math.cos(angle)
    across = x + LENGTH * sine + (speed + LENGTH * cosine * rate) * times
    up = -LENGTH * cosine + LENGTH * sine * rate * times - G / 2 * times**2
    return np.column_stack([across, up])
