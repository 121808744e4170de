"""Settings dataclasses as ROS parameters: declared, read, checked and changed."""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from collections.abc import Collection, Mapping
from typing import Any, Protocol, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from iolspi_ros.errors import InputError
from iolspi_ros.settings import check_field, element_type

Chosen = TypeVar("Chosen")

_INTEGER_LIMIT = 2**62
_LISTS = {
    float: Parameter.Type.DOUBLE_ARRAY,
    int: Parameter.Type.INTEGER_ARRAY,
    bool: Parameter.Type.BOOL_ARRAY,
    str: Parameter.Type.STRING_ARRAY,
}


class GivenNode(Protocol):
    """A node that knows what it was given: `given`, parameters by name."""

    given: Mapping[str, Any]

    def __getattr__(self, name: str) -> Any: ...


def declare(node: GivenNode, cls: type[Chosen], changeable: tuple[str, ...] = ()) -> Chosen:
    """Declare every field of a settings dataclass as a parameter, and read them.

    Parameters
    ----------
    node : rclpy.node.Node
    cls : type
        A dataclass whose fields were made by `setting`.
    changeable : tuple of str
        Fields that may be set while the node runs; the others are read-only.

    Returns
    -------
    instance of `cls`

    Raises
    ------
    InputError
        Naming the parameter, its value and what is allowed.
    """
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        if node.has_parameter(field.name):
            continue  # of another class: one number for both
        descriptor = _descriptor(field, hints[field.name], field.name not in changeable)
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        if default == []:  # of which nobody could tell the type
            default = _LISTS[element_type(hints[field.name])]
        try:
            node.declare_parameter(field.name, default, descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            wanted = _type_name(hints[field.name])
            raise InputError(
                f"parameter {field.name} is {node.given.get(field.name)!r}; allowed: {wanted}"
                f"{_limits(field)} ({field.metadata['description']})"
            ) from None
    return read(node, cls)


def read(node: Node, cls: type[Chosen]) -> Chosen:
    """The settings as the node's parameters are now.

    Raises
    ------
    InputError
        Naming the parameter, its value and what is allowed.
    """
    values = {}
    for field in dataclasses.fields(cls):  # type: ignore[arg-type]
        value = node.get_parameter_or(field.name).value  # None for a list that nobody gave
        values[field.name] = tuple(value or ()) if isinstance(field.default, tuple) else value
    try:
        return cls(**values)
    except InputError as error:
        raise InputError(f"parameter {error}") from None


def check_changes(node: Node, *classes: type[Any]) -> None:
    """Refuse, with the reason, a parameter set at run time to what its field does not allow."""
    rules = {field.name: field for cls in classes for field in dataclasses.fields(cls)}

    def check(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if parameter.name not in rules:
                continue
            try:
                check_field(rules[parameter.name], parameter.value)
            except InputError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def warn_unknown(node: GivenNode, others: Collection[str] = ()) -> None:
    """Name given parameters that the node does not have, nor `others`: most are misspelt."""
    known = node.list_parameters([], 0).names
    for name in node.given:
        if name in known or name in others or name.startswith("qos_overrides"):
            continue
        near = difflib.get_close_matches(name, known, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        node.get_logger().warning(f"parameter {name} is not known here and does nothing{hint}")


def _descriptor(field: dataclasses.Field[Any], hint: Any, read_only: bool) -> ParameterDescriptor:
    rule = field.metadata
    descriptor = ParameterDescriptor(description=rule["description"], read_only=read_only)
    if rule["choices"]:
        descriptor.additional_constraints = "one of: " + ", ".join(rule["choices"])
    low, high = rule["low"], rule["high"]
    if low is None and high is None:
        return descriptor
    if hint is float:
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=-math.inf if low is None else float(low),
                to_value=math.inf if high is None else float(high),
            )
        ]
    elif hint is int:
        descriptor.integer_range = [
            IntegerRange(
                from_value=-_INTEGER_LIMIT if low is None else int(low),
                to_value=_INTEGER_LIMIT if high is None else int(high),
            )
        ]
    return descriptor


def _type_name(hint: Any) -> str:
    kind = element_type(hint)
    name = {float: "a double such as 1.0", int: "an integer", str: "a string", bool: "a bool"}[kind]
    return f"a list of entries, each {name}" if kind is not hint else name


def _limits(field: dataclasses.Field[Any]) -> str:
    rule = field.metadata
    if rule["choices"]:
        return f", one of {', '.join(rule['choices'])}"
    if rule["low"] is None and rule["high"] is None:
        return ""
    low = "-inf" if rule["low"] is None else rule["low"]
    high = "inf" if rule["high"] is None else rule["high"]
    return f" from {low} to {high}"
