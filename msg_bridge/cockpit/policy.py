"""Maps of a learner's policy: from its weights, and from its parameters what those mean."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

from iolspi_ros.core.learner import Learner, learner_class
from iolspi_ros.errors import InputError
from iolspi_ros.settings import from_mapping
from iolspi_ros.task import TaskDescription
from iolspi_ros.task.maps import Limits, map_states

Array = NDArray[np.float64]

POINTS = 41
"""Of a map, each way."""


def policy_map(learner: Learner, weights: Array, limits: Limits) -> dict[str, Any]:
    """Greedy action and its value all over a map, row by row from the lowest y.

    Parameters
    ----------
    learner : Learner
        Of the same settings as that of the weights.
    weights : ndarray
        A snapshot.
    limits : ((x, x), (y, y))
    """
    values = learner.values(map_states(learner.task, limits, POINTS), weights)
    best = values.max(axis=1)
    low, high = float(best.min()), float(best.max())
    shares = (best - low) / (high - low) if high > low else np.zeros_like(best)
    return {
        "points": POINTS, "limits": limits, "low": low, "high": high,
        "action": values.argmax(axis=1).tolist(), "value": np.round(shares, 3).tolist(),
    }  # fmt: skip


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
        self._asked = False

    def ask(self) -> None:
        """Ask, if there is a learner and it was not asked before."""
        if self._asked or not self._client.service_is_ready():
            return
        self._asked = True
        self._get(["learner"], self._of_class)

    def _get(self, names: list[str], then: Callable[[list[Any]], None]) -> None:
        def answered(future: Any) -> None:
            answer = future.result()
            if answer is not None and len(answer.values) == len(names):
                then([parameter_value_to_python(value) for value in answer.values])

        request = GetParameters.Request(names=names)
        self._client.call_async(request).add_done_callback(answered)

    def _of_class(self, values: list[Any]) -> None:
        try:
            kind = learner_class(str(values[0]))
        except InputError as error:
            self._node.get_logger().warning(f"no map of the policy: {error}")
            return
        names = list(kind.Settings.__dataclass_fields__)
        self._get(names, lambda values: self._make(kind, dict(zip(names, values, strict=True))))

    def _make(self, kind: type[Learner], values: dict[str, Any]) -> None:
        given = {
            name: list(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
            for name, value in values.items() if value is not None
        }  # fmt: skip
        try:
            settings = from_mapping(kind.Settings, given, "the learner's parameters")
            self._ready(kind(self._task, settings, np.random.default_rng(0)))
        except InputError as error:
            self._node.get_logger().warning(f"no map of the policy: {error}")

    def close(self) -> None:
        """Ask no more."""
        self._node.destroy_client(self._client)
