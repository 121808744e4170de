"""The demonstrator node: a joystick, a scripted pilot or a bag becomes samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64MultiArray

from iolspi_ros import __version__, bags, parameters, qos, resources, runtime, wire
from iolspi_ros.core.samples import Sample
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.nodes.hand import HandFlight
from iolspi_ros.nodes.override import Override
from iolspi_ros.nodes.person import Person
from iolspi_ros.nodes.player import Player, PlayerSettings, check_bags
from iolspi_ros.nodes.teleop import ScriptedFlight, TeleopSettings
from iolspi_ros.nodes.vehicle_watch import TASK, VehicleWatch
from iolspi_ros.process import say
from iolspi_ros.runtime import RCLError
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener
from iolspi_ros.vitals import Report, Vitals
from sim_nodes.pilots import PilotSettings, ScriptedPilot
from sim_nodes.tasks import make_task

PILOTS = {
    "scripted": "the scripted pilot of iolspi_ros; no person flew this",
    "joy": "a person with a joystick",
    "bag": "a replay of ",
}


@dataclass(frozen=True)
class DemonstratorSettings(Settings):
    """Who demonstrates, and where it is recorded."""

    source: str = setting(
        "bag", "a bag, a joystick or the scripted pilot", choices=("bag", "joy", "scripted")
    )
    model: str = setting(
        "", "scripted: the registered task, or module:Class, whose pilot flies; else the vehicle's"
    )
    model_file: str = setting(
        "", "scripted: parameter file whose simulator has the settings that the pilot's model gets"
    )
    record: str = setting("", "bag to record to; empty for none")


class Demonstrator(ManagedNode):
    """Publishes `sample` and `demonstration`; flying, takes `state`, `reward`, gives `action`.

    A person flies with `joy`; how that stands is on `piloting`, and `takeover` keeps others out.
    """

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        super().__init__("demonstrator", arguments)
        self.settings = parameters.declare(self, DemonstratorSettings)
        self._teleop_settings = parameters.declare(self, TeleopSettings, ("corruption",))
        self._pilot = parameters.declare(self, PilotSettings)
        self._person = Person(self, self._teleop_settings)
        self._player_settings = parameters.declare(self, PlayerSettings)
        parameters.check_changes(self, TeleopSettings)
        parameters.warn_unknown(self, ("task",))
        self._waiting: deque[Any] = deque()
        self._bag: bags.BagWriter | None = None
        self._work: Player | ScriptedFlight | HandFlight | Override | None = None
        self._ended = False
        self.recorded = 0
        self._watch: VehicleWatch | None = None
        self._sent = 0

    # ------------------------------------------------------------ managed

    def configure(self) -> None:
        """Listen for a task; what is demonstrated follows then."""
        if self.settings.source == "bag":
            check_bags(self._player_settings)
        if self.settings.source == "scripted":
            self._model_settings = self._read_model_file()
        if self.settings.record:
            bags.check_place(self._place)
        self._sample_out = self.create_publisher(Float64MultiArray, "sample", qos.SAMPLES)
        self._demonstration_out = self.create_publisher(
            Float64MultiArray, "demonstration", qos.LATCHED
        )
        self._last = (0, 0, 0)  # episode, step and stamp of the last sample
        sole = ("sample", "demonstration", *(["joy"] if self._with_person else []))
        self._vitals = Vitals(self, "demonstrating", sole, self._diagnose)
        self._flushing = runtime.wall_timer(self, 0.05, self._look_after)
        if self._with_person:
            self._person.open()
        self._listener = TaskListener(self, self._on_task, self._on_conflict)

    def activate(self) -> None:
        """Demonstrate, as soon as there is a vehicle."""
        if self._work is not None:
            self._work.resume()
        elif self._watch is None:
            self._watch = VehicleWatch(
                self, self._listener.topic, lambda: self._work is not None,
                self._teleop_settings.vehicle_timeout, TASK, qos.TASK,
            )  # fmt: skip

    def deactivate(self) -> None:
        """Pause."""
        if self._watch is not None:
            self._watch.close()
            self._watch = None
        if self._work is not None:
            self._work.pause()

    def cleanup(self) -> None:
        """End the demonstration as it is, and forget the vehicle."""
        self.close()
        if self._work is not None:
            self._work.close()
        self._work, self._ended = None, False
        if self._with_person:
            self._person.close()
        self._listener.close()
        self._vitals.close()
        self.destroy_timer(self._flushing)
        runtime.destroy_publishers(self, self._sample_out, self._demonstration_out)

    def _on_task(self, task: TaskDescription) -> None:
        """Make what demonstrates: there is a vehicle."""
        try:
            given = self.given.get("task", task.name)
            if given != task.name:
                raise InputError(
                    f"parameter task is {given!r} in what the demonstrator was given, and "
                    f"{task.name!r} in the task of the vehicle on {self._listener.topic}; "
                    "allowed: the same, or leave it out"
                )
            self.task, self._rows = task, wire.SampleRows(task.names)
            self._announcements = wire.Rows("demonstration", wire.DEMONSTRATION)
            self._work = self._demonstrate(task)
        except InputError as error:
            self.fail(error)
            return
        if self.active:
            self._work.resume()

    @property
    def _with_person(self) -> bool:
        """Whether a person has a part in it."""
        return self.settings.source == "joy" or self._person.takes_over

    @property
    def _place(self) -> Path:
        """Where it is recorded to."""
        return Path(self.settings.record).expanduser()

    def _demonstrate(self, task: TaskDescription) -> Player | ScriptedFlight | HandFlight:
        """Make who demonstrates."""
        self._origin = PILOTS[self.settings.source]
        if self._with_person:
            self._person.meet()
        if self.settings.source == "bag":
            self._origin += ", ".join(self._player_settings.bags)
            return Player(self, self._player_settings)
        if self.settings.source == "scripted":
            return ScriptedFlight(self, self._teleop_settings, self._scripted(task))
        return self._person.demonstrate()

    def _read_model_file(self) -> dict[str, Any]:
        """What the pilot's model has otherwise than by default."""
        file = self.settings.model_file
        return resources.parameters(Path(file).expanduser(), "simulator") if file else {}

    def _scripted(self, task: TaskDescription) -> ScriptedPilot:
        """The scripted pilot."""
        name, where = self.settings.model or task.name, self.settings.model_file
        vehicle: Any = make_task(name, self._model_settings, where)
        vehicle.description.check_same(task, "the model that the pilot knows", "the vehicle")
        rng = np.random.default_rng([self._teleop_settings.seed, 2])
        return ScriptedPilot(vehicle, self._pilot, rng)

    def _on_conflict(self, text: str) -> None:
        """Somebody says that the task is another one: demonstrate no more."""
        self.get_logger().error(f"{text}; nothing is demonstrated from now on")
        if self._work is not None:
            self._work.pause()

    def _look_after(self) -> None:
        """Publish what waits; after the demonstration leave the vehicle to whoever takes it."""
        self.flush()
        if not (self._ended and self._person.takes_over and self._work is not None):
            return
        self._ended = False
        self._work.close()
        self._work = self._person.stand_by()
        if self.active:
            self._work.resume()

    # ------------------------------------------------------------ what demonstrates calls these

    @property
    def corruption(self) -> float:
        """Probability that an action is replaced by a random one, as it is now."""
        return float(self.get_parameter("corruption").value)

    def begin(self) -> None:
        """Start recording, if that is wanted, and say that a demonstration begins."""
        if self.settings.record:
            try:
                self._bag = bags.BagWriter(self._place)
            except InputError as error:
                self.fail(error)
                return
            task = wire.task_message(self.task)
            self.record("task", wire.type_name(task), 0, serialize_message(task))
        self._announce(active=True)

    def end(self) -> None:
        """Say that the demonstration has ended, and close the bag."""
        self._announce(active=False)
        self._close_bag()
        self._ended = True
        self.get_logger().info(f"demonstration ended: {self._sent} samples")

    def send(self, sample: Sample) -> None:
        """Record one transition, and publish it as soon as the listeners keep up."""
        message = self._rows.of(sample)
        self.record("sample", wire.ROW, sample.stamp, message)
        self.recorded += 1
        self.queue(sample, message)

    def queue(self, sample: Sample, message: bytes) -> None:
        """Publish one transition as soon as the listeners keep up."""
        self._waiting.append(message)
        self.flush()
        self._sent += 1
        self._last = (sample.episode, sample.step, sample.stamp)

    def flush(self) -> bool:
        """Publish what waits; False when a slow listener made some of it wait longer."""
        while self._waiting:
            try:
                self._sample_out.publish(self._waiting[0])
            except RCLError:  # the writer's queue stayed full for as long as DDS blocks
                return False
            self._waiting.popleft()
        return True

    def record(self, topic: str, kind: str, stamp: int, data: bytes) -> None:
        """Write a serialised message to the bag, if one is being recorded."""
        if self._bag is None:
            return
        try:
            self._bag.write(topic, kind, stamp, data)
        except InputError as error:  # a full disk; what was written stays
            self.fail(error)

    def listeners(self) -> int:
        """How many nodes take samples."""
        return self._sample_out.get_subscription_count()

    def close(self) -> None:
        """Give the vehicle back, put away what was flown, close the bag and write its card."""
        self._person.let_go()
        if self._work is not None and not isinstance(self._work, Player):
            self._work.put_away()
        self._close_bag()

    def _close_bag(self) -> None:
        if self._bag is None:
            return
        bag, self._bag = self._bag, None
        bag.close()
        bags.write_card(bag.path, self._card())
        # Printed: to be read at any log level.
        say(f"demonstrator: {self.recorded} samples are in {bag.path}")

    def _diagnose(self) -> Report:
        phase = "waiting for a vehicle" if self._work is None else "demonstrating"
        report = Report(phase if self.active else "inactive")
        report.values |= {
            "source": self.settings.source, "samples sent": self._sent,
            "samples waiting": len(self._waiting), "listeners": self.listeners(),
            "recording to": self._bag.path if self._bag is not None else "nowhere",
        }  # fmt: skip
        if len(self._waiting) > 1:
            report.worry(f"{len(self._waiting)} samples wait for a slow listener")
        self._person.diagnose(report)
        return report

    def _announce(self, *, active: bool) -> None:
        episode, step, stamp = self._last
        values = (episode, step, *wire.split(stamp), active, self._sent)
        self._demonstration_out.publish(self._announcements.message(*values))

    def _card(self) -> dict[str, Any]:
        card: dict[str, Any] = {"pilot": self._origin, "task": self.task.name}
        if self.settings.source == "scripted":
            card |= asdict(self._pilot)
        if self.settings.source != "bag":
            card["corruption"] = self.corruption
            card["seed"] = int(self.get_parameter("seed").value)
        return card | {"samples": self.recorded, "version": __version__}


def main() -> int:
    """Run the demonstrator."""
    return runtime.main(Demonstrator, "demonstrator")
