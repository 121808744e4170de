"""What each autopilot wants to hear, as data. Measured on ArduCopter 4.7-dev and PX4 1.17-alpha.

Where behaviours differ in kind there is a field for it here, and the code asks the field; no code
asks for an autopilot's name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.errors import InputError
from msg_bridge.mavlink import convert


class ParameterChange(NamedTuple):
    """A parameter of the autopilot that has to have a value while the bridge flies.

    It goes by one of `names`, which other versions of the autopilot have for the same.
    """

    names: tuple[str, ...]
    value: float
    why: str


class GripperSetup(NamedTuple):
    """What an autopilot must have booted with to have a gripper that moves.

    Attributes
    ----------
    needs : tuple of (str, tuple of float)
        Parameters, and the values that do; the first is what to set.
    outputs : tuple of str
        Parameters that hold the function of its outputs, from the first one on.
    function : float
        Of an output that the gripper is on.
    usual : str
        One of `outputs` that is often free.
    moves_disarmed : bool
        Whether it is seen to move on the ground.
    """

    needs: tuple[tuple[str, tuple[float, ...]], ...] = ()
    outputs: tuple[str, ...] = ()
    function: float = 0.0
    usual: str = ""
    moves_disarmed: bool = False


_NO_GRIPPER = GripperSetup()


class Answer(NamedTuple):
    """How a vehicle answers an acceleration that is asked for, where that is far from ideal.

    Attributes
    ----------
    delay : float
        Until it begins to come about [s].
    lag : float
        First-order time constant with which it then does [s].
    drag : float
        Of the air: deceleration over speed [1/s].
    gain : float
        Times what is asked for, it comes about.
    push : float
        What pushes the vehicle besides all through an episode, at most, either way [m/s²].
    """

    delay: float = 0.0
    lag: float = 0.0
    drag: float = 0.0
    gain: float = 1.0
    push: float = 0.0


IDEAL = Answer()


@dataclass(frozen=True)
class AutopilotProfile:
    """One autopilot.

    Attributes
    ----------
    name : str
    autopilot : int
        MAV_AUTOPILOT of its heartbeat.
    modes : dict of int to str
        Names of custom modes, for people.
    controlled, landing : int
        Custom modes in which it obeys setpoints, and in which it lands.
    packed_modes : bool
        Custom modes are main << 16 | sub << 24, and asked for by their two halves.
    stream_first : bool
        It takes the mode only while setpoints come, and climbs by setpoints, too. Otherwise it
        wants the mode first, and takes off by command.
    acceleration : int
        Type mask of an acceleration setpoint that holds the height.
    integer_bytes : bool
        Integers travel as their bytes in the float of PARAM_VALUE, not as numbers.
    changes : tuple of ParameterChange
        Made at configure, taken back after.
    estimator : int
        Message in which it says whether it knows where it is.
    held : float
        How long the last acceleration goes on when setpoints stop, with the changes made [s].
    leaning : float
        How long it takes until it then brakes [s].
    stopping : float
        Deceleration with which it comes to rest [m/s²].
    noise : float
        Standard deviation of its position's error that is counted on, if not more is measured [m].
    speed_noise : float
        The same of its velocity [m/s].
    answer : Answer
        How it answers an acceleration in an episode.
    release : str
        How it lets the load go, unless told otherwise.
    gripper : GripperSetup
    flies_not : str
        Why it cannot be flown over MAVLink; empty when it can.
    """

    name: str
    autopilot: int
    modes: dict[int, str]
    controlled: int
    landing: int
    packed_modes: bool = False
    stream_first: bool = False
    acceleration: int = int(convert.ACCELERATION)
    integer_bytes: bool = False
    changes: tuple[ParameterChange, ...] = ()
    estimator: int = dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT
    held: float = 0.5
    leaning: float = 0.3
    stopping: float = 2.0
    noise: float = 0.0
    speed_noise: float = 0.0
    answer: Answer = IDEAL
    release: str = "gripper"
    gripper: GripperSetup = _NO_GRIPPER
    flies_not: str = ""

    def mode_name(self, custom_mode: int) -> str:
        """Name of a mode, or its number."""
        return self.modes.get(custom_mode, f"mode {custom_mode}")

    def mode_halves(self, custom_mode: int) -> tuple[float, float]:
        """Second and third parameter of DO_SET_MODE."""
        if self.packed_modes:
            return float(custom_mode >> 16 & 0xFF), float(custom_mode >> 24)
        return float(custom_mode), 0.0


def px4_mode(main: int, sub: int = 0) -> int:
    """PX4's custom mode of its two halves."""
    return main << 16 | sub << 24


