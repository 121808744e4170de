"""A quadrotor that drops its slung load into a basket, in two dimensions (T IV-B)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numba import guvectorize, njit
from numpy.typing import NDArray

from iolspi_ros.settings import Settings, setting
from sim_nodes.tasks.base import advance

Array = NDArray[np.float64]

RELEASE = 3
"""Index of the action that lets the load go; the quadrotor does not accelerate with it."""

DUNK, MISS, CABLE, WALL = 100.0, -10.0, -50.0, -150.0
"""Rewards of the four ways in which the task ends (T Eq. 20)."""

_ACCELERATIONS = (-3.0, 0.0, 3.0, 0.0)
_RANGES = {"wide": (-6.0, 0.0), "narrow": (-5.0, -4.0)}  # x [m]: T IV-B; T 11-2
_WIDEST_ANGLE = np.pi / 3
_SWEPT = (13, 11)  # initial positions and angles


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


@njit(cache=True)
def _fall(state: Array, parameters: Array) -> tuple[float, float]:
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


@njit(cache=True)
def _dunks(state: Array, parameters: Array) -> bool:
    """Whether a load released here falls into the basket."""
    goal, margin = parameters[2:4]
    _, landing = _fall(state, parameters)
    return abs(landing - goal) <= margin  # not for NaN


@njit(cache=True)
def _judge(state: Array, following: Array, parameters: Array) -> tuple[float, bool]:
    """Reward and end of a step with the load on its cable (T Eq. 20)."""
    left, right = parameters[5:7]
    if following[0] < left or following[0] > right:
        return WALL, True
    if abs(following[2]) > math.pi / 2:
        return CABLE, True
    return -0.5 * abs(state[0] - parameters[2]), False


@njit(cache=True)
def _step(
    state: Array, action: int, noise: float, parameters: Array, following: Array
) -> tuple[float, bool]:
    """One T_s by Euler's method (T Eqs. 18, 19); reward and end of T Eq. 20."""
    x, speed, angle, rate = state
    g, L = parameters[:2]
    h = parameters[7]
    a = _ACCELERATIONS[action] + noise
    following[0] = x + speed * h
    following[1] = speed + a * h
    following[2] = angle + rate * h
    following[3] = rate - (math.cos(angle) * a + math.sin(angle) * g / L) * h
    if action == RELEASE:
        return (DUNK if _dunks(state, parameters) else MISS), True
    return _judge(state, following, parameters)


@guvectorize(
    ["void(f8[:], i8, f8, f8[:], f8[:], f8[:], b1[:])"], "(d),(),(),(p)->(d),(),()", cache=True
)
def _steps(
    state: Array,
    action: int,
    noise: float,
    parameters: Array,
    following: Array,
    reward: Array,
    terminated: NDArray[np.bool_],
) -> None:
    reward[0], terminated[0] = _step(state, action, noise, parameters, following)


