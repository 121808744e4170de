"""A recording of a robot's own topics as demonstrated samples: no vehicle node was there."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from iolspi_ros.bags import Record, deserialise
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.task.rules import Rules
from msg_bridge.ros.description import Robot
from msg_bridge.ros.sensing import NANOSECONDS, Sensing

CLOSE = 0.02
"""Share of a command's range within which it is that of an action."""


@dataclass
class _Command:
    """Which action the robot's commands were."""

    robot: Robot

    def __post_init__(self) -> None:
        fields = [
            (output.topic, path, np.array(numbers))
            for output in self.robot.outputs
            for path, numbers in output.fields
        ]
        self._fields = [(topic, path, table) for topic, path, table in fields if np.ptp(table)]
        self._said = [np.nan] * len(self._fields)

    def hear(self, topic: str, message: Any) -> None:
        for place, (wanted, path, _) in enumerate(self._fields):
            if _same(wanted, topic):
                self._said[place] = path.number(message)

    @property
    def action(self) -> int:
        """The action whose numbers they are; -1 for none."""
        off = np.zeros(self.robot.task.n_actions)
        for said, (_, _, table) in zip(self._said, self._fields, strict=True):
            off = np.maximum(off, np.abs(table - said) / np.ptp(table))
        best = int(np.argmin(np.nan_to_num(off, nan=np.inf)))
        return best if off[best] <= CLOSE else -1


def is_recording(topics: Iterable[str], robot: Robot) -> bool:
    """Whether a bag with these topics has all that a robot says, and what it was told."""
    needed = {s.topic for s in (*robot.inputs, *robot.sources) if s.topic}
    needed |= {output.topic for output in robot.outputs}
    return all(any(_same(name, topic) for topic in topics) for name in needed)


def samples_of(records: Sequence[Record], robot: Robot) -> list[Sample]:
    """Transitions, one sampling time each, by the times of the recording.

    Parameters
    ----------
    records : sequence of Record
    robot : Robot

    Returns
    -------
    list of Sample
        An episode ends where the rules or the clock end it; where a topic fell silent, or a command
        was none of the actions, the next one begins.
    """
    made = _Maker(robot)
    for record in sorted(records, key=lambda record: record.time):
        made.take(record)
    return made.samples


class _Maker:
    """Makes samples of messages that come in the order of their times."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._sensing, self._command = Sensing(robot), _Command(robot)
        self._topics = {s.topic for s in (*robot.inputs, *robot.sources) if s.topic}
        self._outputs = {output.topic for output in robot.outputs}
        self._step = round(robot.task.sampling_time * NANOSECONDS)
        self._next: int | None = None
        self._before: list[float] | None = None
        self._action = -1
        self._half = False
        self._episode, self._number = 0, 0
        self.samples: list[Sample] = []

    def take(self, record: Record) -> None:
        if self._next is None:
            self._next = record.time + self._step
        while record.time >= self._next - (0 if self._half else self._step // 2):
            if self._half:
                self._tick(self._next)
                self._next += self._step
            else:
                self._action = self._command.action  # what was in force in the middle of the step
            self._half = not self._half
        heard = [name for name in self._topics if _same(name, record.topic)]
        told = [name for name in self._outputs if _same(name, record.topic)]
        if not heard and not told:
            return
        with suppress(InputError):  # what is unreadable was not said
            message = deserialise(record)
            for name in heard:
                self._sensing.hear(name, message, record.time)
            for name in told:
                self._command.hear(name, message)

    def _tick(self, now: int) -> None:
        try:
            state = self._sensing.state(now)
        except InputError:
            self._leave()
            return
        before, self._before = self._before, state
        if before is None:
            return
        if self._action < 0:
            self._leave()
            self._before = state
            return
        judged = self._robot.rules.judge(before, self._action, state)
        full = self._number + 1 >= self._robot.task.episode_steps
        transition = Transition(
            np.array(before), self._action, judged.reward, np.array(state), judged.terminated,
            not judged.terminated and (judged.truncated or full),
        )  # fmt: skip
        key = (self._episode, self._number)
        self.samples.append(Sample(*key, now - self._step, transition, Source.HUMAN))
        self._number += 1
        if transition.terminated or transition.truncated:
            self._leave()

    def _leave(self) -> None:
        """Whatever comes next belongs to another episode."""
        self._before = None
        if self._number:
            self._episode, self._number = self._episode + 1, 0


def relabelled(samples: Iterable[Sample], rules: Rules) -> Iterator[Sample]:
    """The same samples with the rewards and ends that the rules give them."""
    for sample in samples:
        t = sample.transition
        judged = rules.judge(t.state.tolist(), t.action, t.next_state.tolist())
        cut = (t.truncated and not judged.terminated) or judged.truncated
        after = t._replace(reward=judged.reward, terminated=judged.terminated, truncated=cut)
        yield replace(sample, transition=after)


def _same(name: str, topic: str) -> bool:
    """Whether a topic of a bag is that of a name, in whatever namespace it was recorded."""
    name, topic = f"/{name.strip('/')}", f"/{topic.strip('/')}"
    return topic == name or topic.endswith(name)
