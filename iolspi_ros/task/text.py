"""Task descriptions as YAML or JSON, checked field by field."""

from __future__ import annotations

import json
import typing
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from iolspi_ros.errors import InputError
from iolspi_ros.task import plain
from iolspi_ros.task.description import Action, Ending, TaskDescription, Variable
from iolspi_ros.task.plain import parse
from iolspi_ros.task.symmetry import Symmetry

_HUGE = 1e300
_PARTS: dict[tuple[type[Any], str], type[Any]] = {
    (TaskDescription, "variables"): Variable, (TaskDescription, "actions"): Action,
    (TaskDescription, "endings"): Ending, (TaskDescription, "symmetries"): Symmetry,
}  # fmt: skip
"""Fields that are lists of parts, by whose they are."""
_WORDS: dict[Any, str] = {
    str: "a text", float: "a number", int: "an integer", bool: "true or false",
    tuple[float, ...]: "a list of numbers", tuple[str, ...]: "a list of texts",
    tuple[int, ...]: "a list of integers",
    float | None: "a number",
}  # fmt: skip


def dump(task: TaskDescription) -> str:
    """JSON of a description, which is YAML too; what has its default is left out."""
    return json.dumps(_plain(task), ensure_ascii=False, allow_nan=False)


def _plain(part: Any) -> dict[str, Any]:
    """Fields that differ from their defaults; a default limit is infinite, so none is written."""
    found: dict[str, Any] = {}
    for field in fields(part):
        value = getattr(part, field.name)
        if field.default is MISSING or value != field.default:
            found[field.name] = (
                list(map(_plain, value)) if (type(part), field.name) in _PARTS
                else list(value) if isinstance(value, tuple) else value
            )  # fmt: skip
    return found


def load(text: str, where: str) -> TaskDescription:
    """The description in a YAML or JSON text.

    Parameters
    ----------
    text : str
    where : str
        Where it comes from, for messages.

    Raises
    ------
    InputError
        Naming the place, the field, its value and what is allowed.
    """
    return make(parse(text, where), where)


def make(content: Any, where: str) -> TaskDescription:
    """The description that plain values, as of YAML, make.

    Raises
    ------
    InputError
        Naming the place, the field, its value and what is allowed.
    """
    try:
        description: TaskDescription = _make(TaskDescription, content, "the task")
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return description


def read(path: Path) -> TaskDescription:
    """The description in a file.

    Raises
    ------
    InputError
        When it cannot be read, or is none.
    """
    return make(read_plain(path), str(path))


def read_plain(path: Path) -> Any:
    """What a YAML or JSON file holds.

    Raises
    ------
    InputError
        When it cannot be read, or is neither.
    """
    try:
        return plain.read(path, "a YAML file")
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; allowed: a YAML file") from None


def _make(cls: type[Any], content: Any, what: str) -> Any:
    """A part of a description from plain values."""
    if not isinstance(content, Mapping):
        raise InputError(f"{what} is {_short(content)}; allowed: names and values")
    hints = typing.get_type_hints(cls)
    known = {field.name: field for field in fields(cls)}
    unknown = [str(name) for name in content if name not in known]
    if unknown:
        raise InputError(f"{what} has {unknown[0]!r}; allowed: {', '.join(known)}")
    lacking = [n for n, field in known.items() if field.default is MISSING and n not in content]
    if lacking:
        raise InputError(f"{what} has no {lacking[0]}; it must have one")
    values = {}
    for name, value in content.items():
        if (cls, name) in _PARTS:
            values[name] = _make_all(_PARTS[cls, name], value, name)
        else:
            values[name] = _typed(value, hints[name], f"{name} of {what}")
    return cls(**values)


def _make_all(cls: type[Any], content: Any, name: str) -> tuple[Any, ...]:
    if not isinstance(content, list):
        raise InputError(f"{name} is {_short(content)}; allowed: a list")
    singular = cls.__name__.lower()
    parts = []
    for number, entry in enumerate(content):
        named = entry.get("name") if isinstance(entry, Mapping) else None
        parts.append(_make(cls, entry, f"{singular} {named if named else number}"))
    return tuple(parts)


def _typed(value: Any, hint: Any, what: str) -> Any:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if hint is str and isinstance(value, str):
        return value
    if hint is bool and isinstance(value, bool):
        return value
    if hint is int and number and abs(value) < _HUGE and value == int(value):
        return int(value)
    if hint in (float, float | None) and number and abs(value) < _HUGE:
        return float(value)
    if hint == tuple[float, ...]:
        if number:
            return (_typed(value, float, what),)
        if isinstance(value, list):
            return tuple(_typed(entry, float, what) for entry in value)
    if hint in (tuple[str, ...], tuple[int, ...]) and isinstance(value, list):
        kind = typing.get_args(hint)[0]
        return tuple(_typed(entry, kind, what) for entry in value)
    raise InputError(f"{what} is {_short(value)}; allowed: {_WORDS[hint]}")


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 60 else f"{text[:57]}..."
