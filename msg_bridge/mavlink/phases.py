"""The phases of a flight, and what the phase machine decides."""

from __future__ import annotations

from enum import Enum, IntEnum, auto
from typing import Literal, NamedTuple

from iolspi_ros.core.samples import Observation


class Phase(IntEnum):
    """Where a flight is. The numbers are those on the topic `authority`."""

    IDLE = 0
    """Not begun."""
    ARMING = 1
    """Getting the mode, and the motors started."""
    TAKEOFF = 2
    TRANSIT = 3
    """To the next initial condition, and settling there."""
    EPISODE = 4
    RELEASE = 5
    """The load was let go; where it lands is the episode's end."""
    BRAKE = 6
    RELOAD = 7
    LANDING = 8
    DOWN = 9
    """On the ground, or not ours any more: a person decides how it goes on."""


class Command(Enum):
    """What is to be done, without a number."""

    REQUEST_CONTROL = auto()
    """Ask for the mode in which setpoints are obeyed."""
    REQUEST_LANDING = auto()
    """Ask for the mode in which the autopilot lands."""
    ARM = auto()
    TAKE_OFF = auto()
    """Ask for a climb, where the autopilot climbs by command."""
    SET_GROUND = auto()
    """The vehicle stands: heights count from here."""
    START_EPISODE = auto()
    RELEASE = auto()
    RELOAD = auto()


Level = Literal["info", "warning", "delay"]


class Enter(NamedTuple):
    """A phase begins."""

    phase: Phase


class Tell(NamedTuple):
    """Words for people; of a delay only now and then."""

    level: Level
    text: str


class Show(NamedTuple):
    """An observation for whoever acts."""

    observation: Observation


Decision = Command | Enter | Tell | Show
