"""How a vehicle and its load move, in the task's own frame: what everybody here looks at."""

from __future__ import annotations

import math
from typing import NamedTuple

Vector = tuple[float, float, float]

_AVERAGED = 1.0  # over which creeping is looked at [s]
_JUMP = 1.0  # a position so far from where it was followed to has jumped [m]


class Plane(NamedTuple):
    """What moves in the vertical plane of one axis.

    Attributes
    ----------
    place, speed : float
        Of the vehicle along the axis [m], [m/s].
    swing, swing_rate : float
        Of the cable as it is seen from the side, positive along the axis [rad], [rad/s].
    """

    place: float
    speed: float
    swing: float
    swing_rate: float


class Motion(NamedTuple):
    """What is measured, in the task's frame: along its +x, across to the left, up.

    Attributes
    ----------
    x, speed : float
        Along the track [m], [m/s].
    across, drift : float
        Across it, to the left: a task's y, where it has one [m], [m/s].
    height, climb : float
        Above the take-off point [m], [m/s].
    up : tuple of float
        Where the rotors' axis points to, a unit vector.
    cable, cable_rate : tuple of float
        Where the cable points to from the vehicle, a unit vector, and its rate [1/s].
    """

    x: float = 0.0
    speed: float = 0.0
    across: float = 0.0
    drift: float = 0.0
    height: float = 0.0
    climb: float = 0.0
    up: Vector = (0.0, 0.0, 1.0)
    cable: Vector = (0.0, 0.0, -1.0)
    cable_rate: Vector = (0.0, 0.0, 0.0)

    @property
    def place(self) -> Vector:
        """Along, across and height [m]."""
        return self.x, self.across, self.height

    @property
    def velocity(self) -> Vector:
        """Along, across and upwards [m/s]."""
        return self.speed, self.drift, self.climb

    @property
    def tilt(self) -> float:
        """Of the rotors' axis from the vertical [rad]."""
        return math.acos(min(max(self.up[2], -1.0), 1.0))

    @property
    def swing(self) -> float:
        """Of the cable from hanging down, whichever way it swings [rad]."""
        return math.acos(min(max(-self.cable[2], -1.0), 1.0))

    def plane(self, axis: int) -> Plane:
        """The part along x (0) or across (1)."""
        out, down = self.cable[axis], -self.cable[2]
        turning = self.cable_rate[axis] * down + out * self.cable_rate[2]
        rate = turning / max(out * out + down * down, 1e-9)
        return Plane(self.place[axis], self.velocity[axis], math.atan2(out, down), rate)


class Creep:
    """How much faster a position changes than by the speed that is told with it.

    An observer of first order: it follows the position by the speed told, with `_AVERAGED`, and
    what it lags behind is the difference, averaged over that time.
    """

    def __init__(self) -> None:
        self._followed = math.nan

    def see(self, place: float, speed: float, dt: float) -> float:
        """Take what is told now; the difference [m/s].

        Parameters
        ----------
        place, speed : float
            Along one axis [m], [m/s].
        dt : float
            Since what was told before [s]; after a long time, or a jump, it begins anew.
        """
        if 0.0 <= dt < _AVERAGED:
            self._followed += (speed + (place - self._followed) / _AVERAGED) * dt
            if abs(place - self._followed) < _JUMP:
                return (place - self._followed) / _AVERAGED
        self._followed = place
        return 0.0
