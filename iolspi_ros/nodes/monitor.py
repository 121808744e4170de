"""Watches a graph from outside: records it, and keeps what a report needs."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs import msg as lifecycle
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from std_msgs.msg import Float64MultiArray, String
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import qos, runtime, wire
from iolspi_ros.bags import BagWriter
from iolspi_ros.core.samples import Array, Observation, Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.history import EpisodeRecord, History, PolicyRecord
from iolspi_ros.pairing import Pairer
from iolspi_ros.task import TaskDescription


class Monitor(Node):
    """Records state, reward, action, sample, the learner's reports and /diagnostics.

    Parameters
    ----------
    task : TaskDescription
    bag : BagWriter, optional
        Where to record; nowhere by default.
    """

    def __init__(self, task: TaskDescription, bag: BagWriter | None = None) -> None:
        super().__init__("monitor")
        self.demonstrated: list[Transition] = []
        self.episodes: list[EpisodeRecord] = []
        self.scores: list[float] = []
        self.interventions: list[int] = []
        self.conditions: dict[str, dict[str, str]] = {}
        """What each node said last on /diagnostics, by its name there."""
        self._offline = ""
        self.missed = 0  # observations that did not reach this recorder
        self._interrupted = False
        self._heard: dict[str, Subscription] = {}
        self._task = task
        self._bag = bag
        self._stamp = 0
        self._newest = (-1, -1)
        self._episode = -1
        self._ended = 0
        self._weights: dict[int, Array] = {}
        self._updates: dict[int, dict[str, float]] = {}
        self._pairer = Pairer(task, qos.RECORDING.depth)
        self._samples = wire.SampleRows(task.names)
        self._scores = wire.ScoreRows()
        self._update_rows = wire.Rows("update", wire.UPDATE)
        self._loop = runtime.Loop(self)
        self.listen("task", String, self._on_task, qos.TASK)
        self.listen("state", wire.states(task).type, self._on_state)
        self.listen("reward", Float64MultiArray, self._on_reward)
        self.listen("action", Float64MultiArray, lambda message: None)
        self.listen("score", Float64MultiArray, self._on_score, qos.REPORTS)
        self.listen("update", Float64MultiArray, self._on_update, qos.REPORTS)
        self.listen("weights", Float64MultiArray, self._on_weights, qos.REPORTS)
        self.listen("/diagnostics", DiagnosticArray, self._on_diagnostics)

    def connected(self) -> bool:
        """Whether a simulator and a learner are heard."""
        needed = {"state", "reward", "score", "update", "weights"}
        return all(self._heard[topic].get_publisher_count() for topic in needed)

    def wait_for_ends(self, episodes: int, patience: float) -> None:
        """Wait until the ends of so many episodes were seen: a score may overtake states.

        What DDS has to send again comes within seconds; after `patience` [s] it is given up.
        """
        until = time.monotonic() + patience
        self.wait(
            lambda: self._ended >= episodes or time.monotonic() > until, 2 * patience, "their ends"
        )

    def listen_to_samples(self) -> None:
        """Listen to the demonstrator, too; one that wants two listeners begins then."""
        self.listen("sample", Float64MultiArray, self._on_sample)

    def interrupt(self) -> None:
        """Let the present or next `wait` end with KeyboardInterrupt."""
        self._interrupted = True

    def wait(self, ready: Callable[[], bool], deadline: float, what: str) -> None:
        """Handle events until `ready`.

        Parameters
        ----------
        ready : callable
        deadline : float
            Seconds to wait at most.
        what : str
            What is waited for, for the message.

        Raises
        ------
        InputError
            At the deadline.
        KeyboardInterrupt
            After `interrupt`.
        """
        end = time.monotonic() + deadline
        while not ready():
            if time.monotonic() > end:
                raise InputError(f"{what} did not happen within {deadline:g} s")
            if self._interrupted:
                raise KeyboardInterrupt
            pause = time.monotonic() + 0.05  # asking at every message would slow the graph
            while time.monotonic() < pause:
                self._loop.once(0.05)

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Call a service and wait for its answer.

        Raises
        ------
        InputError
            When nobody answers, or the answer is that it failed.
        """
        client = self.create_client(kind, service)
        self.wait(client.service_is_ready, 10.0, f"service {service}")
        answers: list[Any] = []

        def asked() -> bool:
            # An answer can be lost while the two sides still discover each other; what is asked
            # for here may be asked for twice.
            if not answers or time.monotonic() - answers[-1][0] > 3.0:
                answers.append((time.monotonic(), client.call_async(request)))
            return any(future.done() for _, future in answers)

        self.wait(asked, 20.0, f"an answer of {service}")
        answer = next(future.result() for _, future in answers if future.done())
        if hasattr(answer, "success") and not answer.success:
            raise InputError(f"{service}: {answer.message}")
        return answer

    def set_parameters(self, node: str, **values: Any) -> None:
        """Set parameters of another node.

        Raises
        ------
        InputError
            When the node refuses one.
        """
        request = SetParameters.Request()
        request.parameters = [Parameter(n, value=v).to_parameter_msg() for n, v in values.items()]
        for result in self.call(SetParameters, f"/{node}/set_parameters", request).results:
            if not result.successful:
                raise InputError(f"/{node}: {result.reason}")

    def change_state(self, node: str, transition: str) -> None:
        """Ask a managed node for a transition, such as "activate".

        Raises
        ------
        InputError
            When it does not make it.
        """
        request = ChangeState.Request()
        request.transition.label = transition
        request.transition.id = getattr(lifecycle.Transition, f"TRANSITION_{transition.upper()}")
        if not self.call(ChangeState, f"/{node}/change_state", request).success:
            raise InputError(f"/{node} refused to {transition}")

    def switch(self, service: str, on: bool) -> None:
        """Call a std_srvs/SetBool service."""
        self.call(SetBool, service, SetBool.Request(data=on))

    def trigger(self, service: str) -> None:
        """Call a std_srvs/Trigger service."""
        self.call(Trigger, service, Trigger.Request())

    def history(self, learned: int) -> History:
        """What was seen; episodes after the first `learned` are those shown at the end."""
        offline = self._updates.get(0)
        first = offline["online_steps"] if offline else 0.0
        policies = [
            self._record(number, row, first)
            for number, row in sorted(self._updates.items())
            if number in self._weights
        ]
        if not policies and self._weights:  # learned before, and not since
            number = max(self._weights)
            policies.append(PolicyRecord(number, 0.0, self._weights[number]))
        return History(
            sampling_time=self._task.sampling_time,
            demonstrations=Transitions.of(self.demonstrated, self._samples.n_dims),
            episodes=self.episodes[:learned],
            scores=self.scores[:learned],
            interventions=self.interventions[:learned],
            policies=policies,
            shown=self.episodes[learned:],
            offline=self._offline,
        )

    def _record(self, number: int, row: dict[str, float], first: float) -> PolicyRecord:
        """A policy, from what the learner said of its update."""
        return PolicyRecord(
            number=number,
            time=(row["online_steps"] - first) * self._task.sampling_time,
            weights=self._weights[number],
            accepted=row["accepted"] > 0.5,
            healthy=row["healthy"] > 0.5,
            facts={name: value for name, value in row.items() if name not in wire.UPDATE},
        )

    def listen(
        self,
        topic: str,
        kind: Any,
        handle: Callable[[Any], None],
        profile: QoSProfile = qos.RECORDING,
    ) -> None:
        """Record a topic, and handle its messages."""
        name = wire.type_name(kind())

        def receive(data: bytes) -> None:
            message = deserialize_message(data, kind)
            handle(message)
            if self._bag is not None:
                self._bag.write(topic, name, self._stamp, data)

        self._heard[topic] = self.create_subscription(kind, topic, receive, profile, raw=True)

    def _on_task(self, message: Any) -> None:
        described = wire.read_task(message, f"topic {self.resolve_topic_name('task')}")
        self._task.check_same(described, "this command", "the vehicle")

    def _on_state(self, message: Any) -> None:
        self._note(self._pairer.state(message))

    def _on_reward(self, message: Any) -> None:
        self._note(self._pairer.reward(message))

    def _note(self, observation: Observation | None) -> None:
        if observation is None:
            return
        key = (observation.episode, observation.step)
        self._stamp = max(self._stamp, observation.stamp)
        if key <= self._newest:
            return  # repeated
        self._newest = key
        if observation.episode != self._episode:
            self._episode = observation.episode
            self.episodes.append(EpisodeRecord())
        self.missed += self.episodes[-1].take(observation)
        self._ended = self._ended + observation.last

    def _on_sample(self, message: Any) -> None:
        self.demonstrated.append(self._samples.sample(message).transition)

    def _on_score(self, message: Any) -> None:
        values = self._scores.read(message)
        self.scores.append(values[4])
        self.interventions.append(wire.whole(values[7]))

    def _on_update(self, message: Any) -> None:
        row = self._update_rows.read_all(message)
        self._updates[wire.whole(row["number"])] = row

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            self.conditions[status.name] = {pair.key: pair.value for pair in status.values}
            self._offline = self.conditions[status.name].get("offline LSPI", self._offline)

    def _on_weights(self, message: Any) -> None:
        weights, number = wire.read_weights(message)
        self._weights[number] = weights

    def close(self) -> None:
        """Hear nothing more; before it is destroyed."""
        self._loop.close()

    @property
    def updates(self) -> int:
        """How many updates were reported, offline LSPI among them."""
        return len(self._updates)


@contextmanager
def watching(task: TaskDescription, bag: BagWriter | None = None) -> Iterator[Monitor]:
    """A monitor in this process; a Ctrl-C ends its `wait` with KeyboardInterrupt."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    monitor = Monitor(task, bag)
    # An exception from a signal handler would land anywhere, also in the executor's C++.
    before = signal.signal(signal.SIGINT, lambda *_: monitor.interrupt())
    try:
        yield monitor
    finally:
        signal.signal(signal.SIGINT, before)
        monitor.close()
        monitor.destroy_node()
        rclpy.try_shutdown()
