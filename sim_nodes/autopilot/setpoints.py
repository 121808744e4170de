"""SET_POSITION_TARGET_LOCAL_NED: what each autopilot makes of its masks and frames."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sim_nodes.autopilot.control import HAS_ACCELERATION, HAS_POSITION, HAS_VELOCITY, Target

LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED = 1, 7, 8, 9
BODY_FRD = 12
FORCE, NO_YAW, NO_YAW_RATE = 1 << 9, 1 << 10, 1 << 11


def _rows(message: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([
        (message.x, message.y, message.z),
        (message.vx, message.vy, message.vz),
        (message.afx, message.afy, message.afz),
    ])  # fmt: skip


def _turned(rows: Any, yaw: float) -> Any:
    """Vectors of a body-fixed horizontal frame in the world's."""
    north = np.cos(yaw) * rows[:, 0] - np.sin(yaw) * rows[:, 1]
    east = np.sin(yaw) * rows[:, 0] + np.cos(yaw) * rows[:, 1]
    return np.stack([north, east, rows[:, 2]], axis=1)


def _yaw(message: Any) -> tuple[float, float]:
    mask = message.type_mask
    if not mask & NO_YAW and math.isfinite(message.yaw):
        return message.yaw, 0.0
    if not mask & NO_YAW_RATE and math.isfinite(message.yaw_rate):
        return math.nan, message.yaw_rate
    return math.nan, 0.0


class NotFiniteError(ArithmeticError):
    """An acceleration that is no number: ArduCopter aborts on it."""


def of_ardupilot(message: Any, position: Any, yaw: float) -> Target | None:
    """ArduCopter's reading: one ignore bit of a vector ignores the whole vector.

    Returns
    -------
    Target or None
        None for a setpoint on which the vehicle silently stops.

    Raises
    ------
    NotFiniteError
        On an acceleration that is no number.
    """
    mask, rows = message.type_mask, _rows(message)
    taken = [not mask & (0b111 << 3 * row) for row in range(3)]
    if message.coordinate_frame not in (LOCAL_NED, LOCAL_OFFSET_NED, BODY_NED, BODY_OFFSET_NED):
        return None
    if mask & FORCE or not any(taken):
        return None
    if taken[2] and not np.isfinite(rows[2]).all():
        raise NotFiniteError
    if not all(np.isfinite(rows[row]).all() for row in range(3) if taken[row]):
        return None
    if message.coordinate_frame in (BODY_NED, BODY_OFFSET_NED):
        rows = _turned(rows, yaw)
    if message.coordinate_frame != LOCAL_NED:
        rows[0] += position
    use = sum(
        flag
        for flag, took in zip((HAS_POSITION, HAS_VELOCITY, HAS_ACCELERATION), taken, strict=True)
        if took
    )
    rows[~np.array(taken)] = 0.0
    return Target(np.full(3, use), rows, *_yaw(message))


def of_px4(message: Any, yaw: float) -> Target | None:
    """PX4's reading: every axis of its own; a number that is none counts as ignored.

    Returns
    -------
    Target or None
        None where the frame is not one that it takes, or an axis is left without any target.
    """
    mask, rows = message.type_mask, _rows(message)
    if message.coordinate_frame == BODY_NED:
        rows[1:] = _turned(rows, yaw)[1:]
        if mask & 0b111 != 0b111:
            return None
    elif message.coordinate_frame != LOCAL_NED:
        return None
    use = np.zeros(3, np.int64)
    for row, flag in enumerate((HAS_POSITION, HAS_VELOCITY, HAS_ACCELERATION)):
        for axis in range(3):
            if not mask & (1 << 3 * row + axis) and math.isfinite(rows[row, axis]):
                use[axis] |= flag
            else:
                rows[row, axis] = 0.0
    if mask & FORCE or not use.all():
        return None
    return Target(use, rows, *_yaw(message))
