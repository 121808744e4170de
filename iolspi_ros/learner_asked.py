"""What a learner on the graph is like: asked for its parameters, and made again of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from iolspi_ros import registry
from iolspi_ros.core.learner import GROUP, Learner, learner_class
from iolspi_ros.errors import InputError
from iolspi_ros.settings import from_mapping
from iolspi_ros.task import TaskDescription

AGAIN = 3.0
"""Seconds after which a learner that has not answered is asked again."""


class LearnerAsked:
    """Asks a learner for its parameters, and makes another one of the same settings.

    Parameters
    ----------
    node : rclpy.node.Node
    task : TaskDescription
    ready : callable
        Called with the learner when there is one.
    """

    def __init__(self, node: Node, task: TaskDescription, ready: Callable[[Learner], None]) -> None:
        self._node, self._task, self._ready = node, task, ready
        self._client = node.create_client(GetParameters, "learner/get_parameters")
        self._asked = -AGAIN
        self._answered = False

    def ask(self) -> None:
        """Ask, if there is a learner and it has not answered; answers may be lost at first."""
        now = time.monotonic()
        waits = self._answered or now - self._asked < AGAIN
        if waits or not self._client.service_is_ready():
            return
        self._asked = now
        self._get(["learner"], self._of_class)

    def _get(self, names: list[str], then: Callable[[dict[str, Any]], None]) -> None:
        """Ask for parameters one by one: asked for together, one without a value hides all."""
        found: dict[str, Any] = {}
        left = set(names)

        def answered(future: Any, name: str) -> None:
            values = future.result().values
            found[name] = parameter_value_to_python(values[0]) if values else None
            left.discard(name)
            if not left:
                then(found)

        for name in names:
            future = self._client.call_async(GetParameters.Request(names=[name]))
            future.add_done_callback(lambda future, name=name: answered(future, name))

    def _of_class(self, values: dict[str, Any]) -> None:
        name = str(values["learner"])
        if name not in registry.names(GROUP):  # never import what somebody else names
            self._answered = True
            self._node.get_logger().info(
                f"{name} is no registered learner: its policy is not shown"
            )
            return
        kind = learner_class(name)
        names = list(kind.Settings.__dataclass_fields__)
        self._get(names, lambda values: self._make(kind, values))

    def _make(self, kind: type[Learner], values: dict[str, Any]) -> None:
        self._answered = True
        given = {
            name: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
            for name, value in values.items() if value is not None
        }  # fmt: skip
        try:
            settings = from_mapping(kind.Settings, given, "the learner's parameters")
            self._ready(kind(self._task, settings, np.random.default_rng(0)))
        except InputError as error:
            self._node.get_logger().warning(f"the policy is not shown: {error}")

    def close(self) -> None:
        """Ask no more."""
        self._node.destroy_client(self._client)
