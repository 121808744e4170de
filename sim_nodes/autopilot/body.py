"""The vehicle itself: its motion, the wind around it, and what it believes of its own state."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_nodes.autopilot import ground
from sim_nodes.autopilot.control import Gains, Target, fly
from sim_nodes.quadrotor.airframe import Airframe, G, Payload
from sim_nodes.quadrotor.body import (
    CABLE,
    LOAD,
    LOAD_VELOCITY,
    POSITION,
    RATES,
    VELOCITY,
)
from sim_nodes.quadrotor.body import release as let_go
from sim_nodes.quadrotor.cable import GONE, SLACK, TAUT
from sim_nodes.quadrotor.control import heading_of

Array = NDArray[np.float64]

STEP = 0.0025
"""Of the motion [s]."""
_MEMORY = 1.5  # time over which the error of the estimate and the gusts forget [s]
_HARD = 2.5  # contact with the ground that breaks things [m/s]


def ned(vector: Array) -> Array:
    """East, north, up as north, east, down, or back."""
    return np.array([vector[1], vector[0], -vector[2]])


class Body:
    """A quadrotor with its load, that of `sim_nodes.quadrotor`, on the ground at zero.

    Parameters
    ----------
    frame : Airframe
    payload : Payload
    rng : numpy.random.Generator
        Draws gusts and errors of the estimate.

    Attributes
    ----------
    craft : ndarray of shape (24,)
        Its whole state, as of `sim_nodes.quadrotor.body`: east, north, up.
    """

    def __init__(self, frame: Airframe, payload: Payload, rng: np.random.Generator) -> None:
        # Motors that are off do not turn; those of `Airframe` never stop.
        self.frame, self.payload, self._rng = frame._replace(rotor_low=0.0), payload, rng
        self.craft = ground.at_rest((0.02 * payload.length, 0.0))
        self.broken, self.landed = False, True
        self.error = np.zeros((2, 3))
        self._gust, self._integral, self._hover = np.zeros(3), np.zeros(3), np.ones(1)
        self._reference = np.zeros((3, 3))
        self._accelerometer = rng.spawn(1)[0]
        self._force = np.array([0.0, 0.0, G])

    # ------------------------------------------------------------ what is so

    @property
    def truth(self) -> Array:
        """Position [m] and velocity [m/s], NED, as they are; shape (2, 3)."""
        return np.array([ned(self.craft[POSITION]), ned(self.craft[VELOCITY])])

    @property
    def position(self) -> Array:
        """Where it believes it is [m], NED from where it was switched on."""
        return ned(self.craft[POSITION]) + self.error[0]

    @property
    def velocity(self) -> Array:
        """How fast it believes it is [m/s], NED."""
        return ned(self.craft[VELOCITY]) + self.error[1]

    @property
    def attitude(self) -> Array:
        """Roll, pitch, yaw [rad], and their rates [rad/s], shape (2, 3)."""
        w, x, y, z = self.craft[6:10].tolist()
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = -math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
        yaw = math.remainder(0.5 * math.pi - heading_of(self.craft), 2.0 * math.pi)
        return np.array([(roll, pitch, yaw), self.craft[RATES] * (1.0, -1.0, -1.0)])

    def felt(self, noise: float, bias: float) -> Array:
        """What its accelerometer measures [m/s²], forward, right, down: acceleration less gravity.

        Parameters
        ----------
        noise : float
            Its standard deviation [m/s²].
        bias : float
            Of the axis ahead [m/s²].
        """
        w, x, y, z = self.craft[6:10].tolist()
        axes = np.array([
            (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)),
            (2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)),
            (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)),
        ])  # fmt: skip
        here: Array = (axes @ self._force) * (1.0, -1.0, -1.0)
        return here + (bias, 0.0, 0.0) + noise * self._accelerometer.standard_normal(3)

    @property
    def push(self) -> float:
        """Thrust of the rotors over the quadrotor's mass [m/s²]."""
        return ground.push(self.craft, self.frame)

    @property
    def attached(self) -> bool:
        """Whether a load hangs on the cable."""
        return bool(self.craft[CABLE] != GONE)

    @property
    def load(self) -> tuple[Array, Array]:
        """Position [m] and velocity [m/s] of the load, NED."""
        return ned(self.craft[LOAD]), ned(self.craft[LOAD_VELOCITY])

    @property
    def height(self) -> float:
        """Over the ground [m]."""
        return float(self.craft[2])

    # ------------------------------------------------------------ what it does

    def release(self) -> None:
        """Let the load go."""
        let_go(self.craft)

    def hang(self) -> None:
        """Hang a new load on the cable, at rest below the vehicle: as a ground crew would."""
        if not self.attached:
            below = self.height - self.payload.length
            self.craft[LOAD], self.craft[CABLE] = self.craft[POSITION], TAUT if below > 0 else SLACK
            self.craft[LOAD][2] = max(0.0, below)
            self.craft[LOAD_VELOCITY] = self.craft[VELOCITY]

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
        air, before = wind[:3] + self._gust, self.craft[VELOCITY].copy()
        impact = fly(
            self.craft, self._reference, self._integral, self._hover, target.use, target.values,
            target.yaw, target.yaw_rate, self.error, ned(air), flying, level, gains, self.frame,
            self.payload, STEP, round(dt / STEP),
        )  # fmt: skip
        self._force = (self.craft[VELOCITY] - before) / dt + (0.0, 0.0, G)
        self.broken = self.broken or impact > _HARD
        self.landed = self.height <= 0.0

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
