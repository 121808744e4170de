"""The rotational pendulum: a motor too weak to lift its mass in one go (T IV-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import guvectorize, njit
from numpy.typing import NDArray

from iolspi_ros.settings import Settings, setting
from sim_nodes.tasks.base import advance

Array = NDArray[np.float64]

RATE_LIMIT = 15 * np.pi
"""Angular rate at which the pendulum saturates [rad/s]."""
_VOLTAGES = (-3.0, 0.0, 3.0)

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


@njit(cache=True)
def _acceleration(angle: float, rate: float, voltage: float, p: Array) -> float:
    """α̈ [rad/s²] (T Eq. 15)."""
    g, J, m, l, b, K, R, _ = p  # noqa: E741
    gravity = m * g * l * math.sin(angle)
    return (gravity - b * rate - K * K * rate / R + K * voltage / R) / J


@njit(cache=True)
def _step(
    state: Array, action: int, noise: float, parameters: Array, following: Array
) -> tuple[float, bool]:
    """One T_s by one step of the fourth-order Runge-Kutta method; reward of T Eq. 16, negative."""
    angle, rate, h = state[0], state[1], parameters[7]
    chosen = _VOLTAGES[action]
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
    following[0] = (after + math.pi) % (2 * math.pi) - math.pi
    following[1] = min(max(turned, -RATE_LIMIT), RATE_LIMIT)
    return -(5.0 * angle * angle + 0.01 * rate * rate + 0.01 * chosen * chosen), False


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
    g_change_start: float = setting(
        math.inf, "vehicle time at which g starts to change [s]; inf for never", low=0.0
    )
    g_change_duration: float = setting(
        0.0, "time over which g changes linearly; 0 for a jump [s]", low=0.0
    )

    name = "pendulum"
    joints = ("shaft",)
    actions = _VOLTAGES
    action_unit = "V"
    action_names = ("-3 V", "0 V", "+3 V")
    neutral = 1
    dt = 0.005
    episode_steps = 300
    study = 80
    gamma = 0.98
    low = (-np.pi, -RATE_LIMIT)
    high = (np.pi, RATE_LIMIT)
    periodic = (True, False)
    axes = ("angle [rad]", "rate [rad/s]")
    pictured = (0, 1)
    success = "end upright"
    endings = ("time-out",)
    reference_points = (301, 301)
    reference_lookahead = 1
    compiled = staticmethod(_step)

    inertia = 1.91e-4  # J [kg m^2]
    mass = 0.055  # m [kg]
    length = 0.042  # l [m]
    friction = 3e-6  # b [N m s/rad]
    torque_constant = 0.0536  # K [N m/A]
    resistance = 9.5  # R [Ω]
    _constants = (inertia, mass, length, friction, torque_constant, resistance, dt)

    def gravity(self, time: float) -> float:
        """G at a vehicle time [m/s²]: sudden or gradual change (T 10-1-3)."""
        since = time - self.g_change_start
        if since < 0.0:
            return self.g
        done = 1.0 if since >= self.g_change_duration else since / self.g_change_duration
        return self.g + done * (self.g_after - self.g)

    def parameters(self, time: float) -> Array:
        """(g, J, m, l, b, K, R, T_s) at a vehicle time, shape (8,)."""
        return np.array((self.gravity(time), *self._constants))

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
        return advance(_step, _steps, state, action, noise, self.parameters(time))

    def initial_states(self) -> Array:
        """Every pair of initial angle and rate (T IV-A, IV-A-3), shape (21 or 28, 2)."""
        hanging = self.initial == "hanging"
        angles = _HANGING_ANGLES if hanging else _SPREAD_ANGLES
        rates = _HANGING_RATES if hanging else _SPREAD_RATES
        return np.array([(wrap(angle), rate) for angle in angles for rate in rates])

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """One of the initial states, all as likely."""
        states = self.initial_states()
        return states[rng.integers(len(states))]

    def ending(self, reward: Array, terminated: NDArray[np.bool_]) -> NDArray[np.int64]:
        """All by the clock: nothing else ends this task."""
        return np.zeros(np.shape(reward), np.int64)

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether each episode is upright within 15° for the whole of its last 0.5 s."""
        last = states[-round(UPRIGHT_TIME / self.dt) :, :, 0]
        upright: NDArray[np.bool_] = np.all(np.abs(last) <= UPRIGHT_ANGLE, axis=0)
        return upright
