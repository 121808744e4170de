"""The learner node: learns from demonstrations, then acts and learns online (T III-C)."""

from __future__ import annotations

import sys
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime
from iolspi_ros.core import checkpoint
from iolspi_ros.core.learner_settings import LearnerSettings
from iolspi_ros.core.online import OnlineLSPI, Source, Update
from iolspi_ros.core.samples import Observation, Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.demonstrations import Demonstrations
from iolspi_ros.nodes.reports import Reports
from iolspi_ros.nodes.seat import Seat
from iolspi_ros.settings import Settings, setting

CHANGEABLE = (
    "epsilon", "epsilon_decay", "epsilon_min", "update_interval", "forget_factor", "gamma",
    "delta", "chi", "max_iterations", "scaling", "refresh_iterations", "refresh_budget",
)  # fmt: skip


@dataclass(frozen=True)
class NodeSettings(Settings):
    """What the learner node adds to the algorithm."""

    task: str = setting("pendulum", "name kept in checkpoints, so that they are not mixed up")
    joints: tuple[str, ...] = setting(("shaft",), "joints of the state, in its order")
    neutral: int = setting(1, "action that does nothing, for states without an answer", low=0)
    seed: int = setting(0, "of first weights, exploration and ties", low=0)
    informed: bool = setting(True, "wait for a demonstration and learn from it before acting")
    background: bool = setting(
        False, "solve beside the control thread (real time) instead of inline (lockstep)"
    )
    checkpoint: str = setting("", "file to save to, also at the end; empty for none")
    resume: bool = setting(False, "start from the checkpoint instead of from nothing")
    simulator_timeout: float = setting(
        10.0, "give up when no state came for this long at the start [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


class Learner(Node):
    """Takes `state`, `reward`, `sample`, `demonstration`; publishes `action` and reports."""

    def __init__(self) -> None:
        super().__init__("learner")
        self.settings = parameters.declare(self, NodeSettings, ("checkpoint",))
        algorithm = parameters.declare(self, LearnerSettings, CHANGEABLE)
        parameters.check_changes(self, NodeSettings, LearnerSettings)
        parameters.warn_unknown(self)
        if 2 * len(self.settings.joints) != len(algorithm.centers):
            raise InputError(
                f"parameter centers has {len(algorithm.centers)} entries; allowed: "
                f"{2 * len(self.settings.joints)}, position and velocity of {self.settings.joints}"
            )
        self.core = OnlineLSPI(algorithm, np.random.default_rng([self.settings.seed, 1]))
        self.learning = True
        self._saved: Path | None = None  # checkpoint whose content this learner grew from
        if self.settings.resume:
            path = self._checkpoint()
            checkpoint.load(path, self.core, self.settings.task)
            self._saved = path
            self.get_logger().info(f"resumed from {path} at step {self.core.step}")
        self._demonstrations = Demonstrations(self.settings.joints)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="solve")
        self._offline: Future[Update] | None = None
        self._solving: Future[Any] | None = None
        self._closing = False
        self._connect()

    def _connect(self) -> None:
        s = self.settings
        self._seat = Seat(self, s.joints, s.neutral, self, s.simulator_timeout)
        self._reports = Reports(self, self.core)
        self._reports.weights()
        self.create_subscription(Float64MultiArray, "sample", self._on_sample, qos.SAMPLES)
        self.create_subscription(
            Float64MultiArray, "demonstration", self._on_demonstration, qos.LATCHED
        )
        self.create_service(SetBool, "~/learn", self._on_learn)
        self.create_service(Trigger, "~/learn_offline", self._on_learn_offline)
        self.create_service(Trigger, "~/save", self._on_save)
        self.create_service(Trigger, "~/load", self._on_load)
        self.add_post_set_parameters_callback(self._on_changed)
        runtime.wall_timer(self, 0.05, self._look_after)
        runtime.wall_timer(self, 1.0, lambda: self._reports.diagnostics(self._condition()))
        if s.resume or not s.informed:
            self._fly()
        else:
            topic = self.resolve_topic_name("sample")
            self.get_logger().info(f"waiting for a demonstration on {topic}")

    def close(self) -> None:
        """Finish what is being computed, and save."""
        if self._closing:
            return
        self._closing = True
        self._worker.shutdown(wait=True)
        if self.get_parameter("checkpoint").value and self.core.n_samples:
            # Printed: after a signal nothing can be logged to the graph any more.
            print(f"learner: {self._save()}", file=sys.stderr)

    # ------------------------------------------------------------ in the seat

    def transition(self, before: Observation, transition: Transition) -> None:
        """Learn from a step."""
        if self.learning and self.core.observe(transition):
            self._update()

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Act on what was learned so far."""
        self._finish_solving(wait=False)
        return self.core.act(observation.state, explore=self.learning)

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Count the reward, and whether the answer explored."""
        self._reports.answered(observation, source)

    def _update(self) -> None:
        if not self.settings.background:
            self._publish_update(self.core.update())
        elif self._solving is None:
            self._solving = self._worker.submit(self.core.begin_update())

    def _finish_solving(self, wait: bool) -> None:
        if self._solving is not None and (wait or self._solving.done()):
            computed, self._solving = self._solving.result(), None
            self._publish_update(self.core.finish_update(computed))

    def _publish_update(self, update: Update) -> None:
        self._reports.update(update)
        self._reports.weights()
        if not update.solve.healthy:
            self.get_logger().warning(update.describe())

    # ------------------------------------------------------------ demonstrations

    def _on_sample(self, message: Any) -> None:
        try:
            self._demonstrations.add(message)
        except InputError as error:
            self._seat.ignore(str(error))

    def _on_demonstration(self, message: Any) -> None:
        try:
            self._demonstrations.announce(message)
        except InputError as error:
            self._seat.ignore(str(error))

    def _look_after(self) -> None:
        """What no message brings about: the end of a demonstration and of offline learning."""
        self._finish_solving(wait=False)
        if self._offline is not None:
            if self._offline.done():
                self._finish_offline(self._offline)
        elif not self._seat.taken and self._demonstrations.complete():
            self._start_offline()

    def _start_offline(self) -> str:
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
        self._seat.leave()
        self.get_logger().info(f"offline LSPI on {text}")
        self._offline = self._worker.submit(self._inform, transitions)
        return text

    def _inform(self, transitions: Transitions) -> Update:
        return self.core.inform(transitions, lambda iteration, change: not self._closing)

    def _finish_offline(self, offline: Future[Update]) -> None:
        self._offline = None
        self._demonstrations.forget_end()
        try:
            result = offline.result()
        except InputError as error:
            self.get_logger().error(f"{error}; waiting for another demonstration")
            return
        self.get_logger().info(result.describe())
        self._publish_update(result)
        self._fly()

    def _fly(self) -> None:
        self._seat.take()
        self.get_logger().info(f"acting on {self.resolve_topic_name('action')}")

    # ------------------------------------------------------------ services and parameters

    def _on_learn(self, request: Any, response: Any) -> Any:
        self.learning = request.data
        response.success = True
        response.message = "learning" if self.learning else "acting greedily, not learning"
        return response

    def _on_learn_offline(self, _: Any, response: Any) -> Any:
        if self._offline is not None:
            response.success, response.message = False, "offline LSPI is running already"
            return response
        text = self._start_offline()
        response.success, response.message = self._offline is not None, text
        return response

    def _on_save(self, _: Any, response: Any) -> Any:
        try:
            response.message = self._save()
            response.success = True
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_load(self, _: Any, response: Any) -> Any:
        try:
            self._finish_solving(wait=True)
            path = self._checkpoint()
            checkpoint.load(path, self.core, self.settings.task)
            self._saved = path
            self._reports.weights()
            self._fly()
            response.success, response.message = True, f"loaded {path}"
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _save(self) -> str:
        if self._offline is None:
            self._finish_solving(wait=True)
        path = self._checkpoint()
        if path != self._saved and path.exists():
            kept = checkpoint.set_aside(path)
            self.get_logger().warning(f"{path} was there already; it is {kept} now")
        checkpoint.save(path, self.core, self.settings.task)
        self._saved = path
        return f"saved {path}"

    def _checkpoint(self) -> Path:
        name = str(self.get_parameter("checkpoint").value)
        if not name:
            raise InputError("parameter checkpoint is empty; allowed: the path of a file")
        return Path(name).expanduser()

    def _on_changed(self, _: Any) -> None:
        self.core.settings = parameters.read(self, LearnerSettings)

    def _condition(self) -> dict[str, object]:
        if self._offline is not None:
            phase = "offline LSPI"
        elif not self._seat.taken:
            phase = "waiting for a demonstration"
        else:
            phase = "learning" if self.learning else "acting"
        return {
            "phase": phase,
            "demonstrated samples": len(self._demonstrations),
            "messages ignored": self._seat.invalid,
        }


def main() -> int:
    """Run the learner."""
    return runtime.main(Learner, "learner", sys.argv)