ARDUPILOT = AutopilotProfile(
    name="ardupilot",
    autopilot=dialect.MAV_AUTOPILOT_ARDUPILOTMEGA,
    modes={0: "STABILIZE", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 5: "LOITER", 6: "RTL",
           9: "LAND", 17: "BRAKE"},
    controlled=4,
    landing=9,
    # From 2.4 m/s, pushed by 3 m/s²: 4.48 m/s at most, 7.6 m to rest (8 flights: 7.4 to 7.65).
    held=0.69,
    leaning=0.3,
    stopping=1.92,
    changes=(
        ParameterChange(
            ("GUID_TIMEOUT",), 0.5, "the last acceleration is held for so long when all is lost"
        ),
        ParameterChange(
            ("PSC_JERK_XY", "PSC_JERK_NE", "PSC_NE_JERK"), 20.0,
            "with less, quick changes of the acceleration run away",
        ),
    ),
    gripper=GripperSetup(
        needs=(("GRIP_ENABLE", (1.0,)), ("GRIP_TYPE", (1.0, 2.0))),
        outputs=tuple(f"SERVO{n}_FUNCTION" for n in range(1, 17)), function=28.0,
        usual="SERVO9_FUNCTION",
        moves_disarmed=True,
    ),
)  # fmt: skip

PX4 = AutopilotProfile(
    name="px4",
    autopilot=dialect.MAV_AUTOPILOT_PX4,
    modes={
        px4_mode(1): "MANUAL", px4_mode(2): "ALTCTL", px4_mode(3): "POSCTL",
        px4_mode(4, 2): "TAKEOFF", px4_mode(4, 3): "HOLD", px4_mode(4, 4): "MISSION",
        px4_mode(4, 5): "RTL", px4_mode(4, 6): "LAND", px4_mode(6): "OFFBOARD",
        px4_mode(7): "STABILIZED",
    },
    controlled=px4_mode(6),
    landing=px4_mode(4, 6),
    packed_modes=True,
    stream_first=True,
    # In SIH, whose air brakes it besides: from 2.4 m/s, pushed by 3 m/s², 4.5 m to rest, from
    # 1.75 m/s without a push 1.7 to 2.4 m. Counted without the air.
    held=0.7,
    leaning=0.7,
    stopping=5.0,
    noise=0.2,  # against the truth of its simulator: 0.20 to 0.24 m, 0.72 m at most
    speed_noise=0.3,  # the same: 0.12 to 0.31 m/s, and up to 0.8 m/s for some seconds
    # scripts/measure_answer.py on 185 episodes of 8 flights, at 1 and 4 times real time; of single
    # episodes (90 %) drag is 0.9 to 1.7 /s, push -0.4 to 0.6 m/s². Delay and lag, drag and gain
    # are hard to tell apart: 0.1 s, 0.14 s, 1.2 /s and 1.13 explain nearly as much.
    answer=Answer(delay=0.14, lag=0.09, drag=1.15, gain=1.05, push=0.5),
    acceleration=int(convert.ACCELERATION_HEIGHT),
    integer_bytes=True,
    estimator=dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
    changes=(
        ParameterChange(("COM_OF_LOSS_T",), 0.5, "how long it flies on when setpoints stop"),
        ParameterChange(("COM_OBL_RC_ACT",), 5, "then it holds its position instead of returning"),
    ),
    gripper=GripperSetup(
        needs=(("PD_GRIPPER_EN", (1.0,)),),
        outputs=tuple(f"PWM_MAIN_FUNC{n}" for n in range(1, 17)), function=430.0,
        usual="PWM_MAIN_FUNC5",
    ),
)  # fmt: skip

PAPARAZZI = AutopilotProfile(
    name="paparazzi",
    autopilot=dialect.MAV_AUTOPILOT_PPZ,
    modes={0: "unknown"},
    controlled=0,
    landing=0,
    flies_not=(
        "its MAVLink takes a velocity setpoint for a position, usually the origin, ignores "
        "accelerations, and flies on when setpoints stop; docs/sitl.md says more"
    ),
)

PROFILES = {profile.name: profile for profile in (ARDUPILOT, PX4, PAPARAZZI)}


def of_autopilot(number: int) -> AutopilotProfile:
    """The profile for what a heartbeat says.

    Raises
    ------
    InputError
        When there is none.
    """
    for profile in PROFILES.values():
        if profile.autopilot == number:
            return profile
    known = ", ".join(f"{p.autopilot} ({p.name})" for p in PROFILES.values())
    raise InputError(f"the autopilot says it is {number}; allowed: {known}")
