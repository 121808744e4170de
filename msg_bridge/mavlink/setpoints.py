"""What is asked of the autopilot, in the task's frame, and the packet that says so."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from msg_bridge.mavlink import convert
from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.profiles import AutopilotProfile


class AccelerationSetpoint(NamedTuple):
    """Accelerations along, across and upwards [m/s²], at a height [m]."""

    along: float
    across: float
    up: float
    height: float


class VelocitySetpoint(NamedTuple):
    """Velocities along, across and upwards [m/s]."""

    along: float
    across: float
    up: float


class PositionSetpoint(NamedTuple):
    """A position: along, across and height [m]."""

    along: float
    across: float
    height: float


Setpoint = AccelerationSetpoint | VelocitySetpoint | PositionSetpoint

_NOTHING = np.zeros(3)


def packet(
    setpoint: Setpoint, profile: AutopilotProfile, track: Track, target: tuple[int, int], now: float
) -> Any:
    """The setpoint message of a setpoint.

    Raises
    ------
    ValueError
        When a number that matters is not finite.
    """
    position, velocity, acceleration = _NOTHING, _NOTHING, _NOTHING
    if isinstance(setpoint, AccelerationSetpoint):
        mask = profile.acceleration
        acceleration = track.there(np.array([setpoint.along, setpoint.across, setpoint.up]))
        position = np.array([0.0, 0.0, setpoint.height])
    elif isinstance(setpoint, VelocitySetpoint):
        mask = int(convert.VELOCITY)
        velocity = track.there(np.array(setpoint))
    else:
        mask = int(convert.POSITION)
        position = track.place_there(np.array(setpoint))
    time_ms = int(now * 1e3) & 0xFFFFFFFF
    return convert.setpoint(mask, target, time_ms, position, velocity, acceleration)


class Integral:
    """Accelerations along one axis summed up to velocities, for profiles that want those.

    It never runs ahead of the vehicle by more than `lead`: what it cannot fly is not saved up.
    """

    lead = 1.5  # [m/s]

    def __init__(self) -> None:
        self._velocity: float | None = None

    def forget(self) -> None:
        """Begin anew, at the vehicle's speed, with the next one."""
        self._velocity = None

    def velocity(self, acceleration: float, speed: float, dt: float) -> float:
        """Velocity [m/s] after an acceleration [m/s²] for `dt` [s]; `speed` is the vehicle's."""
        begun = speed if self._velocity is None else self._velocity
        wanted = begun + acceleration * dt
        self._velocity = min(max(wanted, speed - self.lead), speed + self.lead)
        return self._velocity
