"""What the autopilot tells of itself: one small function for each message."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_nodes.autopilot.firmware import Mode
from sim_nodes.autopilot.onboard import State

HOME = (47.3977419, 8.5455938, 488.0)
"""Where it was switched on: latitude, longitude [deg], height over the sea [m]; chosen."""

_DEGREE = 111_319.49  # of latitude [m]
_CIRCLE = _DEGREE * math.cos(math.radians(HOME[0]))  # of longitude [m]
_STANDARD_G = 9.80665  # of an accelerometer's g [m/s²]
_PRESENT = 0x0220FC2F | mavlink.MAV_SYS_STATUS_PREARM_CHECK
_GLOBAL_OK, _PRESENT_NO_POSITION = 0x3FF, 0xA7


def globe(position: Any) -> tuple[int, int, int]:
    """Latitude, longitude [1e-7 deg] and height over home [mm] of a place, NED [m]."""
    latitude = HOME[0] + position[0] / _DEGREE
    longitude = HOME[1] + position[1] / _CIRCLE
    return round(latitude * 1e7), round(longitude * 1e7), round(-position[2] * 1e3)


def global_position(milliseconds: int, position: Any, velocity: Any, heading: int) -> Any:
    """GLOBAL_POSITION_INT of the vehicle or of the load."""
    latitude, longitude, height = globe(position)
    speed = [max(-32768, min(32767, round(v * 100.0))) for v in velocity]
    sea = height + round(HOME[2] * 1e3)
    return mavlink.MAVLink_global_position_int_message(
        milliseconds, latitude, longitude, sea, height, *speed, heading
    )


def _heading(a: State) -> int:
    return round(math.degrees(a.body.attitude[0, 2]) * 100.0) % 36000


def heartbeat(a: State) -> Any:
    """Type, mode and whether it is armed."""
    flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
    if a.commander.mode in (Mode.EXTERNAL, Mode.RETURN, Mode.LAND, Mode.TAKEOFF):
        flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
    if a.commander.armed:
        flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    state = mavlink.MAV_STATE_ACTIVE if a.commander.armed else mavlink.MAV_STATE_STANDBY
    if a.commander.critical:
        state = mavlink.MAV_STATE_CRITICAL
    number = a.firmware.modes[a.commander.mode]
    return mavlink.MAVLink_heartbeat_message(2, a.firmware.autopilot, flags, number, state, 3)


def _attitude(a: State) -> Any:
    angles, rates = a.body.attitude
    return mavlink.MAVLink_attitude_message(a.milliseconds, *angles, *rates)


def _quaternion(a: State) -> Any:
    (roll, pitch, yaw), rates = a.body.attitude
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    parts = (
        cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy,
    )  # fmt: skip
    return mavlink.MAVLink_attitude_quaternion_message(a.milliseconds, *parts, *rates)


def _imu(a: State) -> Any:
    """SCALED_IMU of what pulls and pushes it and how it turns: thousandths of g and of rad/s."""
    value = a.parameters
    force = a.body.felt(float(value["SIM_ACC_NOISE"]), float(value["SIM_ACC_BIAS"]))
    numbers = [*(force / _STANDARD_G * 1e3), *(a.body.attitude[1] * 1e3)]
    counts = [max(-32768, min(32767, round(number))) for number in numbers]
    return mavlink.MAVLink_scaled_imu_message(a.milliseconds, *counts, 0, 0, 0)


def _local(a: State) -> Any:
    if not a.commander.ready:
        return None
    place, speed = a.body.position, a.body.velocity
    return mavlink.MAVLink_local_position_ned_message(a.milliseconds, *place, *speed)


def _global(a: State) -> Any:
    if not a.commander.ready:
        return None
    return global_position(a.milliseconds, a.body.position, a.body.velocity, _heading(a))


def _sys_status(a: State) -> Any:
    healthy = _PRESENT
    if not a.commander.ready:
        healthy &= ~(mavlink.MAV_SYS_STATUS_PREARM_CHECK | mavlink.MAV_SYS_STATUS_SENSOR_GPS)
    return mavlink.MAVLink_sys_status_message(
        _PRESENT, _PRESENT, healthy, 250, 16200, -1, 90, 0, 0, 0, 0, 0, 0
    )


def _extended(a: State) -> Any:
    landed = mavlink.MAV_LANDED_STATE_IN_AIR
    if a.body.landed:
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND
    elif a.commander.mode is Mode.TAKEOFF:
        landed = mavlink.MAV_LANDED_STATE_TAKEOFF
    elif a.commander.mode is Mode.LAND:
        landed = mavlink.MAV_LANDED_STATE_LANDING
    return mavlink.MAVLink_extended_sys_state_message(0, landed)


def _estimator(a: State) -> Any:
    flags = _GLOBAL_OK if a.commander.ready else _PRESENT_NO_POSITION
    ratio = 0.1 if a.commander.ready else 2.0
    return mavlink.MAVLink_estimator_status_message(
        a.microseconds, flags, ratio, ratio, ratio, 0.1, 0.1, 0.1, 0.2, 0.3
    )


def _ekf(a: State) -> Any:
    flags, variance = (0x33F, 0.1) if a.commander.ready else (0xA7, 2.0)
    return mavlink.MAVLink_ekf_status_report_message(flags, *[variance] * 5)


def _system_time(a: State) -> Any:
    return mavlink.MAVLink_system_time_message(a.unix_microseconds, a.milliseconds)


def _home(a: State) -> Any:
    if not a.commander.ready:
        return None
    place = round(HOME[0] * 1e7), round(HOME[1] * 1e7), round(HOME[2] * 1e3)
    return mavlink.MAVLink_home_position_message(*place, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)


def _battery(a: State) -> Any:
    cells = [4050] * 4 + [65535] * 6
    return mavlink.MAVLink_battery_status_message(0, 0, 3, 32767, cells, -1, -1, -1, 90)


def _gps(a: State) -> Any:
    latitude, longitude, height = globe(a.body.position)
    fix = 3 if a.commander.ready else 1
    return mavlink.MAVLink_gps_raw_int_message(
        a.microseconds, fix, latitude, longitude, height + round(HOME[2] * 1e3), 80, 80,
        round(100.0 * float(np.hypot(*a.body.velocity[:2]))), 65535, 12,
    )  # fmt: skip


def _servos(a: State) -> Any:
    spinning = 1100 + round(50.0 * a.body.push) if a.commander.armed else 1000
    return mavlink.MAVLink_servo_output_raw_message(
        a.microseconds % 2**32, 0, *[min(spinning, 2000)] * 4, *a.release.servos
    )


def _hud(a: State) -> Any:
    speed = float(np.hypot(*a.body.velocity[:2]))
    down, climb = float(a.body.position[2]), -float(a.body.velocity[2])
    thrust = min(100, round(2.5 * a.body.push))
    return mavlink.MAVLink_vfr_hud_message(
        speed, speed, _heading(a) // 100, thrust, HOME[2] - down, climb
    )


def _rc(a: State) -> Any:
    channels = getattr(a.commander, "channels", [0] * 8)
    return mavlink.MAVLink_rc_channels_message(
        a.milliseconds, 8, *channels, *[65535] * 10, 255 if any(channels) else 0
    )


def _timesync(a: State) -> Any:
    return mavlink.MAVLink_timesync_message(0, a.microseconds * 1000)


def _version(a: State) -> Any:
    capable = (
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | (
            mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
            if a.firmware.bytewise
            else mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        )
    )
    none, unique = [0] * 8, int(a.parameters["SIM_UID"])
    return mavlink.MAVLink_autopilot_version_message(
        capable, 0, 0, 0, 0, none, none, none, 0, 0, unique
    )


BUILDERS: dict[str, Callable[[State], Any]] = {
    "HEARTBEAT": heartbeat, "ATTITUDE": _attitude, "ATTITUDE_QUATERNION": _quaternion,
    "SCALED_IMU": _imu, "LOCAL_POSITION_NED": _local,
    "GLOBAL_POSITION_INT": _global, "SYS_STATUS": _sys_status,
    "EXTENDED_SYS_STATE": _extended, "ESTIMATOR_STATUS": _estimator, "EKF_STATUS_REPORT": _ekf,
    "SYSTEM_TIME": _system_time, "HOME_POSITION": _home, "BATTERY_STATUS": _battery,
    "GPS_RAW_INT": _gps, "SERVO_OUTPUT_RAW": _servos, "VFR_HUD": _hud, "RC_CHANNELS": _rc,
    "TIMESYNC": _timesync, "AUTOPILOT_VERSION": _version,
}  # fmt: skip
"""Each takes the autopilot and gives a message, or None while there is nothing to tell."""

NAMES = {
    kind.id: name for name, kind in (
        (name, getattr(mavlink, f"MAVLink_{name.lower()}_message")) for name in BUILDERS
    )
}  # fmt: skip
"""Of the messages, by their number on the wire."""
