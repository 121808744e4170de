"""Equations of the pole on a cart (T Eq. 8-1): pure, and compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.tasks.base import G

Array = NDArray[np.float64]

FALLEN = math.pi / 2
"""Angle beyond which the pole has fallen [rad]."""
FORCE_NOISE = 10.0
"""Half-width of the uniform noise on every force [N]; `step` takes it as its noise."""
FORCES = (-50.0, 0.0, 50.0)
"""On the cart, by action [N]."""
SAMPLING_TIME = 0.1
"""T_s [s]."""
MASS = 2.0  # m of the pole [kg]
CART = 8.0  # M [kg]
LENGTH = 0.5  # l [m]
PARAMETERS = (G, MASS, LENGTH, 1.0 / (MASS + CART), SAMPLING_TIME)


@cached_njit()
def _acceleration(angle: float, rate: float, force: float, p: Array) -> float:
    """α̈ [rad/s²] (T Eq. 8-1)."""
    g, m, l, kappa, _ = p  # noqa: E741
    sine, cosine = math.sin(angle), math.cos(angle)
    turning = kappa * m * l * rate * rate * sine * cosine  # sin(2α) / 2
    return (g * sine - turning - kappa * cosine * force) / (
        4.0 * l / 3.0 - kappa * m * l * cosine * cosine
    )


@cached_njit()
def step(
    state: Array, action: int, noise: float, parameters: Array, next_state: Array
) -> tuple[float, bool]:
    """One T_s by one step of the fourth-order Runge-Kutta method; -1 for falling."""
    angle, rate, h = state[0], state[1], parameters[4]
    force = FORCES[action] + noise
    a1, b1 = rate, _acceleration(angle, rate, force, parameters)
    a2 = rate + h / 2 * b1
    b2 = _acceleration(angle + h / 2 * a1, a2, force, parameters)
    a3 = rate + h / 2 * b2
    b3 = _acceleration(angle + h / 2 * a2, a3, force, parameters)
    a4 = rate + h * b3
    b4 = _acceleration(angle + h * a3, a4, force, parameters)
    next_state[0] = angle + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    next_state[1] = rate + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    fell = abs(next_state[0]) > FALLEN
    return (-1.0 if fell else 0.0), fell


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
