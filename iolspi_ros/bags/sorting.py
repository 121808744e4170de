"""Messages of a bag told apart: by vehicle, and by run, so that none are ever mixed.

On one topic the keys of a run only grow, but for messages that were repeated. One that goes back
to a key whose message was another one belongs to another run: a simulator that was started anew,
or two recordings made one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from iolspi_ros import wire
from iolspi_ros.core.samples import Array, Observation, Sample, transition_between
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

Key = tuple[int, int]
Store = Callable[[int], None]
"""Keeps a message, in the run with a number from 0."""
MOST_RUNS = 50
MOST_CONFLICTS = 2
"""More runs, or more conflicts, are none: several vehicles spoke on one topic at the same time."""


@dataclass
class _Line:
    """Messages of one topic in the run under way.

    Attributes
    ----------
    run : int
        From 0.
    seen : dict
        What the message of each key was.
    held : list
        Messages that were seen before, and may yet turn out to be another run's beginning.
    conflicts : int
        How often the newest key was said twice, and not the same.
    """

    run: int = 0
    seen: dict[Any, int] = field(default_factory=dict)
    first: Any = None
    newest: Any = None
    held: list[tuple[Any, int, Store]] = field(default_factory=list)
    conflicts: int = 0

    def place(self, key: Any, data: bytes, store: Store) -> None:
        """Store a message in its run, once."""
        content = hash(bytes(data))
        if self.seen.get(key) == content:
            if key < self.newest:
                self.held.append((key, content, store))
            return
        held, self.held = self.held, []
        if self.newest is not None and key < self.newest and (key in self.seen or key < self.first):
            self.run, self.seen, self.newest = self.run + 1, {}, None
            for one in held:
                self._keep(*one)
        if key in self.seen:
            self.conflicts += 1
        else:
            self._keep(key, content, store)

    def _keep(self, key: Any, content: int, store: Store) -> None:
        if self.newest is None:
            self.first = self.newest = key
        self.newest = max(self.newest, key)
        self.seen[key] = content
        store(self.run)


@dataclass
class _Run:
    """What one run said."""

    samples: dict[Key, Sample] = field(default_factory=dict)
    states: dict[int, Array] = field(default_factory=dict)
    rewards: dict[Key, tuple[int, Any]] = field(default_factory=dict)
    verdicts: dict[int, bool] = field(default_factory=dict)


class Vehicle:
    """What one vehicle said in a bag.

    Parameters
    ----------
    task : TaskDescription
    """

    def __init__(self, task: TaskDescription) -> None:
        self._task = task
        self._sample_rows = wire.SampleRows(task.names)
        self._reward_rows = wire.RewardRows()
        self._verdict_rows = wire.Rows("verdict", wire.VERDICT)
        self._states = wire.states(task)
        self._lines: dict[str, _Line] = {}
        self._runs: dict[int, _Run] = {}
        self.described: list[TaskDescription] = []
        self.differenced = self.discarded = 0
        self._position: dict[int, tuple[int, Array]] = {}

    def take(self, role: str, topic: str, message: Any, data: bytes) -> None:
        """Take a message.

        Raises
        ------
        InputError
            When it is none of this task.
        """
        if role == "sample":
            sample = self._sample_rows.sample(message)
            key = (sample.episode, sample.step)
            self._place(topic, key, data, lambda n: self._run(n).samples.update({key: sample}))
        elif role == "reward":
            values = self._reward_rows.read(message)
            key = (wire.whole(values[0]), wire.whole(values[1]))
            said = (wire.join(values[2], values[3]), values)
            self._place(topic, key, data, lambda n: self._run(n).rewards.update({key: said}))
        elif role == "verdict":
            episode, *_, kept = self._verdict_rows.read(message)
            run = max((line.run for line in self._lines.values()), default=0)  # under way
            self._run(run).verdicts[wire.whole(episode)] = kept > 0.5
        else:
            self._take_state(topic, message, data)

    def _run(self, number: int) -> _Run:
        return self._runs.setdefault(number, _Run())

    def _place(self, topic: str, key: Any, data: bytes, store: Store) -> None:
        line = self._lines.setdefault(topic, _Line())
        line.place(key, data, store)
        if line.run >= MOST_RUNS or line.conflicts > MOST_CONFLICTS:
            raise InterleavedError(
                f"on {topic} the messages of several vehicles come between each other, and nobody "
                "can tell them apart; allowed: a namespace for each vehicle"
            )

    def _take_state(self, topic: str, message: Any, data: bytes) -> None:
        joints = self._task.joints
        bare = bool(joints) and not len(message.velocity) and len(message.position)
        if bare:
            message.velocity = np.zeros(len(message.position))
        state, stamp = self._states.state(message)

        def store(number: int) -> None:
            if not bare or self._differences(number, state, stamp):
                self._run(number).states[stamp] = state

        self._place(topic, stamp, data, store)

    def _differences(self, run: int, state: Array, stamp: int) -> bool:
        """Fill in velocities that nobody measured; false where there is nothing to do it from."""
        before, self._position[run] = self._position.get(run), (stamp, state)
        if before is None or stamp <= before[0]:
            return False
        step = state[0::2] - before[1][0::2]
        for place, variable in enumerate(self._task.variables[0::2]):
            if variable.periodic:
                period = variable.high - variable.low
                step[place] = (step[place] + period / 2) % period - period / 2
        state[1::2] = step / ((stamp - before[0]) / wire.NANOSECONDS)
        self.differenced += 1
        return True

    def runs(self) -> dict[int, list[Sample]]:
        """Samples of each run that has any, by its number from 1, in order of their keys."""
        whole = {n: run.samples for n, run in self._runs.items() if run.samples}
        if not whole:
            whole = {n: self._paired(n, run) for n, run in self._runs.items()}
        self.discarded = 0
        wanted = {n: self._kept(self._runs[n], by_key) for n, by_key in whole.items()}
        found = {n: [by_key[k] for k in sorted(by_key)] for n, by_key in wanted.items() if by_key}
        return {place: found[n] for place, n in enumerate(sorted(found), 1)}

    def _kept(self, run: _Run, samples: dict[Key, Sample]) -> dict[Key, Sample]:
        """Those of episodes that nobody has discarded; the others are counted."""
        kept = {key: s for key, s in samples.items() if run.verdicts.get(key[0], True)}
        self.discarded += len({key[0] for key in samples}) - len({key[0] for key in kept})
        return kept

    def _paired(self, number: int, run: _Run) -> dict[Key, Sample]:
        """Transitions of states and rewards."""
        seen: dict[Key, Observation] = {}
        for key, (stamp, values) in run.rewards.items():
            state = self._state(number, stamp)
            if state is not None:
                seen[key] = self._reward_rows.observation(values, state, stamp)
        found = {}
        for key, before in seen.items():
            after = seen.get((key[0], key[1] + 1))
            if after is not None:
                transition = transition_between(before, after)
                found[key] = Sample(*key, before.stamp, transition, transition.source)
        return found

    def _state(self, number: int, stamp: int) -> Array | None:
        """The state with a stamp, of a run; of another one where the clock went on over both."""
        own = self._runs[number].states.get(stamp)
        if own is not None:
            return own
        others = [run.states[stamp] for run in self._runs.values() if stamp in run.states]
        return others[0] if len(others) == 1 else None


class InterleavedError(InputError):
    """Messages that nobody can tell apart."""
