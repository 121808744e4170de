"""What is known of each autopilot that is imitated, as data.

Where a number was measured on the real one (its SITL), the comment says *measured*; others are the
autopilot's documented defaults, or chosen, and say so.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from iolspi_ros.errors import InputError
from sim_nodes.autopilot.figures import FIGURES, UNASKED


class Mode(Enum):
    """What the vehicle does, whatever the autopilot calls it."""

    EXTERNAL = auto()
    """Follows setpoints from outside: GUIDED, OFFBOARD."""
    HOLD = auto()
    BRAKE = auto()
    RETURN = auto()
    LAND = auto()
    TAKEOFF = auto()
    MANUAL = auto()
    """Flown by a stick that nobody holds: no thrust."""


Value = float | int


@dataclass(frozen=True)
class Firmware:
    """One autopilot: its numbers on the wire, parameters, rates and delays."""

    name: str
    autopilot: int  # MAV_AUTOPILOT
    modes: dict[Mode, int]  # custom_mode of the heartbeat
    names: dict[Mode, str]
    first_mode: Mode
    parameters: dict[str, Value]  # an int here is an integer on the wire
    bytewise: bool  # an integer parameter travels as its bytes, not as a float
    ready_after: float  # [s] after boot until the estimator has a position
    rates: dict[str, float]  # messages sent without being asked [Hz]
    fixed_heartbeat: bool  # stays at 1 Hz whatever is asked
    any_component: bool  # takes commands for any component id
    spool_up: float  # [s] from the start of a take-off until it lifts
    arming_delay: float  # [s] after arming during which no take-off begins
    wander: tuple[float, float]  # of the estimate in flight: position [m], velocity [m/s]
    notice: float = 0.1  # until the loss of something is acted on, beside its time-out [s]
    load_drag: float = 0.02  # [1/s]
    stick_speed: float = 0.0  # at which it climbs or sinks by its own stick [m/s]
    lacks: tuple[str, ...] = ()  # messages that it cannot be asked for


SIMULATION: dict[str, Value] = {
    "SIM_SPEEDUP": 1.0,  # times real time; 0 stands still
    "SIM_WIND_SPD": 0.0,  # [m/s]
    "SIM_WIND_DIR": 0.0,  # where it comes from [deg], 0 for north
    "SIM_WIND_TURB": 0.0,  # standard deviation of gusts [m/s]
    "SIM_NOISE": 0.0,  # of the estimated position [m]; velocity [m/s] half of it
    "SIM_WANDER": 1.0,  # times the estimate's own slow error; 0.0 for none
    "SIM_ACC_NOISE": 0.1,  # standard deviation of what the accelerometer tells [m/s²]
    "SIM_ACC_BIAS": 0.0,  # of its axis ahead [m/s²]
    "SIM_DELAY": 0.0,  # each way [s]
    "SIM_LOSS": 0.0,  # share of datagrams lost, each way
    "SIM_CUT": 0.0,  # set to cut the link for so long [s]
    "SIM_CLOCK_JUMP": 0.0,  # set to let the clock jump by so much [s]
    "SIM_EKF_FAIL": 0,  # 1: the estimator loses its position
    "SIM_GRIP_FAIL": 0,  # 1: the gripper refuses; 2: it says yes and stays shut
    "SIM_UID": 0,  # that it says it has; 0 for none
    "SIM_LOAD_LEN": 1.0,  # length of the cable [m]; from boot on
    "SIM_LOAD_MASS": 0.1,  # [kg]; from boot on
}
"""Parameters of the world around the autopilot, the same for all: a test sets them in flight."""

LIMITS: dict[str, tuple[float, float]] = {
    "SIM_SPEEDUP": (0.0, 100.0), "SIM_WIND_SPD": (0.0, 30.0), "SIM_WIND_DIR": (-360.0, 360.0),
    "SIM_WIND_TURB": (0.0, 10.0), "SIM_NOISE": (0.0, 10.0), "SIM_DELAY": (0.0, 10.0),
    "SIM_WANDER": (0.0, 10.0), "SIM_ACC_NOISE": (0.0, 20.0), "SIM_ACC_BIAS": (-5.0, 5.0),
    "SIM_LOSS": (0.0, 1.0), "SIM_CUT": (0.0, 3600.0), "SIM_CLOCK_JUMP": (-1e6, 1e6),
    "SIM_LOAD_LEN": (0.1, 20.0), "SIM_LOAD_MASS": (1e-6, 1.0), "SIM_LOAD_RATE": (0.0, 100.0),
    "SIM_DRAG": (0.0, 5.0), "MAV_SYS_ID": (1, 255), "MAV_SYSID": (1, 255),
    "ANGLE_MAX": (1000, 8000), "MPC_TILTMAX_AIR": (20.0, 89.0), "PSC_JERK_XY": (1.0, 50.0),
    "PSC_JERK_NE": (1.0, 50.0), "PSC_NE_JERK": (1.0, 50.0),
    "PSC_JERK_Z": (1.0, 50.0), "WPNAV_ACCEL": (50.0, 500.0), "WPNAV_SPEED": (20.0, 2000.0),
    "ATC_ACCEL_P_MAX": (1000.0, 200_000.0),
    "WPNAV_SPEED_UP": (10.0, 1000.0), "WPNAV_SPEED_DN": (10.0, 500.0), "GRIP_GRAB": (1000, 2000),
    "GRIP_RELEASE": (1000, 2000), "GRIP_NEUTRAL": (1000, 2000),
}  # fmt: skip
"""Within which a parameter may be set; those that are not here may be any finite number."""

PX4 = Firmware(
    name="px4",
    autopilot=12,  # measured, as are the modes
    modes={
        Mode.EXTERNAL: 6 << 16, Mode.HOLD: 4 << 16 | 3 << 24, Mode.RETURN: 4 << 16 | 5 << 24,
        Mode.LAND: 4 << 16 | 6 << 24, Mode.TAKEOFF: 4 << 16 | 2 << 24,
    },
    names={
        Mode.EXTERNAL: "Offboard", Mode.HOLD: "Hold", Mode.RETURN: "Return", Mode.LAND: "Land",
        Mode.TAKEOFF: "Takeoff",
    },
    first_mode=Mode.HOLD,
    parameters={
        "COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0, "COM_RC_LOSS_T": 0.5, "COM_RCL_EXCEPT": 0,
        "COM_DL_LOSS_T": 10, "NAV_DLL_ACT": 0, "COM_DISARM_PRFLT": 10.0, "COM_DISARM_LAND": 2.0,
        "MIS_TAKEOFF_ALT": 2.5, "MPC_XY_VEL_MAX": 12.0, "MPC_Z_VEL_MAX_UP": 3.0,
        "MPC_Z_VEL_MAX_DN": 1.5, "MPC_XY_CRUISE": 5.0, "MPC_TKO_SPEED": 1.5, "MPC_LAND_SPEED": 0.7,
        "MPC_TILTMAX_AIR": 45.0, "RTL_RETURN_ALT": 60.0, "RTL_MIN_DIST": 10.0, "PD_GRIPPER_EN": 0,
        "PD_GRIPPER_TO": 3.0, "PWM_MAIN_FUNC5": 0,
        "MAV_SYS_ID": 1, "MAV_COMP_ID": 1, "SYS_AUTOSTART": 4001,
        "SIM_DRAG": 1.0,  # SIH_KDV over SIH_MASS; measured
        "SIM_LOAD_RATE": 0.0,  # it has no load of its own: set to 10 for a feed from outside
    },
    bytewise=True,
    ready_after=FIGURES["px4"]["armable"].value,
    rates=UNASKED["px4"],
    fixed_heartbeat=True,  # measured
    any_component=False,  # measured
    spool_up=3.9,  # with it the measured 6.3 s from arming to 4.6 m
    arming_delay=0.0,
    wander=(0.12, 0.17),  # against the truth of its simulator: 0.09 to 0.17 m, 0.12 to 0.25 m/s
    notice=0.1,  # it brakes 0.8 s after the last setpoint, with COM_OF_LOSS_T at 0.5: measured
)  # fmt: skip

ARDUPILOT = Firmware(
    name="ardupilot",
    autopilot=3,  # measured, as are the modes
    modes={
        Mode.EXTERNAL: 4, Mode.HOLD: 5, Mode.RETURN: 6, Mode.LAND: 9, Mode.BRAKE: 17,
        Mode.MANUAL: 0,
    },
    names={
        Mode.EXTERNAL: "GUIDED", Mode.HOLD: "LOITER", Mode.RETURN: "RTL", Mode.LAND: "LAND",
        Mode.BRAKE: "BRAKE", Mode.MANUAL: "STABILIZE",
    },
    first_mode=Mode.MANUAL,
    parameters={
        "GUID_TIMEOUT": 3.0, "PSC_JERK_XY": 5.0, "PSC_JERK_Z": 5.0, "ANGLE_MAX": 3000,
        "WPNAV_SPEED": 1000.0, "WPNAV_SPEED_UP": 250.0, "WPNAV_SPEED_DN": 150.0,
        "WPNAV_ACCEL": 250.0, "ATC_ACCEL_P_MAX": 110_000.0,
        "LAND_SPEED": 50, "RTL_ALT": 1500, "DISARM_DELAY": 10,
        "ARMING_CHECK": 1, "FS_GCS_ENABLE": 0, "FS_GCS_TIMEOUT": 5.0, "FS_EKF_ACTION": 1,
        "RC_OVERRIDE_TIME": 3.0, "FLTMODE1": 7, "FLTMODE2": 9, "FLTMODE3": 6, "FLTMODE4": 3,
        "FLTMODE5": 5, "FLTMODE6": 0, "GRIP_ENABLE": 0, "GRIP_TYPE": 0,
        "GRIP_GRAB": 1900, "GRIP_RELEASE": 1100,
        "GRIP_NEUTRAL": 1500, "SERVO9_FUNCTION": 0, "MAV_SYSID": 1, "MAV_GCS_SYSID": 255,
        "SIM_DRAG": 0.1,  # chosen; its speed controller makes up for it
        "SIM_LOAD_RATE": 10.0,  # measured
    },
    bytewise=False,
    ready_after=FIGURES["ardupilot"]["armable"].value,
    rates=UNASKED["ardupilot"],
    fixed_heartbeat=False,
    any_component=True,  # measured
    lacks=("ESTIMATOR_STATUS",),  # measured
    spool_up=1.2,  # with it a take-off to 5 m takes the measured 5.3 s
    arming_delay=2.0,  # measured: 7.3 s for one asked for just after arming
    stick_speed=FIGURES["ardupilot"]["hold sinks"].value,
    wander=(0.002, 0.002),  # 0.005 m and 0.005 m/s are reached: measured
)  # fmt: skip

WITH_GRIPPER: dict[str, dict[str, float]] = {
    "px4": {"PD_GRIPPER_EN": 1, "PWM_MAIN_FUNC5": 430},
    "ardupilot": {"GRIP_ENABLE": 1, "GRIP_TYPE": 1, "SERVO9_FUNCTION": 28},
}
"""What each must have booted with to have a gripper whose output is seen to move; measured."""

FIRMWARES = {firmware.name: firmware for firmware in (PX4, ARDUPILOT)}


def find_firmware(name: str) -> Firmware:
    """The firmware of that name.

    Raises
    ------
    InputError
        When there is none.
    """
    if name not in FIRMWARES:
        raise InputError(f"--like is {name!r}; allowed: {', '.join(FIRMWARES)}")
    return FIRMWARES[name]
