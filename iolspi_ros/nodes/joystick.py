"""A joystick as a source of actions: what its parts mean, and when it can be trusted. No ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting

SLACK = 0.01
"""How far beyond 1 a driver may say that an axis is."""


@dataclass(frozen=True)
class JoystickSettings(Settings):
    """What the parts of the joystick mean."""

    joy_axis: int = setting(
        0, "axis of the stick, from its first action to its last; -1 for none", low=-1
    )
    joy_actions: int = setting(
        0, "how many of the actions, from the first, are on the axis; 0 for all", low=0
    )
    joy_inverted: bool = setting(
        True, "whether the positive end of the axis (left, in most drivers) is the first action"
    )
    joy_buttons: tuple[int, ...] = setting(
        (-1,), "action of each button while it is held; -1 for none", low=-1
    )
    joy_timeout: float = setting(
        0.5, "neutral when the stick was not heard for this long [s]", low=0.01, high=3600.0
    )
    joy_dead_zone: tuple[float, ...] = setting(
        (0.1,), "of each axis: part of its travel that is its centre; the last for those behind",
        low=0.0, high=1.0, high_open=True,
    )  # fmt: skip
    joy_low: tuple[float, ...] = setting(
        (-1.0,), "of each axis: where one end is; the last for those behind", low=-1.0, high=1.0
    )
    joy_center: tuple[float, ...] = setting(
        (0.0,), "of each axis: where it rests; the last for those behind", low=-1.0, high=1.0
    )
    joy_high: tuple[float, ...] = setting(
        (1.0,), "of each axis: where the other end is; the last for those behind",
        low=-1.0, high=1.0,
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        low, center, high = (
            self._of(one) for one in (self.joy_low, self.joy_center, self.joy_high)
        )
        if not (low <= center <= high and low < high):
            raise InputError(
                f"joy_low, joy_center and joy_high of axis {self.joy_axis} are {low:g}, "
                f"{center:g} and {high:g}; allowed: in this order, and the ends apart"
            )

    def _of(self, values: tuple[float, ...]) -> float:
        return values[min(self.joy_axis, len(values) - 1)] if values else math.nan

    @property
    def dead_zone(self) -> float:
        """Of the axis that is used."""
        return self._of(self.joy_dead_zone)

    def travel(self, raw: float) -> float:
        """Where the axis is, -1 to 1, 0 in its dead zone."""
        low, center, high = (
            self._of(one) for one in (self.joy_low, self.joy_center, self.joy_high)
        )
        span = high - center if raw > center else center - low
        value = min(max((raw - center) / span, -1.0), 1.0) if span else 0.0
        return 0.0 if abs(value) <= self.dead_zone else value


class Joystick:
    """Turns what a stick says into an action.

    Parameters
    ----------
    settings : JoystickSettings
    n_actions, neutral : int
        Number of actions, and the one for a stick that is let go or silent.
    needed : sequence of int
        Buttons that it must have besides those of actions.
    clock : callable
        Seconds on a steady clock.

    Attributes
    ----------
    fault : str
        What is used and not there, in words; empty for nothing.
    dropped : int
        Messages that were no positions of a stick.

    Raises
    ------
    InputError
        When a button is an action that there is not.
    """

    def __init__(
        self, settings: JoystickSettings, n_actions: int, neutral: int,
        needed: Sequence[int] = (), clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        wrong = [action for action in settings.joy_buttons if action >= n_actions]
        if wrong:
            raise InputError(
                f"parameter joy_buttons has {wrong[0]}; allowed: -1, or an action, "
                f"0 to {n_actions - 1}"
            )
        self._settings, self._neutral, self._clock = settings, neutral, clock
        self._on_axis = min(settings.joy_actions or n_actions, n_actions)
        self._button_actions = {
            button: action for button, action in enumerate(settings.joy_buttons) if action >= 0
        }
        self._needed = max([*self._button_actions, *needed], default=-1)
        self._axis, self._buttons = 0.0, [0]
        self._rest: tuple[float, list[int]] = (0.0, [])
        self._time = -math.inf
        self.fault = ""
        self.dropped = 0

    def take(self, axes: Sequence[float], buttons: Sequence[int]) -> None:
        """Remember where the stick is, if that is what this says."""
        axis = self._settings.joy_axis
        self.fault = self._lacking(len(axes), len(buttons))
        if self.fault:
            self._time = -math.inf
            return
        value = float(axes[axis]) if axis >= 0 else 0.0
        if not abs(value) <= 1.0 + SLACK:  # nor is NaN
            self.dropped += 1
            return
        self._axis, self._buttons = value, [int(bool(button)) for button in buttons]
        self._time = self._clock()
        pairs = zip(self._rest[1], self._buttons, strict=False)
        self._rest = (self._rest[0], [min(pair) for pair in pairs])  # may be pressed anew

    def _lacking(self, axes: int, buttons: int) -> str:
        """What is used and the device does not have, in words."""
        if self._settings.joy_axis >= axes:
            there = f"0 to {axes - 1}" if axes else "a device with an axis"
            return f"the joystick has no axis {self._settings.joy_axis}; allowed: {there}"
        if self._needed >= buttons:
            there = f"0 to {buttons - 1}" if buttons else "a device with buttons"
            return f"the joystick has no button {self._needed}; allowed: {there}"
        return ""

    @property
    def silent(self) -> bool:
        """Whether there is none, or nothing was heard of it for too long."""
        return self._clock() - self._time > self._settings.joy_timeout

    def settle(self) -> None:
        """Take the position heard last for the one at rest."""
        self._rest = (self._axis, self._buttons)

    @property
    def moved(self) -> bool:
        """Whether it is elsewhere than at rest: its axis, or a button pressed that was not."""
        if self.silent:
            return False
        axis, buttons = self._rest
        pressed = any(now > then for now, then in zip(self._buttons, buttons, strict=False))
        return pressed or abs(self._axis - axis) > max(self._settings.dead_zone, SLACK)

    def pressed(self, button: int) -> bool:
        """Whether a button is held down now."""
        return not self.silent and 0 <= button < len(self._buttons) and bool(self._buttons[button])

    def action(self) -> int:
        """Action of a held button, else of the axis; neutral when the stick is silent."""
        if self.silent:
            return self._neutral
        for button, action in self._button_actions.items():
            if self._buttons[button]:
                return action
        value = self._settings.travel(self._axis) if self._settings.joy_axis >= 0 else 0.0
        if self._settings.joy_inverted:
            value = -value
        return round((value + 1.0) / 2.0 * (self._on_axis - 1))
