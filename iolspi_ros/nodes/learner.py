"""The learner node: learns from demonstrations, then acts and learns online (T III-C)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime
from iolspi_ros.core.learner import DEFAULT, Learner, Source, Update, learner_class
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.nodes.computing import Computing
from iolspi_ros.nodes.demonstrations import Demonstrations
from iolspi_ros.nodes.fleet import Fleet
from iolspi_ros.nodes.help import Help
from iolspi_ros.nodes.journal import Mark
from iolspi_ros.nodes.reports import Reports
from iolspi_ros.nodes.saving import Flight, Saving, SavingSettings, Vehicle
from iolspi_ros.nodes.unsure import HelpSettings, Visits
from iolspi_ros.nodes.vehicle_watch import TASK, VehicleWatch
from iolspi_ros.process import say
from iolspi_ros.saving import checkpoint
from iolspi_ros.saving.keeper import Snapshot
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener
from iolspi_ros.vitals import Report, Vitals


@dataclass(frozen=True)
class NodeSettings(Settings):
    """What the learner node adds to the learner."""

    learner: str = setting(DEFAULT, "a registered learner, or module:Class")
    seed: int = setting(0, "of first weights, exploration and ties", low=0)
    wait_for_demonstrations: bool = setting(
        True, "wait for a demonstration and learn from it before acting"
    )
    other_vehicles: tuple[str, ...] = setting(
        ("",), "namespaces of more vehicles of the same task, to fly and learn from besides"
    )
    background: bool = setting(
        False, "answer while an update is computed, from the first one on; without it as soon as a "
        "vehicle does not wait for it",
    )  # fmt: skip
    vehicle_timeout: float = setting(
        0.0, "give up when no vehicle was heard for this long at the start [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


def repeated(task: TaskDescription) -> dict[str, Any]:
    """What a parameter file may say again of the task, and what it must then say."""
    return {
        "task": task.name,
        "joints": list(task.joints),
        "neutral": task.neutral,
        "n_actions": task.n_actions,
        "sampling_time": task.sampling_time,
        "gamma": task.gamma,
    }


MOMENT = 0.25
"""Seconds of an update that a vehicle in lockstep is answered after, without anything between."""
PATIENCE = 0.5
"""Seconds that what is being computed still gets at the end."""
_REPEATED = ("task", "joints", "neutral", "n_actions", "sampling_time", "gamma")


class LearnerNode(ManagedNode):
    """Takes `task`, `state`, `reward`, `sample`, `demonstration`; gives `action` and reports.

    Parameters
    ----------
    arguments : sequence of str, optional
    local : bool
        The vehicle is in this process: it hands its observations to `respond`.
    """

    def __init__(self, arguments: Sequence[str] | None = None, *, local: bool = False) -> None:
        super().__init__("learner", arguments)
        self._local = local
        self.settings = parameters.declare(self, NodeSettings)
        self._help_settings = parameters.declare(self, HelpSettings)
        self._saving = Saving(self)
        self._class = learner_class(self.settings.learner)
        parameters.declare(self, self._class.Settings, self._class.changeable)
        parameters.check_changes(self, NodeSettings, SavingSettings, self._class.Settings)
        parameters.warn_unknown(self, _REPEATED)
        self.core: Learner | None = None
        self.learning = True
        self._conflict = ""  # why nothing is learned any more
        self.vehicle: Vehicle | None = None
        """The vehicle, when it is in this process and to be saved, too."""
        self._closing = False
        self._ready = False  # to act, as soon as it is active
        self._while_flying = 0  # samples
        self._due = False  # an update, since before a resume
        self._again = False  # whether it goes through what was observed before a kill
        self._watch: VehicleWatch | None = None
        self.add_post_set_parameters_callback(self._on_changed)

    # ------------------------------------------------------------ managed

    def configure(self) -> None:
        """Listen for a task; what it needs for that follows then."""
        if self._saving.wanted or self._saving.settings.resume:
            self._saving.keeper()
        sole = ("task", "state", "reward", "sample", "demonstration", "update")
        self._vitals = Vitals(self, "learning", sole, self._diagnose)
        self._own_services = [
            self.create_service(SetBool, "~/learn", self._on_learn),
            self.create_service(Trigger, "~/learn_offline", self._on_learn_offline),
            self.create_service(Trigger, "~/save", self._on_save),
            self.create_service(Trigger, "~/load", self._on_load),
        ]
        self._own_timers = [runtime.wall_timer(self, 0.05, self._look_after)]
        self._task = TaskListener(self, self._on_task, self._on_conflict)

    def activate(self) -> None:
        """Act, when there is a vehicle and enough was learned."""
        if self.core is None and self._watch is None:
            self._watch = VehicleWatch(
                self, self._task.topic, lambda: self.core is not None,
                self.settings.vehicle_timeout, TASK, qos.TASK,
            )  # fmt: skip
        self._act_if_ready()

    def deactivate(self) -> None:
        """Stop acting; what was learned stays."""
        if self._watch is not None:
            self._watch.close()
            self._watch = None
        if self.core is not None:
            self._loop.stop()

    def cleanup(self) -> None:
        """Save, and forget vehicle and learner."""
        self._finish()
        self._task.close()
        for timer in self._own_timers:
            self.destroy_timer(timer)
        for service in self._own_services:
            self.destroy_service(service)
        self._vitals.close()
        if self.core is not None:
            self._loop.close()
            self._reports.close()
            self._help.close()
            for subscription in self._subscriptions_of_demonstrations:
                self.destroy_subscription(subscription)
            self._computing.stop()
        self.core, self._ready, self._conflict = None, False, ""

    def close(self) -> None:
        """Save: what is being computed is waited for a moment, and otherwise left out."""
        if not self._closing:
            self._closing = True
            if self.core is not None:
                self._computing.stop()
            self._finish()

    def _finish(self) -> None:
        """Save what is known, unless that is nothing."""
        core, saved = self.core, False
        try:
            if core is None or not self._saving.wanted or self._again:
                return
            found = self._last_words(core)
            if core.step or core.n_samples or len(self._demonstrations):
                # Printed: to be read at any log level.
                say(f"learner: {self._saving.keeper().save(found)}")
                saved = True
        finally:
            self._saving.close(all_saved=saved)

    def _last_words(self, core: Learner) -> Snapshot:
        """What to save at the end; never what was half done."""
        if not self._computing.over(PATIENCE) or self._computing.cut:
            return self._before_and_since()
        self._take_computed()
        return self._snapshot(core)

    def _before_and_since(self) -> Snapshot:
        """What was known before a computation, and what was observed while it ran."""
        before, since = self._computing.before, self._computing.since
        assert before is not None
        if not since:
            return before
        settings = parameters.read(self, self._class.Settings)
        core = self._class(self._loop.task, settings, np.random.default_rng())
        checkpoint.restore(before(), core, self.settings.learner, "this learner")
        for transition in since:
            core.observe(transition)
        flight = self._flight(due=True)
        return checkpoint.snapshot(core, self.settings.learner, self._saving.run, flight=flight)

    def _snapshot(self, core: Learner, *, due: bool = False) -> Snapshot:
        """What is known now; taken in the control thread, which it hardly delays."""
        vehicle = self.vehicle.memory() if self.vehicle is not None else None
        return checkpoint.snapshot(
            core, self.settings.learner, self._saving.run, flight=self._flight(due=due),
            vehicle=vehicle, help=self._help.memory(),
        )  # fmt: skip

    def _flight(self, *, due: bool) -> Flight:
        return Flight(self._loop.memory(), self._reports.memory(), due, self._ready)

    # ------------------------------------------------------------ the task

    def _on_task(self, task: TaskDescription) -> None:
        """Make the learner: there is a vehicle."""
        try:
            self._make(task)
        except InputError as error:
            self.fail(error)

    def _make(self, task: TaskDescription) -> None:
        for name, value in repeated(task).items():
            if name in self.given and self.given[name] != value:
                raise InputError(
                    f"parameter {name} is {self.given[name]!r} in what the learner was given, and "
                    f"{value!r} in the task of the vehicle on {self._task.topic}; allowed: the "
                    "same, or leave it out"
                )
        s = self.settings
        settings = parameters.read(self, self._class.Settings)
        core = self._class(task, settings, np.random.default_rng([s.seed, 1]))
        found = self._saving.look_for() if self._saving.settings.resume else None
        self._computing = Computing(core)
        self._demonstrations = Demonstrations(task)
        self._loop = Fleet(
            self, task, self, s.vehicle_timeout, local=self._local, others=s.other_vehicles
        )
        self._reports = Reports(self, core)
        self._help = Help(self, task, self._help_settings)
        if found is not None:
            self._resume(core, *found)
        self._subscriptions_of_demonstrations = [
            self.create_subscription(Float64MultiArray, "sample", self._on_sample, qos.SAMPLES),
            self.create_subscription(
                Float64MultiArray, "demonstration", self._on_demonstration, qos.LATCHED
            ),
        ]
        self.core = core
        self._ready |= not s.wait_for_demonstrations
        if self._saving.wanted and not (self._local or any(s.other_vehicles)):
            self._loop.note = self._note
            again = self._go_through(core, fresh=found is None)
            if self._again:
                return  # it was interrupted: nothing begins, and what was noted stays as it is
            self._saving.keep_journal(task.n_dims)
            if found is not None or again:
                self._saving.offer(self._snapshot(core), self._mark())
        self._reports.weights()
        if self._ready:
            self._act_if_ready()
        else:
            topic = self.resolve_topic_name("sample")
            self.get_logger().info(f"{task.name}: waiting for a demonstration on {topic}")

    def _resume(self, core: Learner, path: Path, content: checkpoint.Content) -> None:
        """Go on from a checkpoint, the vehicle in this process too."""
        where = f"checkpoint {path}"
        checkpoint.restore(content, core, self.settings.learner, where)
        flight = checkpoint.part(content, "flight", Flight, where)
        self._ready = flight.ready if flight is not None else core.n_samples > 0
        self._help.recall(checkpoint.part(content, "help", Visits, where))
        if flight is not None:
            self._loop.recall(flight.loop)
            self._reports.recall(flight.sums)
            self._due = flight.due
        if self.vehicle is not None:
            memory = checkpoint.part(content, "vehicle", self.vehicle.Memory, where)
            if memory is not None:
                self.vehicle.recall(memory)
        self._saving.keeper().go_on_from(path, content)
        self.get_logger().info(f"resumed from {path} at step {core.step}")

    def _note(self, observation: Observation) -> None:
        """Write down what is learned from."""
        if self.learning:
            self._saving.note(observation)

    def _mark(self) -> Mark:
        """Where the learner is, for a checkpoint of now."""
        assert self.core is not None
        return Mark(self.core.step, *self._loop.newest)

    def _go_through(self, core: Learner, *, fresh: bool) -> bool:
        """Learn anew what a learner that was killed had learned since; whether there was any."""
        if not self._saving.settings.resume:
            return False
        since = self._saving.observed_since(self._mark(), core.task.n_dims, fresh=fresh)
        self._again = self._reports.silent = self._help.silent = True
        try:
            for observation in since:
                runtime.check()
                self._loop.answer_again(observation)
        except KeyboardInterrupt:
            return False  # and `_again` stays: what is known now is on disk, and more
        self._again = self._reports.silent = self._help.silent = False
        if since:
            self.get_logger().info(
                f"learned anew from {len(since)} observations noted since; now at step {core.step}"
            )
        return bool(since)

    def _on_conflict(self, text: str) -> None:
        """Somebody says that the task is another one: act and learn no more."""
        if text != self._conflict:
            self.get_logger().error(f"{text}; nothing is learned from now on")
        self._conflict = text
        if self.core is not None:
            self._loop.stop()

    def _act_if_ready(self) -> None:
        if self.core is None or self._computing.pretraining:
            return
        if self.active and self._ready and not self._conflict:
            if not (self.core.step or self.core.n_samples):
                self._saving.begin_journal()
            self._loop.start()
            self.get_logger().info(f"acting on {self.resolve_topic_name('action')}")

    # ------------------------------------------------------------ in the control loop

    def respond(self, observation: Observation) -> tuple[int, Source] | None:
        """Answer a vehicle in this process; None while this node does not act."""
        return None if self.core is None else self._loop.respond(observation)

    def transition(self, before: Observation, transition: Transition) -> None:
        """Learn from a step."""
        assert self.core is not None
        if not self.learning:
            return
        due = self.core.observe(transition)
        if self._computing.updating:
            self._computing.since.append(transition)
        elif due:
            self._update(self.core)

    @property
    def busy(self) -> bool:
        """Whether an update must end before anything is answered."""
        if self._due and self.core is not None:
            self._due = False
            self._update(self.core)
        if self.core is None or not self._computing.updating:
            return False
        if not self._loop.all_wait and not self.settings.background:
            self.get_logger().warning(
                "the vehicle does not wait while an update is computed: it is flown with the "
                "policy before; set background:=true to have that from the first update on",
                once=True,
            )
        return self._waited_for

    @property
    def _waited_for(self) -> bool:
        """Whether the vehicle stands still until an update has ended."""
        return self._loop.all_wait and not self.settings.background

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Act on what was learned so far."""
        assert self.core is not None
        if self._computing.updating and self._computing.over():
            self._take_computed()
        return self.core.act(observation.state, explore=self.learning)

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Count the reward, and whether the answer explored; save now and then."""
        assert self.core is not None
        self._reports.answered(observation, source)
        self._help.answered(observation, source)
        if self._again:
            return
        if not self._computing.updating and self._saving.due():
            self._saving.offer(self._snapshot(self.core), self._mark())

    def _update(self, core: Learner) -> None:
        """Compute beside this thread, and wait for a moment when the vehicle waits, too."""
        if self._computing.updating:
            return
        self._computing.update(self._snapshot(core, due=True))
        while self._again and not self._computing.over(MOMENT):
            runtime.check()
        if self._again or (self._waited_for and self._computing.over(MOMENT)):
            self._take_computed()

    def _take_computed(self) -> None:
        """Take what was computed, if anything was."""
        computing = self._computing
        if computing.pretraining:
            self._take_pretrained()
        elif computing.updating:
            try:
                self._publish_update(computing.take())
            except Exception as error:  # of whatever learner, for whatever numbers
                self.get_logger().error(f"update failed, the policy before it stays: {error!r}")
            self._saving.updated()

    def _publish_update(self, update: Update) -> None:
        self._reports.update(update)
        self._reports.weights()
        if not update.healthy:
            self.get_logger().warning(update.text)

    # ------------------------------------------------------------ demonstrations

    def _on_sample(self, message: Any) -> None:
        if self._loop.running:
            if not self._while_flying:
                self.get_logger().warning("samples of a demonstration come while flying")
            self._while_flying += 1
        try:
            self._demonstrations.add(message)
        except InputError as error:
            self._loop.ignore(str(error))

    def _on_demonstration(self, message: Any) -> None:
        try:
            self._demonstrations.announce(message)
        except InputError as error:
            self._loop.ignore(str(error))

    def _look_after(self) -> None:
        """What no message brings about: the end of a demonstration and of learning from it."""
        if self.core is None:
            return
        computing = self._computing
        if computing.under_way and computing.over():
            updated = computing.updating
            self._take_computed()
            if updated:
                self._loop.go_on()
        elif (
            self.active and not self._conflict and not self._loop.running
            and not computing.under_way and self._demonstrations.complete()
        ):  # fmt: skip
            self._start_pretraining(self.core)

    def _start_pretraining(self, core: Learner) -> str:
        """Learn from what was demonstrated, beside the control thread."""
        transitions = self._demonstrations.transitions()
        text = f"{len(transitions)} demonstrated samples"
        if lost := self._demonstrations.missing():
            text += f", {lost} were lost on the way"
        if not len(transitions):
            self.get_logger().error(
                "the demonstration brought no sample; waiting for another: start a demonstrator"
            )
            self._demonstrations.forget_end()
            return text
        self._loop.stop()
        self.get_logger().info(f"learning offline from {text}")
        self._computing.pretrain(self._snapshot(core), transitions)
        return text

    def _take_pretrained(self) -> None:
        self._demonstrations.forget_end()
        try:
            result = self._computing.take()
        except Exception as error:  # of whatever learner, for whatever numbers
            text = str(error) if isinstance(error, InputError) else repr(error)
            self.get_logger().error(f"{text}; waiting for another demonstration")
            return
        self._publish_update(result)
        self._help.known(self._demonstrations.transitions())
        self._ready = True
        if self._closing or self.core is None:
            return
        self.get_logger().info(result.text)
        self._act_if_ready()
        if self._saving.wanted:
            self._saving.offer(self._snapshot(self.core), self._mark())

    # ------------------------------------------------------------ services and parameters

    def _on_learn(self, request: Any, response: Any) -> Any:
        self.learning = request.data
        response.success = True
        response.message = "learning" if self.learning else "acting greedily, not learning"
        return response

    def _on_learn_offline(self, _: Any, response: Any) -> Any:
        try:
            response.message = self._start_pretraining(self._idle_core())
            response.success = self._computing.pretraining
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_save(self, _: Any, response: Any) -> Any:
        try:
            response.message = self._save(self._idle_core())
            response.success = True
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_load(self, _: Any, response: Any) -> Any:
        try:
            core, keeper = self._idle_core(), self._saving.keeper()
            path, content = keeper.path, checkpoint.read(keeper.path)
            checkpoint.restore(content, core, self.settings.learner, f"checkpoint {path}")
            keeper.go_on_from(path, content)
            self._reports.weights()
            self._ready = True
            self._act_if_ready()
            flight = checkpoint.part(content, "flight", Flight, f"checkpoint {path}")
            if flight is not None:
                self._saving.go_back(Mark(core.step, flight.loop.episode, flight.loop.step))
            response.success, response.message = True, f"loaded {path}"
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _idle_core(self) -> Learner:
        """The learner, while no other thread is at work on it."""
        if self.core is None:
            raise InputError(f"no vehicle was heard yet on {self.resolve_topic_name('task')}")
        if self._computing.pretraining:
            raise InputError("it is learning from demonstrations; allowed: when that has ended")
        if not self._computing.over(MOMENT):
            raise InputError("an update is being computed; allowed: when that has ended")
        self._take_computed()
        return self.core

    def _save(self, core: Learner) -> str:
        return self._saving.save(self._snapshot(core), self._mark())

    def _on_changed(self, _: Any) -> None:
        if self.core is not None:
            self.core.settings = parameters.read(self, self._class.Settings)

    # ------------------------------------------------------------ how it is

    def _phase(self) -> str:
        if self.core is None:
            return "waiting for a vehicle"
        if self._computing.pretraining:
            return "learning offline"
        if not self._loop.running:
            return "inactive" if self._ready or not self.active else "waiting for a demonstration"
        return "learning" if self.learning else "acting"

    def _diagnose(self) -> Report:
        report = Report(self._phase())
        report.values["learner"] = self.settings.learner
        if self.core is not None:
            report.values |= {
                "task": self.core.task.name,
                "demonstrated samples": len(self._demonstrations),
                "samples that came while flying": self._while_flying,
            }
            condition, worry = self._loop.condition()
            report.values |= condition
            report.worry(worry)
            condition, worry = self._reports.condition()
            report.values |= condition
            report.worry(worry)
            report.worry(self._help.reason)
            if self._while_flying:
                report.worry(
                    f"{self._while_flying} samples came while flying; they are learned from with "
                    "~/learn_offline alone"
                )
        condition, worry = self._saving.condition(time.monotonic())
        report.values |= condition
        report.worry(worry, DiagnosticStatus.ERROR)
        report.worry(self._conflict, DiagnosticStatus.ERROR)
        return report


def main() -> int:
    """Run the learner."""
    return runtime.main(LearnerNode, "learner")
