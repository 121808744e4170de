"""The demonstrator node: a joystick, a scripted pilot or a bag becomes samples."""

from __future__ import annotations

import sys
from collections import deque
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.node import Node
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from iolspi_ros import __version__, bags, parameters, qos, runtime, wire
from iolspi_ros.core.samples import Sample
from iolspi_ros.nodes.flight import Flight, FlightSettings
from iolspi_ros.nodes.player import Player, PlayerSettings
from iolspi_ros.nodes.stick import StickSettings
from iolspi_ros.settings import Settings, setting
from sim_nodes.pilots import PilotSettings
from sim_nodes.tasks import task_class

PILOTS = {
    "scripted": "the scripted pilot of iolspi_ros; no person flew this",
    "joy": "a person with a joystick",
    "bag": "a replay of ",
}


@dataclass(frozen=True)
class DemonstratorSettings(Settings):
    """Who demonstrates, and where it is recorded."""

    task: str = setting("pendulum", "the task that is demonstrated")
    source: str = setting(
        "bag", "a bag, a joystick or the scripted pilot", choices=("bag", "joy", "scripted")
    )
    record: str = setting("", "bag to record to; empty for none")


class Demonstrator(Node):
    """Publishes `sample` and `demonstration`; flying, takes `state`, `reward`, gives `action`."""

    def __init__(self) -> None:
        super().__init__("demonstrator")
        self.settings = parameters.declare(self, DemonstratorSettings)
        flight = parameters.declare(self, FlightSettings, ("corruption",))
        self._pilot = parameters.declare(self, PilotSettings)
        stick = parameters.declare(self, StickSettings)
        player = parameters.declare(self, PlayerSettings)
        parameters.check_changes(self, FlightSettings)
        parameters.warn_unknown(self)
        self.task = task_class(self.settings.task)()
        self._rows = wire.SampleRows(self.task.joints)
        self._announcements = wire.Rows("demonstration", wire.DEMONSTRATION)
        self._sample_out = self.create_publisher(Float64MultiArray, "sample", qos.SAMPLES)
        self._demonstration_out = self.create_publisher(
            Float64MultiArray, "demonstration", qos.LATCHED
        )
        self._sent = 0
        self._last = (0, 0, 0)  # episode, step and stamp of the last sample
        self._waiting: deque[Any] = deque()
        self._bag: bags.BagWriter | None = None
        runtime.wall_timer(self, 0.05, self.flush)
        if self.settings.source == "bag":
            self._origin = PILOTS["bag"] + ", ".join(player.bags)
            self._player = Player(self, player)
        else:
            self._origin = PILOTS[self.settings.source]
            self._flight = Flight(self, flight, self._pilot, stick)

    def begin(self) -> None:
        """Start recording, if that is wanted, and say that a demonstration begins."""
        if self.settings.record:
            self._bag = bags.BagWriter(Path(self.settings.record).expanduser())
        self._announce(active=True)

    def end(self) -> None:
        """Say that the demonstration has ended, and close the bag."""
        self._announce(active=False)
        self.close()
        self.get_logger().info(f"demonstration ended: {self._sent} samples")

    def send(self, sample: Sample) -> None:
        """Record one transition, and publish it as soon as the listeners keep up."""
        message = self._rows.of(sample)
        self.record("sample", sample.stamp, message)
        self._waiting.append(message)
        self.flush()
        self._sent += 1
        self._last = (sample.episode, sample.step, sample.stamp)

    def flush(self) -> bool:
        """Publish what waits; False when a slow listener made some of it wait longer."""
        while self._waiting:
            try:
                self._sample_out.publish(self._waiting[0])
            except RCLError:
                if rclpy.ok():  # the writer's queue stayed full for as long as DDS blocks
                    return False
                raise
            self._waiting.popleft()
        return True

    def record(self, topic: str, stamp: int, message: Any) -> None:
        """Write a message to the bag, if one is being recorded."""
        if self._bag is not None:
            self._bag.write(topic, wire.type_name(message), stamp, serialize_message(message))

    def listeners(self) -> int:
        """How many nodes take samples."""
        return self._sample_out.get_subscription_count()

    def close(self) -> None:
        """Close the bag and write its card."""
        if self._bag is None:
            return
        bag, self._bag = self._bag, None
        bag.close()
        bags.write_card(bag.path, self._card())
        # Printed: after a signal nothing can be logged to the graph any more.
        print(f"demonstrator: {self._sent} samples are in {bag.path}", file=sys.stderr)

    def _announce(self, *, active: bool) -> None:
        episode, step, stamp = self._last
        values = (episode, step, *wire.split(stamp), active, self._sent)
        self._demonstration_out.publish(self._announcements.message(*values))

    def _card(self) -> dict[str, Any]:
        card: dict[str, Any] = {"pilot": self._origin, "task": self.settings.task}
        if self.settings.source == "scripted":
            card |= asdict(self._pilot)
        if self.settings.source != "bag":
            card["corruption"] = float(self.get_parameter("corruption").value)
            card["seed"] = int(self.get_parameter("seed").value)
        return card | {"samples": self._sent, "version": __version__}


def main() -> int:
    """Run the demonstrator."""
    return runtime.main(Demonstrator, "demonstrator", sys.argv)
