"""Where the load is: heard of from a second system, or told from the quadrotor's acceleration."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import G

Array = NDArray[np.float64]

_STEP = 0.02  # longest step of the integration [s]
_UPWARDS = np.array([0.0, 0.0, G])


class LoadObserver:
    """Where the cable points to, by an extended Kalman filter on the spherical pendulum.

    It is carried along by the quadrotor's changes of velocity, which telemetry measures, and
    pulled to the direction that a feed measures. Without a feed it is the swing that a load would
    have which hung still at `still`; a slight damping lets what was not known of it fade. In one
    plane it is T Eq. 18. Both ways in which the cable can turn are as uncertain as each other, so
    one covariance, of an angle and its rate, stands for both.

    Parameters
    ----------
    cable : float
        Its length [m].
    feed_noise : float
        Standard deviation of a measured angle [rad].
    gust : float
        Standard deviation of accelerations that nobody measures, per sqrt(Hz) [m/s²].
    damping : float
        [1/s].

    Attributes
    ----------
    direction, rate : ndarray of shape (3,)
        Unit vector from the quadrotor to the load, and its rate [1/s].

    References
    ----------
    T IV-B, Eq. 18.
    """

    def __init__(
        self,
        cable: float,
        feed_noise: float = 0.02,
        gust: float = 0.3,
        damping: float = 0.05,
    ) -> None:
        self._cable, self._noise, self._damping = cable, feed_noise**2, damping
        self._gust = (gust / cable) ** 2
        self.still()

    def still(self) -> None:
        """The load hangs still, as far as we know."""
        self.direction, self.rate = np.array([0.0, 0.0, -1.0]), np.zeros(3)
        self._covariance = np.diag([0.05**2, 0.1**2])

    def move(self, acceleration: Array, dt: float) -> None:
        """Let time pass while the quadrotor accelerates [m/s²], shape (3,), for some time [s]."""
        n = max(1, math.ceil(dt / _STEP))
        for _ in range(n):
            self._advance(acceleration, dt / n)

    def _advance(self, acceleration: Array, h: float) -> None:
        """A step: u'' = -|u'|² u - (b - (b · u) u) / L - c u', with b = a + g upwards.

        What goes along u is left to `_turn`, which keeps its length.
        """
        u, pull = self.direction, acceleration + _UPWARDS
        stiffness = float(pull @ u) / self._cable
        jacobian = np.array([[1.0, h], [stiffness * h, 1.0 - self._damping * h]])
        self.rate = self.rate - h * (pull / self._cable + self._damping * self.rate)
        self._turn(h)
        self._covariance = jacobian @ self._covariance @ jacobian.T
        self._covariance[1, 1] += self._gust * h

    def _turn(self, h: float) -> None:
        """Turn by the rate for a time [s]: along a great circle, so it stays a unit vector."""
        u = self.direction
        self.rate = self.rate - float(self.rate @ u) * u
        speed = float(np.linalg.norm(self.rate))
        if speed > 0.0:
            sine, cosine = math.sin(speed * h), math.cos(speed * h)
            self.direction = cosine * u + sine / speed * self.rate
            self.rate = cosine * self.rate - speed * sine * u

    def measure(self, offset: Array) -> None:
        """Take where the load was measured to be from the quadrotor [m], shape (3,)."""
        u = self.direction
        gain = self._covariance[:, 0] / (self._covariance[0, 0] + self._noise)
        axis = np.cross(u, offset)
        size = float(np.linalg.norm(axis))
        angle = math.atan2(size, float(u @ offset))
        if size > 0.0:
            error = angle * np.cross(axis / size, u)
            rate = self.rate + float(gain[1]) * error
            self.rate = float(gain[0]) * error
            self._turn(1.0)
            self.rate = rate - float(rate @ self.direction) * self.direction
        self._covariance -= np.outer(gain, self._covariance[0])

    def ahead(self, acceleration: Array, dt: float) -> tuple[Array, Array]:
        """Direction and rate a moment later, nothing kept."""
        kept = self.direction, self.rate, self._covariance.copy()
        self.move(acceleration, dt)
        result = self.direction, self.rate
        self.direction, self.rate, self._covariance = kept
        return result


class Fall:
    """Follows a load that was let go until it crosses the rim's plane.

    Parameters
    ----------
    plane : float
        Height of the rim [m], in the heights' frame of `see`.
    """

    def __init__(self, plane: float) -> None:
        self.plane = plane
        self._before: Array | None = None
        self.landing: Array | None = None
        """(along, across) where it crossed the plane from above [m]; None as long as it has not."""
        self.lowest = math.inf
        """Least height seen [m]."""

    def see(self, place: Array) -> None:
        """Take the load's position: along, across, height [m]."""
        before, self._before = self._before, place
        self.lowest = min(self.lowest, float(place[2]))
        if before is None or self.landing is not None:
            return
        if before[2] >= self.plane > place[2]:
            part = (before[2] - self.plane) / (before[2] - place[2])
            self.landing = (before + part * (place - before))[:2]
