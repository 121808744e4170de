"""The rotational pendulum: a motor too weak to lift its mass in one go (T IV-A)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Action, Ending, TaskDescription, Variable
from sim_nodes.tasks.base import advance
from sim_nodes.tasks.law import Law
from sim_nodes.tasks.pendulum import dynamics
from sim_nodes.tasks.pendulum.dynamics import RATE_LIMIT, SAMPLING_TIME, VOLTAGES
from sim_nodes.tasks.pendulum.picture import picture
from sim_nodes.tasks.pendulum.pilot import Explore, Perform
from sim_nodes.tasks.shapes import Picture

Array = NDArray[np.float64]

_HANGING_ANGLES = (np.pi - 0.1, np.pi, np.pi + 0.1)
_HANGING_RATES = tuple(np.pi / 3 * k for k in range(-3, 4))
_SPREAD_ANGLES = (-np.pi, -np.pi / 2, 0.0, np.pi / 2)
_SPREAD_RATES = tuple(np.pi * k for k in (-10, -3, -1, 0, 1, 3, 10))

UPRIGHT_ANGLE = np.pi / 12
"""Largest angle that counts as upright [rad] (15 degrees; T gives none)."""
UPRIGHT_TIME = 0.5
"""The end of an episode over which it must be upright [s]."""


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
        math.inf,
        "vehicle time at which g starts to change [s]; inf for never",
        low=0.0,
        endless=True,
    )
    g_change_duration: float = setting(
        0.0, "time over which g changes linearly; 0 for a jump [s]", low=0.0
    )

    description = TaskDescription(
        name="pendulum",
        variables=(
            Variable("shaft.position", "rad", -np.pi, np.pi, periodic=True, label="angle"),
            Variable("shaft.velocity", "rad/s", -RATE_LIMIT, RATE_LIMIT, label="rate"),
        ),
        actions=tuple(
            Action(name, (voltage,))
            for name, voltage in zip(("-3 V", "0 V", "+3 V"), VOLTAGES, strict=True)
        ),
        action_unit="V",
        neutral=1,
        sampling_time=SAMPLING_TIME,
        episode_steps=300,
        gamma=0.98,
        endings=(Ending("time-out"),),
        success="end upright",
    )
    usual_episodes = 80
    reference_points = (301, 301)
    reference_lookahead = 1
    compiled = staticmethod(dynamics.step)

    def gravity(self, time: float) -> float:
        """G at a vehicle time [m/s²]: sudden or gradual change (T 10-1-3)."""
        since = time - self.g_change_start
        if since < 0.0:
            return self.g
        done = 1.0 if since >= self.g_change_duration else since / self.g_change_duration
        return self.g + done * (self.g_after - self.g)

    def parameters(self, time: float) -> Array:
        """(g, J, m, l, b, K, R, T_s) at a vehicle time, shape (8,)."""
        return dynamics.parameters(self.gravity(time))

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
        return advance(dynamics.step, dynamics.steps, state, action, noise, self.parameters(time))

    def initial_states(self) -> Array:
        """Every pair of initial angle and rate (T IV-A, IV-A-3), shape (21 or 28, 2)."""
        hanging = self.initial == "hanging"
        angles = _HANGING_ANGLES if hanging else _SPREAD_ANGLES
        rates = _HANGING_RATES if hanging else _SPREAD_RATES
        return np.array([(dynamics.wrap(angle), rate) for angle in angles for rate in rates])

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """One of the initial states, all as likely."""
        states = self.initial_states()
        return states[rng.integers(len(states))]

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether each episode is upright within 15° for the whole of its last 0.5 s."""
        last = states[-round(UPRIGHT_TIME / SAMPLING_TIME) :, :, 0]
        upright: NDArray[np.bool_] = np.all(np.abs(last) <= UPRIGHT_ANGLE, axis=0)
        return upright

    def pilot(self, mode: str, rng: np.random.Generator) -> Law:
        """The law of a scripted pilot who performs or explores."""
        return Perform(self.g) if mode == "perform" else Explore(self.g, rng)

    def picture(self, state: Array) -> Picture:
        """What a state looks like."""
        return picture(state)
