"""The learner node: learns from demonstrations, then acts and learns online (T III-C)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime
from iolspi_ros.core.learner import Source, learner_class
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.nodes.learning import Learning, LearningSettings
from iolspi_ros.nodes.saving import Saving, SavingSettings, Vehicle
from iolspi_ros.nodes.unsure import HelpSettings
from iolspi_ros.nodes.vehicle_watch import TASK, VehicleWatch
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener
from iolspi_ros.vitals import Report, Vitals


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
        self._settings = parameters.declare(self, LearningSettings)
        self._help_settings = parameters.declare(self, HelpSettings)
        self._saving = Saving(self)
        learner = learner_class(self._settings.learner)
        parameters.declare(self, learner.Settings, learner.changeable)
        parameters.check_changes(self, LearningSettings, SavingSettings, learner.Settings)
        parameters.warn_unknown(self, _REPEATED)
        self.vehicle: Vehicle | None = None
        """The vehicle, when it is in this process and to be saved, too."""
        self._learning: Learning | None = None  # from the task on
        self._enabled = True  # to learn online
        self._conflict = ""  # why nothing is learned any more
        self._closed = False
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
            self.create_service(Trigger, "~/learn_offline", self._serve(Learning.learn_offline)),
            self.create_service(Trigger, "~/save", self._serve(Learning.save)),
            self.create_service(Trigger, "~/load", self._serve(Learning.load)),
        ]
        self._own_timers = [runtime.wall_timer(self, 0.05, self._look_after)]
        self._task = TaskListener(self, self._on_task, self._on_conflict)

    def activate(self) -> None:
        """Act, when there is a vehicle and enough was learned."""
        if self._learning is not None:
            self._learning.act_if_ready()
        elif self._watch is None:
            self._watch = VehicleWatch(
                self, self._task.topic, lambda: self._learning is not None,
                self._settings.vehicle_timeout, TASK, qos.TASK,
            )  # fmt: skip

    def deactivate(self) -> None:
        """Stop acting; what was learned stays."""
        if self._watch is not None:
            self._watch.close()
            self._watch = None
        if self._learning is not None:
            self._learning.stop()

    def cleanup(self) -> None:
        """Save, and forget vehicle and learner."""
        self._end()
        self._task.close()
        for timer in self._own_timers:
            self.destroy_timer(timer)
        for service in self._own_services:
            self.destroy_service(service)
        self._vitals.close()
        if self._learning is not None:
            self._learning.close()
        self._learning, self._conflict = None, ""

    def close(self) -> None:
        """Save."""
        if not self._closed:
            self._closed = True
            self._end()

    def _end(self) -> None:
        """Save what is known, and let others have the place."""
        saved = False
        try:
            saved = self._learning is not None and self._learning.end()
        finally:
            self._saving.close(all_saved=saved)

    # ------------------------------------------------------------ the task

    def _on_task(self, task: TaskDescription) -> None:
        """Make the learner: there is a vehicle."""
        try:
            self._check(task)
            self._learning = Learning(
                self, task, self._settings, self._help_settings, self._saving, self.vehicle,
                local=self._local, may_act=lambda: self.active and not self._conflict,
            )  # fmt: skip
            self._learning.enabled = self._enabled
            self._learning.begin()
        except InputError as error:
            self.fail(error)

    def _check(self, task: TaskDescription) -> None:
        for name, value in repeated(task).items():
            if name in self.given and self.given[name] != value:
                raise InputError(
                    f"parameter {name} is {self.given[name]!r} in what the learner was given, and "
                    f"{value!r} in the task of the vehicle on {self._task.topic}; allowed: the "
                    "same, or leave it out"
                )

    def _on_conflict(self, text: str) -> None:
        """Somebody says that the task is another one: act and learn no more."""
        if text != self._conflict:
            self.get_logger().error(f"{text}; nothing is learned from now on")
        self._conflict = text
        if self._learning is not None:
            self._learning.stop()

    def _look_after(self) -> None:
        if self._learning is not None:
            self._learning.look_after()

    def respond(self, observation: Observation) -> tuple[int, Source] | None:
        """Answer a vehicle in this process; None while this node does not act."""
        return None if self._learning is None else self._learning.respond(observation)

    # ------------------------------------------------------------ services and parameters

    def _on_learn(self, request: Any, response: Any) -> Any:
        self._enabled = request.data
        if self._learning is not None:
            self._learning.enabled = self._enabled
        response.success = True
        response.message = "learning" if self._enabled else "acting greedily, not learning"
        return response

    def _serve(self, act: Callable[[Learning], str]) -> Callable[[Any, Any], Any]:
        """A service that does this with the learner, and says in words what came of it."""

        def answer(_: Any, response: Any) -> Any:
            try:
                if self._learning is None:
                    topic = self.resolve_topic_name("task")
                    raise InputError(f"no vehicle was heard yet on {topic}")
                response.message, response.success = act(self._learning), True
            except InputError as error:
                response.message, response.success = str(error), False
            return response

        return answer

    def _on_changed(self, _: Any) -> None:
        if self._learning is not None:
            self._learning.read_settings()

    # ------------------------------------------------------------ how it is

    def _diagnose(self) -> Report:
        learning = self._learning
        report = Report("waiting for a vehicle" if learning is None else learning.phase())
        report.values["learner"] = self._settings.learner
        if learning is not None:
            learning.describe(report)
        condition, worry = self._saving.condition(time.monotonic())
        report.values |= condition
        report.worry(worry, DiagnosticStatus.ERROR)
        report.worry(self._conflict, DiagnosticStatus.ERROR)
        return report


def main() -> int:
    """Run the learner."""
    return runtime.main(LearnerNode, "learner")
