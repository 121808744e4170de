"""The rotational pendulum: a motor too weak to lift its mass in one go (T IV-A)."""

from __future__ import annotations

import math
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


def cost(angle: Any, rate: Any, voltage: Any) -> Any:
    """Reward of a state and an action (T Eq. 16), negative."""
    return -(5.0 * angle * angle + 0.01 * rate * rate + 0.01 * voltage * voltage)


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

    def acceleration(self, angle: Any, rate: Any, voltage: Any, g: float) -> Any:
        """α̈ [rad/s²] (T Eq. 15); floats or arrays."""
        k, r = self.torque_constant, self.resistance
        sine = math.sin(angle) if isinstance(angle, float) else np.sin(angle)
        gravity = self.mass * g * self.length * sine
        return (gravity - self.friction * rate - k * k * rate / r + k * voltage / r) / self.inertia

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | int,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Any, Any]:
        """One sampling time by one step of the fourth-order Runge-Kutta method.

        The reward is that of the state left and the action chosen, noise aside (T Eqs. 3, 16):
        a cost, so negative.
        """
        g = self.gravity(time)
        if state.ndim == 1:  # plain floats are several times faster than arrays of one
            angle, rate = state.tolist()
            voltage = self.actions[int(action)]
            after, turned = self._integrate(angle, rate, voltage + noise, g)
            limited = min(max(turned, -RATE_LIMIT), RATE_LIMIT)
            return np.array((wrap(after), limited)), cost(angle, rate, voltage), False
        voltages = _VOLTAGES[action]
        angles, rates = state[:, 0], state[:, 1]
        after, turned = self._integrate(angles, rates, voltages + noise, g)
        following = np.stack((wrap(after), np.clip(turned, -RATE_LIMIT, RATE_LIMIT)), axis=1)
        return following, cost(angles, rates, voltages), np.zeros(len(state), bool)

    def _integrate(self, angle: Any, rate: Any, voltage: Any, g: float) -> tuple[Any, Any]:
        """Angle and rate one T_s later, neither wrapped nor limited."""
        h = self.dt
        a1, b1 = rate, self.acceleration(angle, rate, voltage, g)
        a2 = rate + h / 2 * b1
        b2 = self.acceleration(angle + h / 2 * a1, a2, voltage, g)
        a3 = rate + h / 2 * b2
        b3 = self.acceleration(angle + h / 2 * a2, a3, voltage, g)
        a4 = rate + h * b3
        b4 = self.acceleration(angle + h * a3, a4, voltage, g)
        return (
            angle + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
            rate + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4),
        )

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
