"""The transitions of a bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from iolspi_ros import wire
from iolspi_ros.bags.card import read_card
from iolspi_ros.bags.reader import Damage, Record, deserialise, records
from iolspi_ros.core.samples import Sample, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.pairing import Pairer
from iolspi_ros.task import TaskDescription


@dataclass(frozen=True)
class Demonstration:
    """What a bag teaches.

    Attributes
    ----------
    path : Path
    samples : list of Sample
        Each (episode, step) once, in order.
    task : TaskDescription
        That they are of.
    card : dict
        Who flew; empty when nobody said.
    notes : list of str
        What was lost, for a person.
    """

    path: Path
    samples: list[Sample]
    task: TaskDescription
    card: dict[str, Any]
    notes: list[str]

    def transitions(self) -> Transitions:
        """The samples without their keys."""
        return Transitions.of([sample.transition for sample in self.samples], self.task.n_dims)


def read_demonstration(path: Path, task: TaskDescription) -> Demonstration:
    """Read the transitions of a bag.

    They are its `sample` messages; a bag without any is searched for `state` and `reward`, and
    transitions are formed from those. Topics are found by the last part of their name.

    Parameters
    ----------
    path : Path
    task : TaskDescription
        The task that it must be of. A bag from before the topic `task` says at most its name.

    Raises
    ------
    InputError
        When the bag is missing, empty, of another task or has no readable transition.
    """
    card = read_card(path) if path.is_dir() else {}
    if card.get("task", task.name) != task.name:
        raise InputError(f"bag {path} is of task {card['task']!r}; allowed: {task.name!r}")
    damage = Damage()
    found = _Finder(task, f"bag {path}")
    for record in records(path, damage):
        found.take(record)
    samples = found.samples()
    if not samples:
        why = "; ".join([*found.complaints, *damage.notes]) or "it holds " + found.topics()
        raise InputError(
            f"bag {path} has no transition of task {task.name!r}: {why}; allowed: messages on "
            f"sample ({','.join(wire.sample_names(task.names))}), or on state and reward"
        )
    gaps = _gaps(samples)
    notes = [*damage.notes, *found.complaints]
    if gaps:
        notes.append(f"{gaps} steps inside its episodes are missing")
    return Demonstration(path, samples, task, card, notes)


def numbered_through(demonstrations: Sequence[Demonstration]) -> list[Sample]:
    """Samples of several bags as one: no (episode, step) twice, stamps growing."""
    samples: list[Sample] = []
    for demonstration in demonstrations:
        first = demonstration.samples[0]
        episode, stamp = 0, 0
        if samples:
            episode = samples[-1].episode + 1 - first.episode
            stamp = samples[-1].stamp + 1 - first.stamp
        samples += [
            replace(sample, episode=sample.episode + episode, stamp=sample.stamp + stamp)
            for sample in demonstration.samples
        ]
    return samples


class _Finder:
    """Collects samples, and states and rewards in case there are none."""

    def __init__(self, task: TaskDescription, where: str) -> None:
        self._task, self._where = task, where
        self._rows = wire.SampleRows(task.names)
        self._pairer = Pairer(task)
        self._sampled: dict[tuple[int, int], Sample] = {}
        self._paired: dict[tuple[int, int], Sample] = {}
        self._counts: dict[str, int] = {}
        self.complaints: list[str] = []

    def take(self, record: Record) -> None:
        topic = record.topic.rsplit("/", 1)[-1]
        self._counts[record.topic] = self._counts.get(record.topic, 0) + 1
        if topic == "task" and record.type == "std_msgs/msg/String":
            described = wire.read_task(deserialise(record), self._where)
            described.check_same(self._task, self._where, "the vehicle")
        if topic not in ("sample", "state", "reward"):
            return
        try:
            message = deserialise(record)
            if topic == "sample":
                self._take_sample(message)
            else:
                self._take_half(topic, message)
        except InputError as error:
            self._complain(str(error))
        except Exception as error:  # bytes that are no such message
            self._complain(f"a message on {record.topic} is unreadable ({type(error).__name__})")

    def _take_sample(self, message: Any) -> None:
        sample = self._rows.sample(message)
        self._sampled.setdefault((sample.episode, sample.step), sample)

    def _take_half(self, topic: str, message: Any) -> None:
        pair = self._pairer.state if topic == "state" else self._pairer.reward
        observation = pair(message)
        if observation is None:
            return
        for before, transition in self._pairer.transitions(observation):
            key = (before.episode, before.step)
            self._paired[key] = Sample(*key, before.stamp, transition, -1)

    def _complain(self, text: str) -> None:
        if len(self.complaints) < 3 and text not in self.complaints:
            self.complaints.append(text)

    def samples(self) -> list[Sample]:
        chosen = self._sampled or self._paired
        return [chosen[key] for key in sorted(chosen)]

    def topics(self) -> str:
        return ", ".join(f"{n} on {topic}" for topic, n in self._counts.items()) or "no message"


def _gaps(samples: list[Sample]) -> int:
    """Steps missing between the first and the last of each episode."""
    missing = 0
    for before, after in pairwise(samples):
        if before.episode == after.episode:
            missing += after.step - before.step - 1
    return missing
