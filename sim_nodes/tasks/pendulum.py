"""The rotational pendulum: a motor too weak to lift its mass in one go (T IV-A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.settings import Settings, setting

Array = NDArray[np.float64]

RATE_LIMIT = 15 * np.pi
"""Angular rate at which the pendulum saturates [rad/s]."""

_HANGING_ANGLES = (np.pi - 0.1, np.pi, np.pi + 0.1)
_HANGING_RATES = tuple(np.pi / 3 * k for k in range(-3, 4))
_SPREAD_ANGLES = (-np.pi, -np.pi / 2, 0.0, np.pi / 2)
_SPREAD_RATES = tuple(np.pi * k for k in (-10, -3, -1, 0, 1, 3, 10))

UPRIGHT_ANGLE = np.pi / 12
"""Largest angle that counts as upright [rad] (15 degrees; T gives none)."""
UPRIGHT_TIME = 0.5
"""The end of an episode over which it must be upright [s]."""


def wrap(angle: Any) -> Any:
    """Angle in [-π, π) [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class Pendulum(Settings):
    """Parameters and equations of the rotational pendulum.

    State [α, α̇]: angle [rad], zero upright and wrapped to [-π, π); rate [rad/s], saturated
    at ±15π. Actions: -3, 0, +3 V on the motor.

    References
    ----------
    T IV-A, Eqs. 15 and 16; 10-1-3 for g as a function of time.
    """

    initial: str = setting(
        "hanging",
        "initial conditions: hanging down, or distributed (T IV-A)",
        choices=("hanging", "distributed"),
    )
    g: float = setting(9.81, "gravitational acceleration [m/s^2]", low=0.0, high=1000.0)
    g_after: float = setting(
        9.81, "gravitational acceleration after the change [m/s^2]", low=0.0, high=1000.0
    )
    g_change_start: float = setting(300.0, "vehicle time at which g starts to change [s]", low=0.0)
    g_change_duration: float = setting(
        0.0, "time over which g changes linearly; 0 for a jump [s]", low=0.0
    )

    name = "pendulum"
    joints = ("shaft",)
    actions = (-3.0, 0.0, 3.0)
    action_unit = "V"
    neutral = 1
    dt = 0.005
    episode_steps = 300
    gamma = 0.98
    low = (-np.pi, -RATE_LIMIT)
    high = (np.pi, RATE_LIMIT)
    periodic = (True, False)

    inertia = 1.91e-4  # J [kg m^2]
    mass = 0.055  # m [kg]
    length = 0.042  # l [m]
    friction = 3e-6  # b [N m s/rad]
    torque_constant = 0.0536  # K [N m/A]
    resistance = 9.5  # R [Ω]

    def gravity(self, time: float) -> float:
        """G at a vehicle time [m/s²]: sudden or gradual change (T 10-1-3)."""
        since = time - self.g_change_start
        if since < 0.0:
            return self.g
        done = 1.0 if since >= self.g_change_duration else since / self.g_change_duration
        return self.g + done * (self.g_after - self.g)

    def acceleration(self, angle: Array, rate: Array, voltage: Array, g: float) -> Array:
        """α̈ [rad/s²] (T Eq. 15)."""
        k, r = self.torque_constant, self.resistance
        gravity = self.mass * g * self.length * np.sin(angle)
        return (gravity - self.friction * rate - k * k * rate / r + k * voltage / r) / self.inertia

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | np.int64,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """One sampling time by one step of the fourth-order Runge-Kutta method.

        The reward is that of the state left and the action chosen, noise aside (T Eqs. 3, 16):
        a cost, so negative.
        """
        voltage = _VOLTAGES[action]
        angle, rate = state[..., 0], state[..., 1]
        reward = -(5.0 * angle * angle + 0.01 * rate * rate + 0.01 * voltage * voltage)
        g, h, applied = self.gravity(time), self.dt, voltage + noise

        def slope(angle: Array, rate: Array) -> tuple[Array, Array]:
            return rate, self.acceleration(angle, rate, applied, g)

        a1, b1 = slope(angle, rate)
        a2, b2 = slope(angle + h / 2 * a1, rate + h / 2 * b1)
        a3, b3 = slope(angle + h / 2 * a2, rate + h / 2 * b2)
        a4, b4 = slope(angle + h * a3, rate + h * b3)
        following = np.empty(state.shape)
        following[..., 0] = wrap(angle + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4))
        rate = rate + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        following[..., 1] = np.minimum(np.maximum(rate, -RATE_LIMIT), RATE_LIMIT)
        return following, reward, np.zeros(state.shape[:-1], bool)

    def initial_states(self) -> Array:
        """Every pair of initial angle and rate (T IV-A, IV-A-3), shape (21 or 28, 2)."""
        hanging = self.initial == "hanging"
        angles = _HANGING_ANGLES if hanging else _SPREAD_ANGLES
        rates = _HANGING_RATES if hanging else _SPREAD_RATES
        return np.array([(wrap(angle), rate) for angle in angles for rate in rates])

    def succeeded(self, states: Array) -> NDArray[np.bool_]:
        """Whether each episode is upright within 15° for the whole of its last 0.5 s."""
        last = states[-round(UPRIGHT_TIME / self.dt) :, :, 0]
        upright: NDArray[np.bool_] = np.all(np.abs(last) <= UPRIGHT_ANGLE, axis=0)
        return upright


_VOLTAGES = np.array(Pendulum.actions)
