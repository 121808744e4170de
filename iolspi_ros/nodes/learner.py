"""The learner node: learns from demonstrations, then acts and learns online (T III-C)."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime
from iolspi_ros.core import checkpoint
from iolspi_ros.core.learner import DEFAULT, Learner, Source, Update, learner_class, update
from iolspi_ros.core.samples import Observation, Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.nodes.control_loop import TASK, no_vehicle
from iolspi_ros.nodes.demonstrations import Demonstrations
from iolspi_ros.nodes.fleet import Fleet
from iolspi_ros.nodes.reports import Reports, diagnostics
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener


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
        False, "solve beside the control thread (real time) instead of inline (lockstep)"
    )
    checkpoint: str = setting("", "file to save to, also at the end; empty for none")
    resume: bool = setting(False, "start from the checkpoint instead of from nothing")
    vehicle_timeout: float = setting(
        10.0, "give up when no vehicle was heard for this long at the start [s]; 0.0 for never",
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
        self.settings = parameters.declare(self, NodeSettings, ("checkpoint",))
        self._class = learner_class(self.settings.learner)
        parameters.declare(self, self._class.Settings, self._class.changeable)
        parameters.check_changes(self, NodeSettings, self._class.Settings)
        parameters.warn_unknown(self, _REPEATED)
        self.core: Learner | None = None
        self.learning = True
        self._conflict = ""  # why nothing is learned any more
        self._saved: Path | None = None  # checkpoint whose content this learner grew from
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="solve")
        self._pretraining: Future[Update] | None = None
        self._solving: Future[Any] | None = None
        self._closing = False
        self._ready = False  # to act, as soon as it is active
        self._watch: Any = None
        self.add_post_set_parameters_callback(self._on_changed)

    # ------------------------------------------------------------ managed

    def configure(self) -> None:
        """Listen for a task; what it needs for that follows then."""
        if self.settings.resume:
            self._checkpoint()
        self._diagnostics_out = self.create_publisher(DiagnosticArray, "/diagnostics", qos.OUTGOING)
        self._own_services = [
            self.create_service(SetBool, "~/learn", self._on_learn),
            self.create_service(Trigger, "~/learn_offline", self._on_learn_offline),
            self.create_service(Trigger, "~/save", self._on_save),
            self.create_service(Trigger, "~/load", self._on_load),
        ]
        self._own_timers = [
            runtime.wall_timer(self, 0.05, self._look_after),
            runtime.wall_timer(self, 1.0, self._diagnose),
        ]
        self._task = TaskListener(self, self._on_task, self._on_conflict)

    def activate(self) -> None:
        """Act, when there is a vehicle and enough was learned."""
        timeout = self.settings.vehicle_timeout
        if self.core is None and timeout:
            self._watch = runtime.wall_timer(self, timeout, self._check_vehicle)
        self._act_if_ready()

    def deactivate(self) -> None:
        """Stop acting; what was learned stays."""
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
        self.destroy_publisher(self._diagnostics_out)
        if self.core is not None:
            self._loop.close()
            self._reports.close()
            for subscription in self._subscriptions_of_demonstrations:
                self.destroy_subscription(subscription)
        self.core, self._ready, self._conflict = None, False, ""

    def close(self) -> None:
        """Finish what is being computed, and save."""
        if not self._closing:
            self._closing = True
            self._worker.shutdown(wait=True)
            self._finish()

    def _finish(self) -> None:
        core = self.core
        if core is not None and core.n_samples and self.get_parameter("checkpoint").value:
            # Printed: after a signal nothing can be logged to the graph any more.
            print(f"learner: {self._save(core)}", file=sys.stderr)

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
        if s.resume:
            path = self._checkpoint()
            checkpoint.load(path, core, s.learner)
            self._saved = path
            self.get_logger().info(f"resumed from {path} at step {core.step}")
        self._demonstrations = Demonstrations(task)
        self._loop = Fleet(
            self, task, self, s.vehicle_timeout, local=self._local, others=s.other_vehicles
        )
        self._reports = Reports(self, core)
        self._reports.weights()
        self._subscriptions_of_demonstrations = [
            self.create_subscription(Float64MultiArray, "sample", self._on_sample, qos.SAMPLES),
            self.create_subscription(
                Float64MultiArray, "demonstration", self._on_demonstration, qos.LATCHED
            ),
        ]
        self.core = core
        if s.resume or not s.wait_for_demonstrations:
            self._ready = True
            self._act_if_ready()
        else:
            topic = self.resolve_topic_name("sample")
            self.get_logger().info(f"{task.name}: waiting for a demonstration on {topic}")

    def _on_conflict(self, text: str) -> None:
        """Somebody says that the task is another one: act and learn no more."""
        if text != self._conflict:
            self.get_logger().error(f"{text}; nothing is learned from now on")
        self._conflict = text
        if self.core is not None:
            self._loop.stop()

    def _check_vehicle(self) -> None:
        self._watch.cancel()
        if self.core is None and self.active:
            timeout = self.settings.vehicle_timeout
            self.fail(no_vehicle(self, self._task.topic, timeout, TASK, qos.TASK))

    def _act_if_ready(self) -> None:
        if self.active and self._ready and not self._conflict and self._pretraining is None:
            self._loop.start()
            self.get_logger().info(f"acting on {self.resolve_topic_name('action')}")

    # ------------------------------------------------------------ in the control loop

    def respond(self, observation: Observation) -> int | None:
        """Answer a vehicle in this process; None while this node does not act."""
        return None if self.core is None else self._loop.respond(observation)

    def transition(self, before: Observation, transition: Transition) -> None:
        """Learn from a step."""
        assert self.core is not None
        if self.learning and self.core.observe(transition):
            self._update(self.core)

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Act on what was learned so far."""
        assert self.core is not None
        self._finish_solving(wait=False)
        return self.core.act(observation.state, explore=self.learning)

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Count the reward, and whether the answer explored."""
        self._reports.answered(observation, source)

    def _update(self, core: Learner) -> None:
        if not self.settings.background:
            self._publish_update(update(core))
        elif self._solving is None:
            self._solving = self._worker.submit(core.begin_update())

    def _finish_solving(self, wait: bool) -> None:
        if self._solving is not None and (wait or self._solving.done()):
            assert self.core is not None
            computed, self._solving = self._solving.result(), None
            self._publish_update(self.core.finish_update(computed))

    def _publish_update(self, update: Update) -> None:
        self._reports.update(update)
        self._reports.weights()
        if not update.healthy:
            self.get_logger().warning(update.text)

    # ------------------------------------------------------------ demonstrations

    def _on_sample(self, message: Any) -> None:
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
        self._finish_solving(wait=False)
        if self._pretraining is not None:
            if self._pretraining.done():
                self._finish_pretraining(self._pretraining)
        elif (
            self.active and not self._conflict and not self._loop.running
            and self._demonstrations.complete()
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
        self._finish_solving(wait=True)
        self._loop.stop()
        self.get_logger().info(f"learning offline from {text}")
        self._pretraining = self._worker.submit(self._pretrain, core, transitions)
        return text

    def _pretrain(self, core: Learner, transitions: Transitions) -> Update:
        return core.pretrain(transitions, lambda share: not self._closing)

    def _finish_pretraining(self, pretraining: Future[Update]) -> None:
        self._pretraining = None
        self._demonstrations.forget_end()
        try:
            result = pretraining.result()
        except InputError as error:
            self.get_logger().error(f"{error}; waiting for another demonstration")
            return
        self.get_logger().info(result.text)
        self._publish_update(result)
        self._ready = True
        self._act_if_ready()

    # ------------------------------------------------------------ services and parameters

    def _on_learn(self, request: Any, response: Any) -> Any:
        self.learning = request.data
        response.success = True
        response.message = "learning" if self.learning else "acting greedily, not learning"
        return response

    def _on_learn_offline(self, _: Any, response: Any) -> Any:
        try:
            response.message = self._start_pretraining(self._idle_core())
            response.success = self._pretraining is not None
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
            core = self._idle_core()
            self._finish_solving(wait=True)
            path = self._checkpoint()
            checkpoint.load(path, core, self.settings.learner)
            self._saved = path
            self._reports.weights()
            self._ready = True
            self._act_if_ready()
            response.success, response.message = True, f"loaded {path}"
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _idle_core(self) -> Learner:
        """The learner, while no other thread is at work on it."""
        if self.core is None:
            raise InputError(f"no vehicle was heard yet on {self.resolve_topic_name('task')}")
        if self._pretraining is not None:
            raise InputError("it is learning from demonstrations; allowed: when that has ended")
        return self.core

    def _save(self, core: Learner) -> str:
        if self._pretraining is None:
            self._finish_solving(wait=True)
        path = self._checkpoint()
        if path != self._saved and path.exists():
            kept = checkpoint.set_aside(path)
            self.get_logger().warning(f"{path} was there already; it is {kept} now")
        checkpoint.save(path, core, self.settings.learner)
        self._saved = path
        return f"saved {path}"

    def _checkpoint(self) -> Path:
        name = str(self.get_parameter("checkpoint").value)
        if not name:
            raise InputError("parameter checkpoint is empty; allowed: the path of a file")
        return Path(name).expanduser()

    def _on_changed(self, _: Any) -> None:
        if self.core is not None:
            self.core.settings = parameters.read(self, self._class.Settings)

    # ------------------------------------------------------------ how it is

    def _phase(self) -> str:
        if self.core is None:
            return "waiting for a vehicle"
        if self._pretraining is not None:
            return "learning offline"
        if not self._loop.running:
            return "inactive" if self._ready or not self.active else "waiting for a demonstration"
        return "learning" if self.learning else "acting"

    def _diagnose(self) -> None:
        level, text = DiagnosticStatus.OK, self._phase()
        values: dict[str, object] = {"phase": text, "learner": self.settings.learner}
        if self.core is not None:
            values |= {
                "task": self.core.task.name,
                "demonstrated samples": len(self._demonstrations),
                "messages ignored": self._loop.invalid,
                **{f"samples of {name}": count for name, count in self._loop.counts.items()},
            }
            condition, worry = self._reports.condition()
            values |= condition
            if worry:
                level, text = DiagnosticStatus.WARN, f"{text}; {worry}"
        if self._conflict:
            level, text = DiagnosticStatus.ERROR, self._conflict
        message = diagnostics(self, "learning", level, text, values)
        runtime.publish(self._diagnostics_out, message)


def main() -> int:
    """Run the learner."""
    return runtime.main(LearnerNode, "learner")
