"""The safety pilot's joystick: a button that lets the learner fly, and one that takes over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from iolspi_ros.settings import Settings, setting


@dataclass(frozen=True)
class SafetyPilotSettings(Settings):
    """Which parts of the joystick the bridge listens to."""

    deadman_button: int = setting(
        -1, "the learner flies only while this button is held; -1 for none", low=-1
    )
    takeover_button: int = setting(
        -1, "a person flies while this button is held; -1 for none", low=-1
    )
    takeover_axis: int = setting(0, "axis of the stick that then gives the speed", low=0)
    takeover_inverted: bool = setting(True, "whether the axis' positive end (left) is backwards")
    takeover_left_axis: int = setting(
        -1, "of a flight in two axes: axis of the stick that gives the speed in y, its positive "
        "end to +y; -1 for none", low=-1,
    )  # fmt: skip


class SafetyPilot(NamedTuple):
    """What a person does who looks after a flight.

    Attributes
    ----------
    deadman : bool
        Lets the learner fly.
    stick : (float, float) or None
        Along x and y, each -1 to 1, while the person flies.
    paused : bool
        Has asked to wait.
    """

    deadman: bool = True
    stick: tuple[float, float] | None = None
    paused: bool = False


def read_joystick(
    settings: SafetyPilotSettings, buttons: Sequence[int], axes: Sequence[float], *, fresh: bool
) -> SafetyPilot:
    """What the person at a joystick does.

    A stick that falls silent holds no deadman's button; who flew with it keeps the vehicle, at
    rest: nothing goes on by itself when a person's link is lost.

    Parameters
    ----------
    settings : SafetyPilotSettings
    buttons, axes : sequence
        Of the latest message; empty when there was none.
    fresh : bool
        Whether it is not too old.
    """

    def held(button: int) -> bool:
        return 0 <= button < len(buttons) and bool(buttons[button])

    deadman = settings.deadman_button < 0 or (fresh and held(settings.deadman_button))
    if not held(settings.takeover_button):
        return SafetyPilot(deadman, None)

    def deflection(axis: int) -> float:
        value = float(axes[axis]) if 0 <= axis < len(axes) and fresh else 0.0
        return max(-1.0, min(value, 1.0)) if value == value else 0.0  # NaN says nothing

    ahead = deflection(settings.takeover_axis) * (-1.0 if settings.takeover_inverted else 1.0)
    return SafetyPilot(deadman, (ahead, deflection(settings.takeover_left_axis)))
