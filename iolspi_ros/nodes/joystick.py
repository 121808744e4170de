"""A joystick as a source of actions: what its parts mean, and when it can be trusted. No ROS."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Action

SLACK = 0.01
"""How far beyond 1 a driver may say that an axis is."""


@dataclass(frozen=True)
class JoystickSettings(Settings):
    """What the parts of the joystick mean."""

    joy_axis: int = setting(
        0, "axis of the stick, from its first action to its last; -1 for none", low=-1
    )
    joy_axes: tuple[int, ...] = setting(
        (-1,),
        "instead of joy_axis: an axis for each number of the actions' values; the action that "
        "comes nearest is flown; -1 for a number without one",
        low=-1,
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
        for axis in self.used:
            low, center, high = self._ends(axis)
            if not (low <= center <= high and low < high):
                raise InputError(
                    f"joy_low, joy_center and joy_high of axis {axis} are {low:g}, "
                    f"{center:g} and {high:g}; allowed: in this order, and the ends apart"
                )

    @property
    def by_value(self) -> bool:
        """Whether the stick says what an action is worth, and not which of them in a row it is."""
        return any(axis >= 0 for axis in self.joy_axes)

    @property
    def used(self) -> tuple[int, ...]:
        """Axes that mean something."""
        axes = self.joy_axes if self.by_value else (self.joy_axis,)
        return tuple(axis for axis in axes if axis >= 0)

    def _ends(self, axis: int) -> tuple[float, float, float]:
        return _of(axis, self.joy_low), _of(axis, self.joy_center), _of(axis, self.joy_high)

    def dead_zone(self, axis: int) -> float:
        """Of an axis."""
        return _of(axis, self.joy_dead_zone)

    def travel(self, axis: int, raw: float) -> float:
        """Where an axis is, -1 to 1, 0 in its dead zone."""
        low, center, high = self._ends(axis)
        span = high - center if raw > center else center - low
        value = min(max((raw - center) / span, -1.0), 1.0) if span else 0.0
        return 0.0 if abs(value) <= self.dead_zone(axis) else value


def _of(axis: int, values: tuple[float, ...]) -> float:
    return values[min(axis, len(values) - 1)] if values else math.nan


class Joystick:
    """Turns what a stick says into an action.

    Parameters
    ----------
    settings : JoystickSettings
    actions : sequence of Action
    neutral : int
        The one for a stick that is let go or silent.
    needed : sequence of int
        Buttons that it must have besides those of actions.
    clock : callable
        Seconds on a steady clock.

    Attributes
    ----------
    fault : str
        What is used and not there, in words; empty for nothing.
    dropped, others : int
        Messages that were no positions of a stick; that were of another one.

    Raises
    ------
    InputError
        When a button is an action that there is not, or an axis a number that no action has.
    """

    def __init__(
        self, settings: JoystickSettings, actions: Sequence[Action], neutral: int,
        needed: Sequence[int] = (), clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        n_actions = len(actions)
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
        self._values = self._by_value(actions) if settings.by_value else {}
        self._axes, self._buttons = dict.fromkeys(settings.used, 0.0), [0]
        self._rest: tuple[dict[int, float], list[int]] = (self._axes, [])
        self._time = -math.inf
        self.fault = ""
        self._name = ""
        self.dropped = self.others = 0

    def _by_value(self, actions: Sequence[Action]) -> dict[int, tuple[float, ...]]:
        """What each action on the stick asks for, as shares of the most that any does."""
        numbers = len(self._settings.joy_axes)
        found = {
            n: action.value
            for n, action in enumerate(actions[: self._on_axis])
            if len(action.value) == numbers
        }
        if not found or self._neutral not in found:
            sizes = sorted({len(action.value) for action in actions})
            raise InputError(
                f"parameter joy_axes has {numbers} entries, and the actions' values have "
                f"{', '.join(map(str, sizes))} numbers; allowed: as many, the neutral action on "
                "the stick"
            )
        most = [max(map(abs, column)) or 1.0 for column in zip(*found.values(), strict=True)]
        return {
            n: tuple(v / m for v, m in zip(value, most, strict=True)) for n, value in found.items()
        }

    def take(self, axes: Sequence[float], buttons: Sequence[int], name: str = "") -> None:
        """Remember where the stick is, if that is what this says.

        Of several sticks the one that is heard first counts, by its name, until it is silent.
        """
        if name != self._name and not self.silent:
            self.others += 1
            return
        self._name = name
        self.fault = self._lacking(len(axes), len(buttons))
        if self.fault:
            self._time = -math.inf
            return
        values = {axis: float(axes[axis]) for axis in self._settings.used}
        if not all(abs(value) <= 1.0 + SLACK for value in values.values()):  # nor is NaN
            self.dropped += 1
            return
        self._axes, self._buttons = values, [int(bool(button)) for button in buttons]
        self._time = self._clock()
        pairs = zip(self._rest[1], self._buttons, strict=False)
        self._rest = (self._rest[0], [min(pair) for pair in pairs])  # may be pressed anew

    def _lacking(self, axes: int, buttons: int) -> str:
        """What is used and the device does not have, in words."""
        if (last := max(self._settings.used, default=-1)) >= axes:
            there = f"0 to {axes - 1}" if axes else "a device with an axis"
            return f"the joystick has no axis {last}; allowed: {there}"
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
        self._rest = (self._axes, self._buttons)

    @property
    def moved(self) -> bool:
        """Whether it is elsewhere than at rest: its axis, or a button pressed that was not."""
        if self.silent:
            return False
        axes, buttons = self._rest
        pressed = any(now > then for now, then in zip(self._buttons, buttons, strict=False))
        return pressed or any(
            abs(value - axes[axis]) > max(self._settings.dead_zone(axis), SLACK)
            for axis, value in self._axes.items()
        )

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
        s = self._settings
        where = {axis: s.travel(axis, value) for axis, value in self._axes.items()}
        if self._values:
            wanted = [where.get(axis, 0.0) for axis in s.joy_axes]
            # Of two that are as near the one that does less, as a release is no acceleration.
            return min(
                self._values,
                key=lambda n: (round(math.dist(wanted, self._values[n]), 9), n != self._neutral),
            )
        value = where.get(s.joy_axis, 0.0)
        if s.joy_inverted:
            value = -value
        return round((value + 1.0) / 2.0 * (self._on_axis - 1))
