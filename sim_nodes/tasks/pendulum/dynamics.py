"""Equations of the rotational pendulum (T IV-A): pure, and compiled."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit

Array = NDArray[np.float64]

RATE_LIMIT = 15 * np.pi
"""Angular rate at which the pendulum saturates [rad/s]."""
VOLTAGES = (-3.0, 0.0, 3.0)
"""Of the motor, by action [V]."""
SAMPLING_TIME = 0.005
"""T_s [s]."""
INERTIA = 1.91e-4  # J [kg m^2]
MASS = 0.055  # m [kg]
LENGTH = 0.042  # l [m]
FRICTION = 3e-6  # b [N m s/rad]
TORQUE_CONSTANT = 0.0536  # K [N m/A]
RESISTANCE = 9.5  # R [Ω]


def wrap(angle: Any) -> Any:
    """Angle in [-π, π) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


@cached_njit()
def _acceleration(angle: float, rate: float, voltage: float, p: Array) -> float:
    """α̈ [rad/s²] (T Eq. 15)."""
    g, J, m, l, b, K, R, _ = p  # noqa: E741
    gravity = m * g * l * math.sin(angle)
    return (gravity - b * rate - K * K * rate / R + K * voltage / R) / J


@cached_njit()
def step(
    state: Array, action: int, noise: float, parameters: Array, next_state: Array
) -> tuple[float, bool]:
    """One T_s by one step of the fourth-order Runge-Kutta method; reward of T Eq. 16, negative."""
    angle, rate, h = state[0], state[1], parameters[7]
    chosen = VOLTAGES[action]
    voltage = chosen + noise
    a1, b1 = rate, _acceleration(angle, rate, voltage, parameters)
    a2 = rate + h / 2 * b1
    b2 = _acceleration(angle + h / 2 * a1, a2, voltage, parameters)
    a3 = rate + h / 2 * b2
    b3 = _acceleration(angle + h / 2 * a2, a3, voltage, parameters)
    a4 = rate + h * b3
    b4 = _acceleration(angle + h * a3, a4, voltage, parameters)
    after = angle + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    turned = rate + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    next_state[0] = (after + math.pi) % (2 * math.pi) - math.pi
    next_state[1] = min(max(turned, -RATE_LIMIT), RATE_LIMIT)
    return -(5.0 * angle * angle + 0.01 * rate * rate + 0.01 * chosen * chosen), False


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


def parameters(gravity: float) -> Array:
    """(g, J, m, l, b, K, R, T_s) for a gravitational acceleration [m/s²], shape (8,)."""
    constants = (INERTIA, MASS, LENGTH, FRICTION, TORQUE_CONSTANT, RESISTANCE, SAMPLING_TIME)
    return np.array((gravity, *constants))