@dataclass(frozen=True)
class SlungLoad(Settings):
    """Parameters and equations of the quadrotor with a slung load.

    State [x, ẋ, θ, θ̇]: position of the quadrotor [m] and its rate [m/s], x to the right;
    angle of the cable [rad], zero hanging down and positive to the right, and its rate
    [rad/s]. Actions: accelerations of the quadrotor -3, 0, +3 m/s², and `RELEASE`.

    T leaves open, and here it is so: the walls; the load's flight, a parabola until the rim's
    plane; a load below the rim at release, a miss; the rewards of a crash, which are those of
    the step that leads into it, a wall before the cable; γ. A release ends the episode whatever
    the quadrotor does in that step.

    References
    ----------
    T IV-B, Eqs. 18 to 20, Table 2; 11-1 and 11-2.
    """

    initial: str = setting(
        "wide",
        "initial positions: -6 to 0 m (T IV-B), or narrow, -5 to -4 m (T 11-2)",
        choices=tuple(_RANGES),
    )

    name = "slung_load"
    joints = ("quadrotor", "load")
    actions = _ACCELERATIONS
    action_unit = "m/s^2"
    action_names = ("-3 m/s²", "0", "+3 m/s²", "release")
    neutral = 1
    dt = 0.1
    episode_steps = 50
    study = 1000
    gamma = 0.98
    # From rest, 26 steps of 0.3 m/s reach the farther wall; no load swings faster than 6.2 rad/s.
    low = (-6.5, -7.8, -np.pi / 2, -6.5)
    high = (3.0, 7.8, np.pi / 2, 6.5)
    periodic = (False, False, False, False)
    axes = ("position [m]", "speed [m/s]", "angle of the cable [rad]", "its rate [rad/s]")
    pictured = (0, 2)
    success = "end with a dunk"
    endings = ("time-out", "dunk", "miss", "crash: cable", "crash: wall")  # by `Outcome`
    reference_points = (39, 53, 61, 53)  # ẋ only takes multiples of 0.3 m/s: 53 points hit them
    reference_lookahead = 4
    compiled = staticmethod(_step)

    g = 9.81  # [m/s^2]
    length = 1.0  # L [m]
    goal = 0.0  # x_goal [m]
    margin = 1.5  # x_gmargin [m]: half the basket's width
    rim = 0.9  # z_goal [m], below the quadrotor
    walls = (-6.5, 3.0)  # x [m]

    def parameters(self, time: float) -> Array:
        """(g, L, x_goal, x_gmargin, z_goal, x of the walls, T_s), shape (8,); always the same."""
        return np.array(self._constants)

    _constants = (g, length, goal, margin, rim, *walls, dt)

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | int,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Any, Any]:
        """One sampling time by Euler's method, all derivatives at the state left (T Eq. 19).

        The distance in the reward is that of the state left (T Eq. 3), as the pendulum's cost;
        crashes are of the state reached, a release is of the state left.
        """
        return advance(_step, _steps, state, action, noise, self.parameters(time))

    def initial_states(self) -> Array:
        """A regular grid over the ranges of T, ends included: 13 x by 11 θ, shape (143, 4)."""
        n_x, n_angle = _SWEPT
        x = np.linspace(*_RANGES[self.initial], n_x)
        angle = np.linspace(-_WIDEST_ANGLE, _WIDEST_ANGLE, n_angle)
        states = np.zeros((n_x * n_angle, 4))
        states[:, 0], states[:, 2] = np.repeat(x, n_angle), np.tile(angle, n_x)
        return states

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """At rest, x and θ uniform over their ranges."""
        x = rng.uniform(*_RANGES[self.initial])
        return np.array((x, 0.0, rng.uniform(-_WIDEST_ANGLE, _WIDEST_ANGLE), 0.0))

    def landing(self, state: Array) -> float | None:
        """Where a load released here crosses the rim's plane, x [m]; None if it hangs below."""
        _, x = _fall(state, self.parameters(0.0))
        return None if math.isnan(x) else float(x)

    def fall(self, state: Array, times: Array) -> Array:
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
        across = x + self.length * sine + (speed + self.length * cosine * rate) * times
        up = -self.length * cosine + self.length * sine * rate * times - self.g / 2 * times**2
        return np.column_stack([across, up])

    def ending(self, reward: Array, terminated: NDArray[np.bool_]) -> NDArray[np.int64]:
        """By the reward, as values of `Outcome`."""
        return outcome(reward, terminated)

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether each episode ended with the load in the basket."""
        dunked: NDArray[np.bool_] = np.any(rewards == DUNK, axis=0)
        return dunked

    def judge(self, state: Array, following: Array) -> tuple[float, bool]:
        """Reward and end of a step that was flown with the load on its cable, not computed.

        Parameters
        ----------
        state, following : ndarray of shape (4,)
            As measured, one sampling time apart.
        """
        reward, terminated = _judge(state, following, self.parameters(0.0))
        return float(reward), bool(terminated)

    def landed(self, landing: float | None) -> float:
        """Reward for a load that crossed the rim's plane at x [m], or (None) never was above it."""
        inside = landing is not None and abs(landing - self.goal) <= self.margin
        return DUNK if inside else MISS
