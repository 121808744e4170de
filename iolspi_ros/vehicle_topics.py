"""The vehicle's side of the graph: what every vehicle says, and how it is answered."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError


class Answer(NamedTuple):
    """An action, and the observation that it answers."""

    episode: float
    step: float
    action: int


class VehicleTopics:
    """Publishes `state` and `reward`, and reads what comes on `action`.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._action_rows = wire.Rows("action", wire.ACTION)
        self._reward_rows = wire.RewardRows()
        self._state_out = node.create_publisher(JointState, "state", qos.OUTGOING)
        self._reward_out = node.create_publisher(Float64MultiArray, "reward", qos.OUTGOING)
        self._state_message, self._reward_message = JointState(), Float64MultiArray()
        self.ignored = 0

    def show(self, joints: Sequence[str], observation: Observation) -> None:
        """Make an observation the one that is published."""
        wire.fill_state(self._state_message, joints, observation.state, observation.stamp)
        self._reward_message = self._reward_rows.of(observation)

    def publish(self) -> None:
        """Publish the observation shown last, for the first time or again."""
        runtime.publish(self._state_out, self._state_message)
        runtime.publish(self._reward_out, self._reward_message)

    def read(self, n_actions: int, message: Any) -> Answer | None:
        """What a message on `action` says; None, and a word to people, when it says nothing."""
        try:
            episode, step, _, _, value, _ = self._action_rows.read(message)
            action = wire.whole(value)
            if not 0 <= action < n_actions:
                raise InputError(f"action is {value}; allowed: 0 to {n_actions - 1}")
        except InputError as error:
            self.ignored += 1
            self._node.get_logger().warning(
                f"{error} ({self.ignored} ignored)", throttle_duration_sec=5.0
            )
            return None
        return Answer(episode, step, action)
