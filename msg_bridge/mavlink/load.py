"""Where the load is: heard of from a second system, or told from the quadrotor's acceleration."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import G

Array = NDArray[np.float64]

_STEP = 0.02  # longest step of the integration [s]


class LoadObserver:
    """Angle and rate of the cable, by an extended Kalman filter on T Eq. 18.

    It is carried along by the quadrotor's changes of velocity, which telemetry measures, and
    pulled to the angle that a feed measures. Without a feed it is the swing that a load would
    have which hung still at `still`; a slight damping lets what was not known of it fade.

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
        self.angle, self.rate = 0.0, 0.0
        self._covariance = np.diag([0.05**2, 0.1**2])

    def move(self, acceleration: float, dt: float) -> None:
        """Let time pass while the quadrotor accelerates along the track [m/s²], [s]."""
        n = max(1, math.ceil(dt / _STEP))
        for _ in range(n):
            self._advance(acceleration, dt / n)

    def _advance(self, a: float, h: float) -> None:
        sine, cosine = math.sin(self.angle), math.cos(self.angle)
        stiffness = (a * sine - G * cosine) / self._cable
        jacobian = np.array([[1.0, h], [stiffness * h, 1.0 - self._damping * h]])
        change = -(cosine * a + sine * G) / self._cable - self._damping * self.rate
        self.rate += change * h
        self.angle += self.rate * h
        self._covariance = jacobian @ self._covariance @ jacobian.T
        self._covariance[1, 1] += self._gust * h

    def measure(self, angle: float) -> None:
        """Take an angle that was measured [rad]."""
        gain = self._covariance[:, 0] / (self._covariance[0, 0] + self._noise)
        error = angle - self.angle
        self.angle += float(gain[0]) * error
        self.rate += float(gain[1]) * error
        self._covariance -= np.outer(gain, self._covariance[0])

    def ahead(self, acceleration: float, dt: float) -> tuple[float, float]:
        """Angle and rate a moment later, nothing kept."""
        kept = self.angle, self.rate, self._covariance.copy()
        self.move(acceleration, dt)
        result = self.angle, self.rate
        self.angle, self.rate, self._covariance = kept
        return result


def swing(offset: Array) -> float:
    """Angle of the cable [rad] from (along, across, up) of the load, from the quadrotor [m]."""
    return math.atan2(float(offset[0]), -float(offset[2]))


class Fall:
    """Follows a load that was let go until it crosses the rim's plane.

    Parameters
    ----------
    plane : float
        Height of the rim [m], in the heights' frame of `see`.
    """

    def __init__(self, plane: float) -> None:
        self.plane = plane
        self._before: tuple[float, float] | None = None
        self.landing: float | None = None
        """x where it crossed the plane from above [m]; None as long as it has not."""
        self.lowest = math.inf
        """Least height seen [m]."""

    def see(self, x: float, height: float) -> None:
        """Take the load's position [m]."""
        before, self._before = self._before, (x, height)
        self.lowest = min(self.lowest, height)
        if before is None or self.landing is not None:
            return
        if before[1] >= self.plane > height:
            part = (before[1] - self.plane) / (before[1] - height)
            self.landing = before[0] + part * (x - before[0])
