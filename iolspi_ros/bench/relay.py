"""A node between a vehicle in /sim and who acts, which loses, doubles, delays and falsifies."""

from __future__ import annotations

import random
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

from iolspi_ros import qos, runtime, wire
from iolspi_ros.nodes.start import follow_parent
from iolspi_ros.process import prepare

VEHICLE = "/sim"
"""Namespace of the vehicle."""
LOST, DOUBLED, LATE, WRONG = 0.02, 0.02, 0.02, 0.001
"""Probability of each fault: a message is lost, comes twice, behind the next, or with a number that
is not its own."""
NUMBERS = (float("nan"), float("inf"), 1e9, -1e9, 1e300)
HOUR = 3600


class Relay(Node):
    """Passes `task`, `state` and `reward` of the vehicle on, and `action` to it.

    Parameters
    ----------
    arguments : sequence of str
        The process' own; the last is the seed of what happens.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        super().__init__("relay")
        self._random = random.Random(int(arguments[-1]))
        self._late: list[tuple[Any, Any]] = []
        self.counts: Counter[str] = Counter()
        self._task = self.create_publisher(String, "task", qos.TASK)
        self.create_subscription(String, f"{VEHICLE}/task", self._on_task, qos.TASK)
        self._pass_on(Float64MultiArray, f"{VEHICLE}/reward", "reward")
        self._pass_on(Float64MultiArray, "action", f"{VEHICLE}/action")
        self._states: type | None = None

    def _on_task(self, message: String) -> None:
        if self._states is None:
            self._states = wire.states(wire.read_task(message, "the relay")).type
            self._pass_on(self._states, f"{VEHICLE}/state", "state")
        self._task.publish(message)

    def _pass_on(self, kind: type, there: str, here: str) -> None:
        out = self.create_publisher(kind, here, qos.OUTGOING)
        self.create_subscription(kind, there, self._relay(out), qos.CONTROL)

    def _relay(self, out: Any) -> Callable[[Any], None]:
        faults = ("lost", "doubled", "late", "wrong", "")
        weights = (LOST, DOUBLED, LATE, WRONG, 1.0 - LOST - DOUBLED - LATE - WRONG)

        def take(message: Any) -> None:
            fault = self._random.choices(faults, weights)[0]
            self.counts[fault or "passed on"] += 1
            late, self._late = self._late, []
            if fault == "late":
                self._late.append((out, message))
            elif fault != "lost":
                for _ in range(2 if fault == "doubled" else 1):
                    out.publish(self._falsified(message) if fault == "wrong" else message)
            for publisher, old in late:
                publisher.publish(old)

        return take

    def _falsified(self, message: Any) -> Any:
        """With one number in it wrong, or its stamp an hour off."""
        if isinstance(message, JointState):
            if self._random.random() < 0.2:
                message.header.stamp.sec += self._random.choice((-HOUR, HOUR))
                return message
            numbers = message.position
        else:
            numbers = message.data
        numbers[self._random.randrange(len(numbers))] = self._random.choice(NUMBERS)
        return message

    def close(self) -> None:
        """Say what was done."""
        said = ", ".join(f"{n} {what}" for what, n in sorted(self.counts.items()))
        print(f"relay: {said}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    follow_parent()
    prepare()
    sys.exit(runtime.main(Relay, "relay"))
