"""What can be set about a flight, beside the envelope and the time-outs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting


@dataclass(frozen=True)
class FlightSettings(Settings):
    """Where, how fast and how often."""

    height: float = setting(5.0, "above the take-off point [m]", low=0.5, high=120.0)
    heading: float = setting(
        0.0, "direction of the task's +x, counter-clockwise from east [rad]", low=-7.0, high=7.0
    )
    origin: tuple[float, ...] = setting(
        (0.0, 0.0), "east and north of the task's origin, from the autopilot's [m]"
    )
    rate: float = setting(50.0, "setpoints a second of vehicle time", low=5.0, high=400.0)
    setpoints: str = setting(
        "acceleration", "an action is flown as an acceleration, or summed up as a velocity",
        choices=("acceleration", "velocity"),
    )  # fmt: skip
    release: str = setting(
        "auto", "how the load is let go; auto for what the autopilot's profile says",
        choices=("auto", "gripper", "servo", "actuator"),
    )  # fmt: skip
    servo: int = setting(9, "release by servo: its number", low=1, high=16)
    servo_open: float = setting(1100.0, "so wide a pulse opens it [µs]", low=500.0, high=2500.0)
    servo_shut: float = setting(1900.0, "and shuts it [µs]", low=500.0, high=2500.0)
    actuator: int = setting(1, "release by actuator: its number in the first set", low=1, high=6)
    actuator_open: float = setting(1.0, "this value opens it", low=-1.0, high=1.0)
    actuator_shut: float = setting(-1.0, "and shuts it", low=-1.0, high=1.0)
    test_release: bool = setting(
        True, "open and shut it once before the flight, disarmed on the ground, and look"
    )
    load_source: str = setting(
        "feed", "the load's position from a system of its own, or estimated from accelerations",
        choices=("feed", "estimate"),
    )  # fmt: skip
    load_share: float = setting(
        0.0, "mass of the load over the vehicle's: its accelerometer then tells of the swing; "
        "0 where none hangs there, as in a simulator without a load", low=0.0, high=1.0,
    )  # fmt: skip
    order: str = setting(
        "random", "initial positions drawn at random, or swept one after the other",
        choices=("random", "sweep"),
    )  # fmt: skip
    settle_time: float = setting(
        0.5, "so long near the initial position, at rest, before an episode [s]", low=0.0, high=60.0
    )
    settle_swing: float = setting(
        0.08, "swing that counts as at rest, without noise [rad]", low=0.001, high=1.5
    )
    settle_timeout: float = setting(
        30.0, "another start is flown to when one is not settled at for so long [s]",
        low=5.0, high=600.0,
    )  # fmt: skip
    real_time_factor: float = setting(
        1.0, "vehicle seconds per second: 1.0 for all that flies, more for a faster simulator",
        low=0.0, high=100.0, low_open=True,
    )  # fmt: skip
    seed: int = setting(0, "of initial positions", low=0)
    episodes: int = setting(0, "land after so many episodes; 0 for never", low=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.origin) != 2 or not all(map(math.isfinite, self.origin)):
            raise InputError(
                f"origin is {list(self.origin)}; allowed: east and north [m], two finite numbers"
            )


@dataclass(frozen=True)
class LinkSettings(Settings):
    """Where the autopilot is, and how to speak with it."""

    url: str = setting(
        "udpin:127.0.0.1:14540",
        "udpin:ADDRESS:PORT (listen), udpout:ADDRESS:PORT (call), tcp:ADDRESS:PORT, "
        "serial:DEVICE:BAUD, or what mavros and MAVSDK call these",
    )
    autopilot: str = setting(
        "auto", "whom to expect there; auto for whoever it says that it is",
        choices=("auto", "px4", "ardupilot", "paparazzi"),
    )  # fmt: skip
    system: int = setting(1, "MAVLink system id of the vehicle", low=1, high=255)
    load_system: int = setting(2, "of the load, for load_source feed", low=1, high=255)
    signing_key: str = setting(
        "", "file with the key for signing; with it nothing unsigned is taken; empty for none"
    )
    log: str = setting("", "a .tlog of all that is said; empty for none")
    patience: float = setting(60.0, "give up the preflight after so long [s]", low=1.0, high=3600.0)
