"""The stations of a flight, and the words for them."""

from __future__ import annotations

from enum import IntEnum


class Phase(IntEnum):
    """Where a flight is. The numbers are those on the topic `authority`."""

    IDLE = 0
    """Not begun."""
    GROUND = 1
    """Getting the mode, and the motors started."""
    CLIMB = 2
    FERRY = 3
    """To the next initial condition, and settling there."""
    EPISODE = 4
    FALL = 5
    """The load was let go; where it lands is the episode's end."""
    BRAKE = 6
    RELOAD = 7
    LANDING = 8
    DOWN = 9
    """On the ground, or not ours any more: a person decides how it goes on."""
