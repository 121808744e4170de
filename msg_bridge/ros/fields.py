"""Fields of messages by their paths, as `pose.pose.position.x`, `data[3]` or `position[shaft]`."""

from __future__ import annotations

import importlib
import math
import re
from typing import Any

from iolspi_ros.errors import InputError

_TYPE = re.compile(r"([a-z][a-z0-9_]*)/(msg|srv)/([A-Z][A-Za-z0-9]*)")
_STEP = re.compile(r"\.?([A-Za-z][A-Za-z0-9_]*)|\[([^\[\]]+)\]")


def message_type(name: Any, what: str, kind: str = "msg") -> Any:
    """The class of a message or service type, such as "geometry_msgs/msg/Twist".

    Raises
    ------
    InputError
        When there is none, or its package is not installed.
    """
    found = _TYPE.fullmatch(name) if isinstance(name, str) else None
    if found is None or found[2] != kind:
        raise InputError(f"{what} is {name!r}; allowed: a type such as {_EXAMPLES[kind]}")
    try:
        return getattr(importlib.import_module(f"{found[1]}.{kind}"), found[3])
    except (ImportError, AttributeError):
        raise InputError(
            f"{what} is {name!r}, which is not installed; allowed: a type of a package that is "
            "there"
        ) from None


_EXAMPLES = {"msg": "geometry_msgs/msg/Twist", "srv": "std_srvs/srv/Empty"}


class Path:
    """A way into messages of a type.

    Parameters
    ----------
    text : str
    kind : type
        Of the messages.
    what : str
        What it is, for messages.

    Raises
    ------
    InputError
        When such messages have no such field.
    """

    def __init__(self, text: Any, kind: Any, what: str) -> None:
        self.text, self._what = text, what
        self._steps = self._parse(text)
        self._check(kind())

    def _parse(self, text: Any) -> list[str | int | None]:
        if not isinstance(text, str) or not text:
            raise InputError(f"{self._what} is {text!r}; allowed: a path such as pose.position.x")
        steps: list[str | int | None] = []
        self._keys: dict[int, str] = {}
        place = 0
        while place < len(text):
            found = _STEP.match(text, place)
            if found is None:
                raise InputError(
                    f"{self._what} is {text!r}; allowed: names, with [3] or [name] behind lists"
                )
            if found[1]:
                steps.append(found[1])
            elif found[2].isdecimal():
                steps.append(int(found[2]))
            else:
                self._keys[len(steps)] = found[2]
                steps.append(None)
            place = found.end()
        return steps

    def _check(self, message: Any) -> None:
        """Walk a fresh message as far as it goes: its lists are empty."""
        part = message
        for number, step in enumerate(self._steps):
            if not isinstance(step, str):
                if number in self._keys and not hasattr(message, "name"):
                    raise InputError(
                        f"{self._what} is {self.text!r}, and {type(message).__name__} has no list "
                        "`name` to find it by; allowed: a number in brackets"
                    )
                return
            known: dict[str, str] = getattr(part, "get_fields_and_field_types", dict)()
            if step not in known:
                raise InputError(
                    f"{self._what} is {self.text!r}, and {type(part).__name__} has no field "
                    f"{step}; allowed: {', '.join(known) or 'nothing below it'}"
                )
            part = getattr(part, step)

    def get(self, message: Any) -> Any:
        """What stands there.

        Raises
        ------
        InputError
            When a list of this message is too short, or lacks the name.
        """
        part = message
        for number, step in enumerate(self._steps):
            if isinstance(step, str):
                part = getattr(part, step)
                continue
            place = step
            try:
                if place is None:
                    place = list(message.name).index(self._keys[number])
                part = part[place]
            except (IndexError, ValueError):
                raise InputError(
                    f"{self._what}: a message has no {self.text} (its list has {len(part)} entries)"
                ) from None
        return part

    def number(self, message: Any) -> float:
        """What stands there as a number.

        Raises
        ------
        InputError
            When it is none.
        """
        value = self.get(message)
        try:
            return float(value)
        except (TypeError, ValueError):
            raise InputError(
                f"{self._what} is {self.text}, a {type(value).__name__}; allowed: a number"
            ) from None

    def set(self, message: Any, value: Any) -> None:
        """Write a value there; lists grow as they need to.

        Raises
        ------
        TypeError
            When the field takes no such value.
        """
        part, steps = message, self._steps
        for number, step in enumerate(steps[:-1]):
            part = self._into(part, number, step)
        last = steps[-1]
        if isinstance(last, str):
            setattr(part, last, _like(getattr(part, last), value))
            return
        if last is None:
            raise TypeError("a list that is written to has its entries by number")
        while len(part) <= last:
            part.append(0.0)
        part[last] = float(value)

    def _into(self, part: Any, number: int, step: str | int | None) -> Any:
        """One step of the way; entries of a list of messages are made."""
        if isinstance(step, str):
            following = self._steps[number + 1]
            if isinstance(following, int) and number + 2 < len(self._steps):
                _fill(part, step, following)
            return getattr(part, step)
        if step is None:
            raise TypeError("a list that is written to has its entries by number")
        return part[step]


def _fill(message: Any, name: str, place: int) -> None:
    """Make a list of messages long enough."""
    kind = message.get_fields_and_field_types()[name]
    found = re.fullmatch(r"sequence<([a-z0-9_]+)/([A-Za-z0-9]+)(, \d+)?>", kind)
    if found is None:
        raise TypeError(f"{name} is {kind}, no list of messages")
    entry = message_type(f"{found[1]}/msg/{found[2]}", name)
    entries = getattr(message, name)
    while len(entries) <= place:
        entries.append(entry())


def _like(before: Any, value: Any) -> Any:
    """A value as the field has it: rclpy does not check."""
    if isinstance(value, str | list):
        if type(before) is not type(value):
            raise TypeError(f"it takes a {type(before).__name__}")
        return value
    if isinstance(before, bool | int):
        return type(before)(round(value))
    if not isinstance(before, float):
        raise TypeError(f"it takes a {type(before).__name__}, no number")
    return float(value)


def yaw(orientation: Any) -> float:
    """Heading of a geometry_msgs/Quaternion, counter-clockwise around z [rad]."""
    q = orientation
    return math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
