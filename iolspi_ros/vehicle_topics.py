"""What a vehicle says to the graph and how it is answered; how others hear what its task is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, String

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.takeover import LOOK, Listening, Takeover
from iolspi_ros.task import TaskDescription


class Answer(NamedTuple):
    """An action, who chose it, and the observation that it answers."""

    episode: float
    step: float
    action: int
    source: int


class VehicleTopics:
    """Publishes `task`, `state` and `reward`, and reads what comes on `action` and `takeover`.

    Parameters
    ----------
    node : rclpy.node.Node
    task : TaskDescription
    handed : callable
        Called when a person has taken the vehicle, or given it back.

    Attributes
    ----------
    takeover : Takeover
    """

    def __init__(
        self, node: Node, task: TaskDescription, handed: Callable[[], None] = lambda: None
    ) -> None:
        self._node, self._task, self._handed = node, task, handed
        listening = Listening()
        self.takeover = Takeover(listening)
        self._looking = runtime.wall_timer(node, LOOK, listening.look)
        self._states = wire.states(task)
        self._action_rows = wire.Rows("action", wire.ACTION)
        self._reward_rows = wire.RewardRows()
        self._state_out = node.create_publisher(self._states.type, "state", qos.OUTGOING)
        self._reward_out = node.create_publisher(Float64MultiArray, "reward", qos.OUTGOING)
        self._task_out = node.create_publisher(String, "task", qos.LATCHED)
        self._takeover_rows = wire.Rows("takeover", wire.TAKEOVER)
        self._takeover_in = node.create_subscription(
            Float64MultiArray, "takeover", self._on_takeover, qos.LATCHED
        )
        self._shown = Observation(0, 0, np.zeros(task.n_dims))
        self._packed: tuple[bytes, bytes] | None = None
        self.ignored = 0
        self.local = False
        """Whether who acts is in this process, and takes what is pending itself."""
        self._pending: Observation | None = None
        self._task_out.publish(wire.task_message(task))

    def show(self, observation: Observation) -> None:
        """Make an observation the one that is published."""
        self._shown, self._packed = observation, None

    def publish(self) -> None:
        """Publish the observation shown last, for the first time or again."""
        if self.local:
            self._pending = self._shown
            if not self._state_out.get_subscription_count():
                return
        if self._packed is None:
            self._packed = (self._states.of(self._shown), self._reward_rows.of(self._shown))
        state, reward = self._packed
        self._state_out.publish(state)
        self._reward_out.publish(reward)

    def take_pending(self) -> Observation | None:
        """What was published since the last call."""
        pending, self._pending = self._pending, None
        return pending

    def read(self, message: Any) -> Answer | None:
        """What a message on `action`, or its bytes, says, if it is for the vehicle to take.

        What makes no sense is counted, and said to people.
        """
        try:
            episode, step, _, _, value, source = self._action_rows.read(message)
            action = wire.whole(value)
            if not 0 <= action < self._task.n_actions:
                raise InputError(f"action is {value}; allowed: 0 to {self._task.n_actions - 1}")
        except InputError as error:
            self._ignore(error)
            return None
        answer = Answer(episode, step, action, wire.whole(source))
        return answer if self.admits(answer) else None

    def admits(self, answer: Answer) -> bool:
        """Whether who chose it may act, and answers what was shown."""
        neutral, seen = answer.action == self._task.neutral, (answer.episode, answer.step)
        if seen > (self._shown.episode, self._shown.step):
            return False  # meant for another vehicle, or for one before
        with self._handing():
            return self.takeover.takes(answer.source, neutral, seen)

    def _on_takeover(self, message: Any) -> None:
        try:
            episode, step, _, _, held = self._takeover_rows.read(message)
        except InputError as error:
            self._ignore(error)
            return
        with self._handing():
            self.takeover.hear(held > 0.5, (episode, step))

    @contextmanager
    def _handing(self) -> Iterator[None]:
        """Say it when the vehicle is taken or given back meanwhile."""
        before = self.takeover.held
        yield
        if self.takeover.held != before:
            self._handed()

    def _ignore(self, error: InputError) -> None:
        self.ignored += 1
        self._node.get_logger().warning(
            f"{error} ({self.ignored} ignored)", throttle_duration_sec=5.0
        )

    def close(self) -> None:
        """Stop being a vehicle."""
        publishers = self._state_out, self._reward_out, self._task_out
        runtime.destroy_publishers(self._node, *publishers)
        self._node.destroy_subscription(self._takeover_in)
        self._node.destroy_timer(self._looking)


class TaskListener:
    """Hears on `task` what the vehicle's task is.

    Parameters
    ----------
    node : rclpy.node.Node
    on_task : callable
        Takes the first description; an InputError that it raises is one of the node's.
    on_conflict : callable
        Takes words for people: another description contradicts the first, or is none.
    prefix : str
        Before the name of the topic.
    """

    def __init__(
        self,
        node: Node,
        on_task: Callable[[TaskDescription], None],
        on_conflict: Callable[[str], None],
        prefix: str = "",
    ) -> None:
        self._node, self._on_task, self._on_conflict = node, on_task, on_conflict
        self.task: TaskDescription | None = None
        self._subscription = node.create_subscription(String, f"{prefix}task", self._hear, qos.TASK)

    @property
    def topic(self) -> str:
        """Where it listens."""
        return str(self._subscription.topic_name)

    def _hear(self, message: Any) -> None:
        try:
            described = wire.read_task(message, f"topic {self.topic}")
            if self.task is not None:
                self.task.check_same(described, "the vehicle", f"another message on {self.topic}")
        except InputError as error:
            self._on_conflict(str(error))
            return
        if self.task is None:
            self.task = described
            self._on_task(described)

    def close(self) -> None:
        """Stop listening."""
        self._node.destroy_subscription(self._subscription)
