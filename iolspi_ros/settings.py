"""Settings as dataclasses: each default, range, unit and description stands once, in its field."""

from __future__ import annotations

import dataclasses
import math
import typing
from typing import Any

from iolspi_ros.errors import InputError, check_choice, check_range


def setting(
    default: Any,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    low_open: bool = False,
    high_open: bool = False,
    choices: tuple[str, ...] = (),
    endless: bool = False,
) -> Any:
    """Declare a dataclass field with what it may be and what it means; infinite if `endless`."""
    metadata = {
        "description": description,
        "low": low,
        "high": high,
        "low_open": low_open,
        "high_open": high_open,
        "choices": choices,
        "endless": endless,
    }
    return dataclasses.field(default=default, metadata=metadata)


def replaced(cls: type[Any], name: str, default: Any) -> Any:
    """The same field of another dataclass, with another default."""
    field = next(field for field in dataclasses.fields(cls) if field.name == name)
    return dataclasses.field(default=default, metadata=field.metadata)


class Settings:
    """Base of every settings dataclass: checks its fields when made."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            check_field(field, getattr(self, field.name))


def check_field(field: dataclasses.Field[Any], value: Any) -> None:
    """Raise unless `value` is what the field's declaration allows.

    Raises
    ------
    InputError
        Naming the field, the value and what is allowed.
    """
    rule = field.metadata
    if rule.get("choices"):
        check_choice(field.name, value, rule["choices"])
    low, high = rule.get("low"), rule.get("high")
    numbers = value if isinstance(value, tuple) else (value,)
    for number in numbers:
        if not isinstance(number, float) or math.isfinite(number):
            continue
        if math.isnan(number) or not rule.get("endless"):
            what = f"{rule['description']}: " if "description" in rule else ""
            raise InputError(f"{what}{field.name} is {value!r}; allowed: finite numbers")
    if low is None and high is None:
        return
    for number in numbers:
        check_range(
            field.name,
            number,
            float("-inf") if low is None else low,
            float("inf") if high is None else high,
            low_open=rule["low_open"],
            high_open=rule["high_open"],
        )


def from_mapping(cls: type[Any], values: dict[str, Any], where: str) -> Any:
    """Make a settings dataclass from what a YAML file holds.

    Keys that the class does not have are left to others. An integer is not taken for a
    float, nor the reverse: ROS parameters are as strict, and one file serves both.

    Raises
    ------
    InputError
        Naming the file's place, the key, the value and what is allowed.
    """
    hints = typing.get_type_hints(cls)
    chosen: dict[str, Any] = {}
    for field in dataclasses.fields(cls):
        if field.name in values:
            chosen[field.name] = _typed(values[field.name], hints[field.name], field.name, where)
    try:
        return cls(**chosen)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def element_type(hint: Any) -> type:
    """Type of the entries of a tuple hint, or the hint itself."""
    arguments = typing.get_args(hint)
    return arguments[0] if arguments else hint


def _typed(value: Any, hint: Any, name: str, where: str) -> Any:
    kind = element_type(hint)
    many = typing.get_origin(hint) is tuple
    entries = value if isinstance(value, list) else [value]
    if many != isinstance(value, list) or any(type(entry) is not kind for entry in entries):
        wanted = f"a list of {kind.__name__}" if many else f"a {kind.__name__}"
        hint_text = " (write 1.0, not 1)" if kind is float else ""
        raise InputError(f"{where}: {name} is {value!r}; allowed: {wanted}{hint_text}")
    return tuple(value) if many else value
