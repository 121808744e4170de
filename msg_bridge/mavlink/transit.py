"""Flying the quadrotor somewhere while its load comes to rest: a linear-quadratic regulator."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solve_continuous_are

from msg_bridge.mavlink.motion import Motion, Plane
from sim_nodes.tasks.base import G

_NEAR, _SLOW = 1.5, 0.5  # from here on, what pushes it aside all the time is made up for [m, m/s]
_INTEGRAL = 0.2  # [1/s³]
_STEADY = 1.0  # at most [m/s²]
_LEAD = 2.0  # the regulator never sees the target further away than this [m]: it bounds the speed


class Transit:
    """Accelerations along one axis that lead to a place.

    Parameters
    ----------
    cable : float
        Length of the cable [m].
    response : float
        Time constant with which an acceleration follows its setpoint [s].
    """

    def __init__(self, cable: float, response: float) -> None:
        # [x, v, θ, ω, a], linear about a load at rest (T Eq. 18), driven by the setpoint.
        dynamics = np.zeros((5, 5))
        dynamics[0, 1] = dynamics[2, 3] = 1.0
        dynamics[1, 4] = 1.0
        dynamics[3, 2], dynamics[3, 4] = -G / cable, -1.0 / cable
        dynamics[4, 4] = -1.0 / response
        drive = np.zeros((5, 1))
        drive[4, 0] = 1.0 / response
        cost = np.diag([1.0, 0.5, 8.0, 2.0, 0.0])
        effort = np.array([[1.0]])
        riccati = solve_continuous_are(dynamics, drive, cost, effort)
        self._gains = (drive.T @ riccati)[0]
        self._acceleration = self._against = 0.0
        self._response = response

    def along(self, target: float, now: Plane, dt: float) -> float:
        """Setpoint along the axis [m/s²] towards a place [m]; `dt` since the last one [s]."""
        error = max(-_LEAD, min(now.place - target, _LEAD))
        state = np.array([error, now.speed, now.swing, now.swing_rate, self._acceleration])
        wanted = float(-self._gains @ state)
        # What the vehicle does with it is not measured well; the model that the gains are for is.
        self._acceleration += (wanted - self._acceleration) * min(dt / self._response, 1.0)
        if abs(error) < _NEAR and abs(now.speed) < _SLOW:
            against = self._against - _INTEGRAL * error * dt
            self._against = max(-_STEADY, min(against, _STEADY))
        return max(-2.5, min(wanted + self._against, 2.5))


def across(motion: Motion) -> float:
    """Acceleration across the track that leads back to it [m/s²]."""
    return max(-1.5, min(-1.0 * motion.across - 1.6 * motion.drift, 1.5))


def upwards(height: float, motion: Motion) -> float:
    """Acceleration upwards that leads to a height [m/s²]."""
    return max(-1.0, min(0.8 * (height - motion.height) - 1.5 * motion.climb, 1.0))
