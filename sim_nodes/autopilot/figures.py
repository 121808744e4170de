"""What was measured on the real autopilots, and how close their imitation has to come.

`firmware.py` and the commanders take from here what is a number of theirs; the rest comes out of
how they fly, and `test/test_autopilot_figures.py` flies it. `scripts/measure_autopilot.py` measures
any autopilot's simulator and says how far it is from this table.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Figure:
    """One figure of a real autopilot.

    Attributes
    ----------
    value : float
        Median of what was measured.
    unit : str
    tolerance : float
        Share of it by which another may differ.
    allowance : float
        By how much it may differ in any case, in its unit.
    """

    value: float
    unit: str
    tolerance: float = 0.15
    allowance: float = 0.0

    @property
    def margin(self) -> float:
        """By how much another may differ, in its unit."""
        return max(self.tolerance * abs(self.value), self.allowance)

    def holds(self, value: float) -> bool:
        """Whether a value is the same within the tolerance."""
        return abs(value - self.value) <= self.margin


UNASKED: dict[str, dict[str, float]] = {
    "ardupilot": {"HEARTBEAT": 1.0},
    "px4": {
        "HEARTBEAT": 1.0, "ATTITUDE": 100.0, "ATTITUDE_QUATERNION": 50.0,
        "LOCAL_POSITION_NED": 30.0, "GLOBAL_POSITION_INT": 50.0, "SYS_STATUS": 5.0,
        "EXTENDED_SYS_STATE": 5.0, "ESTIMATOR_STATUS": 1.0, "SYSTEM_TIME": 1.0,
        "HOME_POSITION": 0.5, "BATTERY_STATUS": 0.5, "GPS_RAW_INT": 8.0,
        "SERVO_OUTPUT_RAW": 10.0, "VFR_HUD": 10.0,
    },
}  # fmt: skip
"""Messages that come without being asked for [Hz]; PX4's on its link for companions (14540)."""


def _unasked(name: str) -> dict[str, Figure]:
    return {f"unasked {kind}": Figure(rate, "Hz") for kind, rate in UNASKED[name].items()}


FIGURES: dict[str, dict[str, Figure]] = {
    # Three runs at 1, 2 and 5 times real time, 2 to 4 flights of each; at another speed-up only the
    # square wave differs: it comes to 2.2 to 7.2 m/s where setpoints are less regular.
    "ardupilot": _unasked("ardupilot") | {
        "gripper first result": Figure(0.0, "MAV_RESULT"),
        "gripper last result": Figure(0.0, "MAV_RESULT"),
        "gripper answers": Figure(0.0, "s", allowance=0.05),
        "gripper moves": Figure(0.01, "s", allowance=0.05),
        "gripper speaks": Figure(0.55, "s"),
        "armable": Figure(41.7, "s"),
        "take-off": Figure(7.3, "s"),
        "estimate position": Figure(0.005, "m", allowance=0.02),
        "estimate velocity": Figure(0.005, "m/s", allowance=0.02),
        "estimate height": Figure(0.002, "m", allowance=0.02),
        "push 50 %": Figure(0.29, "s"),
        "push 90 %": Figure(0.49, "s"),
        "push 1 s": Figure(2.45, "m/s"),
        "push 2 s": Figure(5.31, "m/s"),
        "square wave": Figure(7.4, "m/s"),
        "drag": Figure(-0.016, "1/s", allowance=0.05),
        "cruise": Figure(2.06, "m/s"),
        "cruise begins": Figure(0.28, "s", allowance=0.07),  # ours 0.34
        "cruise rises": Figure(0.66, "s", tolerance=0.2),  # ours is quicker by more than 15 %
        "slow stop way": Figure(2.83, "m"),
        "slow stop peak": Figure(2.57, "m/s"),
        "slow stop brakes": Figure(0.69, "s"),
        "fast stop way": Figure(7.6, "m"),
        "fast stop peak": Figure(4.48, "m/s"),
        "fast stop brakes": Figure(1.13, "s"),
        "hold sinks": Figure(2.44, "m/s"),
        "landing": Figure(12.6, "s"),
        "mode after landing": Figure(2.0, ""),  # the one for landing
    },
    # Four runs at 1 and 4 times real time, 1 to 4 flights of each. Its estimate strays, and the
    # vehicle with it: allowances are what it varies by itself from flight to flight.
    "px4": _unasked("px4") | {
        "gripper first result": Figure(5.0, "MAV_RESULT"),
        "gripper last result": Figure(0.0, "MAV_RESULT"),
        "gripper answers": Figure(3.1, "s"),
        "armable": Figure(4.1, "s"),
        "take-off": Figure(6.4, "s"),
        "estimate position": Figure(0.27, "m", tolerance=0.4),  # 0.26 to 0.40
        "estimate velocity": Figure(0.22, "m/s", tolerance=0.3),  # 0.22 to 0.29
        "estimate height": Figure(0.07, "m", allowance=0.05),  # 0.07 to 0.12
        "push 50 %": Figure(0.15, "s", allowance=0.05),  # 0.13 to 0.20
        "push 90 %": Figure(0.26, "s", allowance=0.05),  # 0.23 to 0.28
        "push 1 s": Figure(1.6, "m/s", allowance=0.35),  # 1.25 to 1.95
        "push 2 s": Figure(2.4, "m/s", allowance=0.6),  # 1.71 to 2.97
        "square wave": Figure(0.84, "m/s", allowance=0.4),  # 0.60 to 1.41
        "drag": Figure(0.87, "1/s", allowance=0.4),  # 0.54 to 1.65
        "cruise": Figure(1.6, "m/s"),
        "cruise begins": Figure(0.13, "s", allowance=0.15),  # less than 0 to 0.27
        "cruise rises": Figure(1.9, "s", allowance=0.6),  # 1.3 to 2.6
        "slow stop way": Figure(1.1, "m", allowance=0.25),  # 0.92 to 1.33
        "slow stop peak": Figure(1.6, "m/s"),
        "slow stop brakes": Figure(0.14, "s", allowance=0.08),  # 0.06 to 0.16
        "fast stop way": Figure(3.5, "m", allowance=0.7),  # 3.3 to 4.2
        "fast stop peak": Figure(2.67, "m/s"),
        "fast stop brakes": Figure(0.8, "s"),
        "hold sinks": Figure(0.0, "m/s", allowance=0.15),
        "landing": Figure(16.2, "s", allowance=4.0),  # 15.9 to 20.1
        "mode after landing": Figure(1.0, ""),  # the one for setpoints
    },
}  # fmt: skip
"""By autopilot and row; `iolspi_ros/bench/measuring.py` says how each row is flown."""
