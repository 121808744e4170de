"""MAVLink's frames and units on one side, this graph's (ENU, SI, radians) on the other.

Nothing else of the bridge knows of NED, of centimetres or of degrees times ten million. Where a
task happens is a `Track`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.frames import swap_world

Array = NDArray[np.float64]

EARTH = 6_378_137.0
"""Equatorial radius of WGS 84 [m]; over a flight's few metres the earth is a ball of it."""

_STANDARD_G = 9.80665  # of an accelerometer's g [m/s²]
_DEGREE_E7 = math.radians(1e-7)
_FRAME = dialect.MAV_FRAME_LOCAL_NED


@dataclass(frozen=True)
class Track:
    """The frame in which a task happens: a vertical plane, or all of what is around it.

    Attributes
    ----------
    origin : tuple of float
        East and north of the task's origin in the autopilot's local frame [m].
    heading : float
        Direction of +x, counter-clockwise from east [rad].
    """

    origin: tuple[float, float] = (0.0, 0.0)
    heading: float = 0.0

    def here(self, world: Array) -> Array:
        """(along, across to the left, up) of a vector (east, north, up), about no origin."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        east, north, up = world
        return np.array([c * east + s * north, c * north - s * east, up])

    def there(self, track: Array) -> Array:
        """The vector (east, north, up) of (along, across, up); the inverse of `here`."""
        c, s = math.cos(self.heading), math.sin(self.heading)
        along, across, up = track
        return np.array([c * along - s * across, c * across + s * along, up])

    def place_here(self, world: Array) -> Array:
        """Position (along, across, up) of a position (east, north, up) [m]."""
        return self.here(world - np.array([*self.origin, 0.0]))

    def place_there(self, track: Array) -> Array:
        """Position (east, north, up) of (along, across, up) [m]; the inverse of `place_here`."""
        return self.there(track) + np.array([*self.origin, 0.0])


def local_position(message: Any) -> tuple[Array, Array]:
    """Position [m] and velocity [m/s], both ENU, of a LOCAL_POSITION_NED."""
    m = message
    return swap_world(np.array([m.x, m.y, m.z])), swap_world(np.array([m.vx, m.vy, m.vz]))


def global_offset(message: Any, reference: Any) -> Array:
    """From one GLOBAL_POSITION_INT to another [m], ENU: degrees times 1e7 and millimetres."""
    latitude = reference.lat * _DEGREE_E7
    north = (message.lat - reference.lat) * _DEGREE_E7 * EARTH
    east = (message.lon - reference.lon) * _DEGREE_E7 * EARTH * math.cos(latitude)
    return np.array([east, north, (message.alt - reference.alt) * 0.001])


def axes(message: Any) -> Array:
    """Ahead, left and upwards as the vehicle has them, ENU, unit rows of shape (3, 3).

    Of an ATTITUDE: roll, pitch and yaw.
    """
    cr, sr = math.cos(message.roll), math.sin(message.roll)
    cp, sp = math.cos(message.pitch), math.sin(message.pitch)
    cy, sy = math.cos(message.yaw), math.sin(message.yaw)
    return np.array([
        (cp * sy, cp * cy, sp),
        (-sr * sp * sy - cr * cy, cr * sy - sr * sp * cy, sr * cp),
        (sr * cy - cr * sp * sy, -cr * sp * cy - sr * sy, cr * cp),
    ])  # fmt: skip


def upwards(message: Any) -> Array:
    """Where the rotors' axis points to, ENU, a unit vector of shape (3,), of an ATTITUDE."""
    up: Array = axes(message)[2]
    return up


def felt(message: Any) -> Array:
    """Acceleration less gravity, of a SCALED_IMU [m/s²], shape (3,): ahead, left, upwards.

    It comes in thousandths of the standard g.
    """
    m = message
    return np.array([m.xacc, -m.yacc, -m.zacc]) * (_STANDARD_G * 1e-3)


def tilt(message: Any) -> float:
    """Angle between the rotors' axis and the vertical [rad], of an ATTITUDE."""
    return math.acos(min(max(float(upwards(message)[2]), -1.0), 1.0))


class Ignore(IntFlag):
    """What a setpoint says nothing of: POSITION_TARGET_TYPEMASK of MAVLink."""

    PX, PY, PZ = 1, 2, 4
    VX, VY, VZ = 8, 16, 32
    AX, AY, AZ = 64, 128, 256
    YAW, YAW_RATE = 1024, 2048


_TURN = Ignore.YAW | Ignore.YAW_RATE
ACCELERATION = 0x03F | _TURN
"""Acceleration alone: 0x0C3F."""
ACCELERATION_HEIGHT = 0x13B | _TURN
"""Acceleration in the horizontal, position in the vertical: 0x0D3B."""
VELOCITY = 0x1C7 | _TURN
"""Velocity alone: 0x0DC7."""
POSITION = 0x1F8 | _TURN
"""Position alone: 0x0DF8."""


def setpoint(
    mask: int,
    target: tuple[int, int],
    time_ms: int,
    position: Array,
    velocity: Array,
    acceleration: Array,
) -> Any:
    """A SET_POSITION_TARGET_LOCAL_NED of ENU vectors; those that `mask` ignores go as zeros.

    Parameters
    ----------
    mask : int
        What to ignore.
    target : (int, int)
        System and component.
    time_ms : int
        Time since boot [ms].
    position, velocity, acceleration : ndarray of shape (3,)
        ENU, in m, m/s and m/s².

    Raises
    ------
    ValueError
        When a number that matters is not finite: such a setpoint can stop an autopilot, so it is
        never made.
    """
    fields = swap_world(np.array([position, velocity, acceleration])).ravel()
    ignored = np.array([bool(mask & (1 << bit)) for bit in range(9)])
    fields = np.where(ignored, 0.0, fields)
    if not np.isfinite(fields).all():
        raise ValueError(f"setpoint is {fields.tolist()}; allowed: finite numbers")
    return dialect.MAVLink_set_position_target_local_ned_message(
        time_ms, *target, _FRAME, int(mask), *fields.tolist(), 0.0, 0.0
    )
