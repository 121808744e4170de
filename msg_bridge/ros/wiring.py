"""A robot's topics and services, as its file names them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from iolspi_ros import runtime
from iolspi_ros.errors import InputError
from iolspi_ros.unheard import name_of, unheard
from msg_bridge.ros.description import Output, Robot

_PROFILES = {
    "best_effort": QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    "reliable": QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE),
    "latched": QoSProfile(
        depth=1, reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL,
    ),
}  # fmt: skip
"""What a file may ask for; best effort hears every publisher."""


class Wiring:
    """Hears the robot's topics, and publishes what actions mean.

    Parameters
    ----------
    node : rclpy.node.Node
    robot : Robot
    heard : callable
        Takes a topic, as in the file, and its message.
    """

    def __init__(self, node: Node, robot: Robot, heard: Callable[[str, Any], None]) -> None:
        self._node, self._robot = node, robot
        self._sources = {s.topic: s for s in (*robot.inputs, *robot.sources) if s.topic}
        self._subscriptions = [
            node.create_subscription(
                source.kind, topic, self._hearer(topic, heard), _PROFILES[source.qos]
            )
            for topic, source in self._sources.items()
        ]
        self._messages = [
            [output.message(action) for action in range(robot.task.n_actions)]
            for output in robot.outputs
        ]
        self._publishers = [self._publisher(output) for output in robot.outputs]
        reset = robot.reset
        self._client = node.create_client(reset.kind, reset.service) if reset.service else None
        self._start_out = self._publisher(reset.message) if reset.message else None

    def _publisher(self, output: Output) -> Any:
        return self._node.create_publisher(output.kind, output.topic, _PROFILES[output.qos])

    @staticmethod
    def _hearer(topic: str, heard: Callable[[str, Any], None]) -> Callable[[Any], None]:
        return lambda message: heard(topic, message)

    def command(self, action: int) -> None:
        """Publish what an action means, stamped now where it has a header."""
        for publisher, messages in zip(self._publishers, self._messages, strict=True):
            message = messages[action]
            if hasattr(message, "header"):
                message.header.stamp = self._node.get_clock().now().to_msg()
            publisher.publish(message)

    def put_at_start(self, placed: Callable[[str], None]) -> bool:
        """Have the robot put at a start; false when nobody can be asked.

        `placed` is called then, with why it was refused, or an empty text.
        """
        if self._start_out is not None:
            assert self._robot.reset.message is not None
            self._start_out.publish(self._robot.reset.message.message(0))
        if self._client is None:
            placed("")
            return True
        if not self._client.service_is_ready():
            return False
        future = self._client.call_async(self._robot.reset.kind.Request())
        future.add_done_callback(lambda done: placed(_refusal(done)))
        return True

    def check(self) -> None:
        """See that each topic can be heard.

        Raises
        ------
        InputError
            When somebody publishes, or takes, another type, or what is offered does not suit.
        """
        for topic, source in self._sources.items():
            resolved = self._node.resolve_topic_name(topic)
            why = unheard(self._node, resolved, source.type_name, _PROFILES[source.qos])
            if why:
                raise InputError(f"{why}; allowed: the file's type, and qos: best_effort hears all")
        for output in self._robot.outputs:
            resolved = self._node.resolve_topic_name(output.topic)
            for other in self._node.get_subscriptions_info_by_topic(resolved):
                if other.topic_type != output.type_name:
                    raise InputError(
                        f"topic {resolved} is heard by {name_of(other)} as {other.topic_type}, and "
                        f"the file says {output.type_name}; allowed: the same type"
                    )

    def flush(self, patience: Duration) -> None:
        """Wait until what was published has arrived."""
        for publisher in self._publishers:
            publisher.wait_for_all_acked(patience)

    def close(self) -> None:
        """Leave the robot's topics."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        publishers = *self._publishers, *([self._start_out] if self._start_out else [])
        runtime.destroy_publishers(self._node, *publishers)
        if self._client is not None:
            self._node.destroy_client(self._client)


def _refusal(done: Any) -> str:
    """Why a reset was refused; empty when it was done."""
    try:
        answer = done.result()
    except Exception as error:  # whatever the service's server raised
        return str(error) or type(error).__name__
    if getattr(answer, "success", True):
        return ""
    return str(getattr(answer, "message", "")) or "it says no"
