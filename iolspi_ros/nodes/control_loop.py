"""The loop from observation to action: a controller answers each observation once."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.vehicle_watch import VehicleWatch
from iolspi_ros.pairing import Pairer
from iolspi_ros.seen import Seen
from iolspi_ros.task import TaskDescription
from iolspi_ros.vitals import SILENCE, Pulse

RESTARTED = 20
"""Observations in a row, all older than the newest, after which they are another run's."""


class Controller(Protocol):
    """Who chooses the actions."""

    def transition(self, before: Observation, transition: Transition) -> None:
        """Take a transition that left `before`; each comes once."""
        ...

    @property
    def busy(self) -> bool:
        """Whether it cannot choose yet; see `ControlLoop.go_on`."""
        ...

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Action for an observation whose state is finite and not the last of its episode."""
        ...

    def answered(self, observation: Observation, source: Source, answer: bytes) -> None:
        """Take an observation and the message that answered it; the vehicle moves already."""
        ...


@dataclass(frozen=True)
class LoopMemory:
    """Where a loop is, for a checkpoint.

    Attributes
    ----------
    seen : Seen
        The newest observation whose transition was taken.
    episode, step : int
        Of the newest one that was answered; -1 for none.
    action, source : int
        The answer.
    """

    seen: Seen
    episode: int
    step: int
    action: int
    source: int


class Host(Protocol):
    """A node that can be ended, as a `managed.ManagedNode` can."""

    def fail(self, error: InputError) -> None:
        """End it, for this reason."""
        ...

    def __getattr__(self, name: str) -> Any: ...


class ControlLoop:
    """Pairs `state` with `reward`, and answers with `action`.

    A repeated observation gets the same answer again; one older than the newest gets none; the
    last of an episode, and one that is not finite, gets a `hold`.

    Parameters
    ----------
    node : Host
    task : TaskDescription
    controller : Controller
    timeout : float
        Seconds from `start` to the first state, after which to give up; 0 for never.
    local : bool
        The vehicle is in this process: it hands its observations to `respond`.
    prefix : str
        Before the names of the vehicle's topics.

    Attributes
    ----------
    note : callable
        Takes each observation that is not a repeated one, before anything is made of it.
    waits : bool
        Whether the vehicle waits for its answers: it did not fly on while one was owed.
    """

    def __init__(
        self,
        node: Host,
        task: TaskDescription,
        controller: Controller,
        timeout: float,
        *,
        local: bool = False,
        prefix: str = "",
    ) -> None:
        self._node, self.task, self._controller = node, task, controller
        self._timeout = timeout
        self._pairer = Pairer(task)
        self._rows = wire.Rows("action", wire.ACTION)
        self._out = node.create_publisher(Float64MultiArray, f"{prefix}action", qos.OUTGOING)
        self._newest = (-1, -1)
        self._older = 0
        self._answer = b""
        self._action, self._source = task.neutral, Source.HOLD
        self._seen: Observation | None = None
        self._waiting: Observation | None = None  # for a controller that is busy
        self._heard = False
        self._watch: VehicleWatch | None = None
        self.running, self.waits = False, True
        self.invalid = 0
        self.pulse = Pulse()
        self._local, self._silent = local, False
        self.note: Callable[[Observation], None] = lambda observation: None
        listened: tuple[tuple[Any, str, Any], ...] = (
            ()
            if local
            else (
                (wire.states(task).type, f"{prefix}state", self._receive_state),
                (Float64MultiArray, f"{prefix}reward", self._receive_reward),
            )
        )
        self._heard_on = [
            node.create_subscription(kind, topic, receive, qos.CONTROL, raw=True)
            for kind, topic, receive in listened
        ]

    def start(self) -> None:
        """Begin to answer."""
        self.running = True
        if self._watch is None and not self._local:
            topic = self._heard_on[0].topic_name
            self._watch = VehicleWatch(self._node, topic, lambda: self._heard, self._timeout)

    def stop(self) -> None:
        """Stop answering; somebody else flies."""
        self.running = False

    def close(self) -> None:
        """Stop listening and publishing."""
        self.stop()
        for subscription in self._heard_on:
            self._node.destroy_subscription(subscription)
        runtime.destroy_publishers(self._node, self._out)
        if self._watch is not None:
            self._watch.close()

    def ignore(self, why: str) -> None:
        """Count an unusable message and say why, not too often."""
        self.invalid += 1
        self._node.get_logger().warning(f"ignored: {why}", throttle_duration_sec=5.0)

    def _receive_state(self, message: Any) -> None:
        self._receive(self._pairer.state, message)

    def _receive_reward(self, message: Any) -> None:
        self._receive(self._pairer.reward, message)

    def _receive(self, pair: Callable[[Any], Observation | None], message: Any) -> None:
        try:
            observation = pair(message)
        except InputError as error:
            self.ignore(str(error))
            return
        self._heard = True
        if observation is not None and self.running:
            self._respond(observation)

    def respond(self, observation: Observation) -> tuple[int, Source] | None:
        """Action and source for an observation of a vehicle in this process; None for none yet."""
        self._heard = True
        if not self.running:
            return None
        self._pairer.take(observation)
        self._respond(observation)
        answered = self._newest == (observation.episode, observation.step)
        return (self._action, self._source) if answered else None

    def _respond(self, observation: Observation) -> None:
        key = (observation.episode, observation.step)
        if key != self._newest:
            self.note(observation)
        if self._started_anew(key):
            return  # what comes next is paired afresh
        if key == self._newest:
            self._publish()
            return
        if key > self._newest:
            self._count(observation)
            self._seen = observation
        for before, transition in self._pairer.transitions(observation):
            self._controller.transition(before, transition)
        if key < self._newest or not self.running:
            return
        waiting = self._waiting
        self.waits &= waiting is None or key == (waiting.episode, waiting.step)
        if self._controller.busy:
            self._waiting = observation
            return
        self._waiting = None
        self._newest = key
        self._action, self._source = self._choose(observation)
        self._pack(observation)
        self._publish()
        self._controller.answered(observation, self._source, self._answer)

    def _count(self, observation: Observation) -> None:
        """Take the pulse of the vehicle."""
        self.pulse.beat()
        seen = self._seen
        if seen is not None and seen.episode == observation.episode:
            self.pulse.lost += max(observation.step - seen.step - 1, 0)

    def _pack(self, observation: Observation) -> None:
        key, stamp = (observation.episode, observation.step), wire.split(observation.stamp)
        self._answer = self._rows.pack(*key, *stamp, self._action, self._source)

    def go_on(self) -> None:
        """Answer what came while the controller was busy."""
        waiting, self._waiting = self._waiting, None
        if waiting is not None and self.running:
            self._respond(waiting)

    @property
    def newest(self) -> tuple[int, int]:
        """Episode and step of what was answered last; -1 for nothing."""
        return self._newest

    @property
    def seen(self) -> Observation | None:
        """The newest observation that came while it was running."""
        return self._seen

    def condition(self) -> tuple[dict[str, object], str]:
        """How it goes, by name, and what is wrong with it; empty for nothing."""
        pulse, period = self.pulse, self.task.sampling_time
        values: dict[str, object] = {
            "messages ignored": self.invalid,
            "observations per second": f"{pulse.rate():.1f}",
            "in real time they would be": f"{1.0 / period:.1f}",
            "steps lost": pulse.lost,
            "seconds since the last observation": f"{pulse.silence:.1f}",
        }
        silent = self.running and pulse.silence > max(SILENCE, 5 * period)
        return values, f"the vehicle has been silent for {pulse.silence:.0f} s" if silent else ""

    def memory(self) -> LoopMemory:
        """Where it is, for a checkpoint."""
        return LoopMemory(Seen.of(self._seen), *self._newest, self._action, int(self._source))

    def recall(self, memory: LoopMemory) -> None:
        """Go on from what `memory` gave: the same observation gets the same answer again.

        Raises
        ------
        InputError
            When it is of another task.
        """
        seen = memory.seen.observation()
        if seen.step < 0:
            return
        answer = 0 <= memory.action < self.task.n_actions and memory.source in set(Source)
        if len(seen.state) != self.task.n_dims or not answer:
            raise InputError(
                f"the newest observation has {len(seen.state)} variables and the answer "
                f"{memory.action}; allowed: those of task {self.task.name}"
            )
        self._pairer.take(seen)
        self._seen, self._newest = seen, (memory.episode, memory.step)
        self._action, self._source = memory.action, Source(memory.source)
        if self._newest == (seen.episode, seen.step):
            self._pack(seen)

    def answer_again(self, observation: Observation) -> None:
        """Go through an observation that was answered before, and say nothing."""
        self._silent, running, self.running = True, self.running, True
        self._pairer.take(observation)
        self._respond(observation)
        self._silent, self.running = False, running

    def _publish(self) -> None:
        if self._silent:
            return
        if not self._local or self._out.get_subscription_count():
            self._out.publish(self._answer)

    def _started_anew(self, key: tuple[int, int]) -> bool:
        """Whether the simulator counts from the beginning again: only old keys for a while."""
        self._older = self._older + 1 if key < self._newest else 0
        if self._older < RESTARTED:
            return False
        self._node.get_logger().warning("the vehicle has started anew")
        self._pairer, self._newest, self._older = Pairer(self.task), (-1, -1), 0
        self._seen = self._waiting = None
        return True

    def _choose(self, observation: Observation) -> tuple[int, Source]:
        finite = all(map(math.isfinite, observation.state.tolist()))
        if not (finite and math.isfinite(observation.reward)):
            self.ignore(
                f"state {observation.state.tolist()} or reward {observation.reward} of step "
                f"{observation.step} of episode {observation.episode} is not finite"
            )
        if observation.last:
            return self.task.neutral, Source.HOLD
        if not finite:
            return (
                observation.action if observation.action >= 0 else self.task.neutral
            ), Source.HOLD
        return self._controller.choose(observation)
