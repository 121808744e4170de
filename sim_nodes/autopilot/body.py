"""The vehicle itself: its motion, the wind around it, and what it believes of its own state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_nodes.autopilot import dynamics
from sim_nodes.autopilot.control import Gains, Target, fly
from sim_nodes.autopilot.dynamics import LOAD, LOAD_VELOCITY, POSITION, VELOCITY, Airframe

Array = NDArray[np.float64]

STEP = 0.0025
"""Of the motion [s]."""
_MEMORY = 1.5  # time over which the error of the estimate and the gusts forget [s]
_HARD = 2.5  # contact with the ground that breaks things [m/s]


class Body:
    """A quadrotor with its load.

    Parameters
    ----------
    frame : Airframe
    rng : numpy.random.Generator
        Draws gusts and errors of the estimate.
    """

    def __init__(self, frame: Airframe, rng: np.random.Generator) -> None:
        self.frame, self._rng = frame, rng
        self.state = dynamics.at_rest((0.0, 0.02 * frame.length, 0.0))
        self.attached, self.broken, self.landed = True, False, True
        self.error = np.zeros((2, 3))
        self._gust, self._integral, self._hover = np.zeros(3), np.zeros(3), np.ones(1)
        self._reference = np.zeros((3, 3))

    # ------------------------------------------------------------ what is so

    @property
    def position(self) -> Array:
        """Where it believes it is [m], NED from where it was switched on."""
        return self.state[POSITION] + self.error[0]

    @property
    def velocity(self) -> Array:
        """How fast it believes it is [m/s], NED."""
        return self.state[VELOCITY] + self.error[1]

    @property
    def attitude(self) -> Array:
        """Roll, pitch, yaw [rad], and their rates [rad/s], shape (2, 3)."""
        return self.state[6:12].reshape(2, 3)

    @property
    def load(self) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the load, NED."""
        return self.state[LOAD], self.state[LOAD_VELOCITY]

    @property
    def height(self) -> float:
        """Over the ground [m]."""
        return -float(self.state[2])

    # ------------------------------------------------------------ what it does

    def release(self) -> None:
        """Let the load go."""
        self.attached = False

    def hang(self) -> None:
        """Hang a new load on the cable, at rest below the vehicle: as a ground crew would."""
        if not self.attached:
            self.attached = True
            self.state[LOAD] = self.state[POSITION]
            self.state[LOAD][2] = min(0.0, self.state[2] + self.frame.length)
            self.state[LOAD_VELOCITY] = self.state[VELOCITY]

    def begin(self, stop: bool = False) -> None:
        """Steer from where it is now on: another way of steering begins.

        Parameters
        ----------
        stop : bool
            Ask for no speed to begin with, whatever the vehicle has.
        """
        self._reference[0], self._reference[1] = self.position, self.velocity
        if stop:
            self._reference[1:] = 0.0

    def move(
        self, target: Target, gains: Gains, motors: bool, level: bool, wind: Array, dt: float
    ) -> None:
        """Steer towards a target for a while.

        Parameters
        ----------
        target, gains
            Where to, and how.
        motors : bool
            Whether they turn.
        level : bool
            Without a position to hold.
        wind : ndarray of shape (4,)
            Velocity of the air [m/s], NED; standard deviation of gusts [m/s].
        dt : float
            [s], some `STEP`.
        """
        if wind[3] > 0.0:
            self._gust = self._forget(self._gust, wind[3], dt)
        flying = motors and not self.broken
        if not flying:
            self._reference[:], self._integral[:] = 0.0, 0.0
            self._reference[0] = self.position
            self._hover[0] = 1.0
        air = wind[:3] + self._gust
        impact = fly(
            self.state, self._reference, self._integral, self._hover, target.use, target.values,
            target.yaw, target.yaw_rate, self.error, air, flying, level, self.attached, gains,
            self.frame, STEP, round(dt / STEP),
        )  # fmt: skip
        self.broken = self.broken or impact > _HARD
        self.landed = self.state[2] >= 0.0

    def believe(self, deviation: Array, drift: Array, dt: float) -> None:
        """Let the estimate err.

        Parameters
        ----------
        deviation : ndarray of shape (2, 3)
            Standard deviations of position [m] and velocity [m/s].
        drift : ndarray of shape (3,)
            Speed with which it runs away [m/s], where it is lost.
        dt : float
            [s]
        """
        if drift.any():
            self.error[0] += drift * dt
            self.error[1] = drift
        elif deviation.any():
            self.error = self._forget(self.error, deviation, dt)
        elif self.error.any():
            self.error = np.zeros((2, 3))

    def _forget(self, value: Any, deviation: Any, dt: float) -> Any:
        """One step of a random process that forgets (Ornstein and Uhlenbeck)."""
        keep = math.exp(-dt / _MEMORY)
        fresh = self._rng.standard_normal(value.shape)
        return keep * value + deviation * math.sqrt(1.0 - keep * keep) * fresh
