"""Settings dataclasses as ROS parameters: declared, read, checked and changed."""

from __future__ import annotations

import dataclasses
import difflib
import math
import typing
from typing import Any, TypeVar

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


def declare(node: Node, cls: type[Chosen], changeable: tuple[str, ...] = ()) -> Chosen:
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
        descriptor = _descriptor(field, hints[field.name], field.name not in changeable)
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        given = node._parameter_overrides.get(field.name)  # its value, for the message
        try:
            node.declare_parameter(field.name, default, descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException):
            value = given.value if given is not None else default
            wanted = _type_name(hints[field.name])
            raise InputError(
                f"parameter {field.name} is {value!r}; allowed: {wanted}"
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
        value = node.get_parameter(field.name).value
        values[field.name] = tuple(value) if isinstance(field.default, tuple) else value
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


def warn_unknown(node: Node) -> None:
    """Name given parameters that the node does not have: most are misspelt."""
    known = [name for name in node._parameters if not name.startswith("qos_overrides")]
    for name in node._parameter_overrides:
        if name in known or name.startswith("qos_overrides"):
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
