"""What a bag of demonstrations holds, and what is odd about it, before anybody learns from it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import wire
from iolspi_ros.bags.card import read_card
from iolspi_ros.bags.demonstration import Demonstration, Finder, Flight
from iolspi_ros.bags.reader import TEXT, Damage, Record, deserialise, records
from iolspi_ros.bags.selection import Selection
from iolspi_ros.core.samples import Sample, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription, Variable

ONE_ACTION = 0.95
"""Share of the samples from which one action is as good as all."""
LITTLE = 0.05
"""Share of the boxes of the state space under which little of it was seen."""
BOXES = 10
"""Along each of the two variables of the map."""
_ANGLES = ("rad",)


@dataclass(frozen=True)
class Contents:
    """What a bag holds.

    Attributes
    ----------
    path : Path
    topics : dict of str to (str, int)
        Type and number of messages of each topic.
    card : dict
    task : TaskDescription, optional
        That which the bag says.
    damage : list of str
    """

    path: Path
    topics: dict[str, tuple[str, int]]
    card: dict[str, object]
    task: TaskDescription | None
    damage: list[str]


def contents(path: Path) -> Contents:
    """Look through a bag, whatever it is of.

    Raises
    ------
    InputError
        When there is none.
    """
    damage, topics, task = Damage(), dict[str, tuple[str, int]](), None
    for record in records(path, damage):
        topics[record.topic] = (record.type, topics.get(record.topic, ("", 0))[1] + 1)
        if (task is None and record.topic.endswith("/task")) or record.topic == "task":
            task = _task(record, path, damage)
    return Contents(path, topics, read_card(path) if path.is_dir() else {}, task, damage.notes)


def _task(record: Record, path: Path, damage: Damage) -> TaskDescription | None:
    """The task that a message describes; None when it is something else, or none, with a note."""
    if record.type != TEXT:
        return None
    try:
        return wire.read_task(deserialise(record), f"bag {path}")
    except InputError as error:
        damage.notes.append(str(error))
        return None


def flights(path: Path, task: TaskDescription, selection: Selection) -> list[Flight]:
    """Every run of every vehicle in a bag that has a transition of a task."""
    card = read_card(path) if path.is_dir() else {}
    finder = Finder(task, f"bag {path}", selection.with_card(card))
    for record in records(path, Damage()):
        finder.take(record)
    return [
        flight for flight in finder.flights()
        if selection.vehicle in ("", flight.vehicle) and selection.run in (0, flight.run)
    ]  # fmt: skip


def oddities(demonstration: Demonstration) -> list[str]:
    """What is wrong with a demonstration, or odd, in sentences; empty for nothing."""
    samples, task = demonstration.samples, demonstration.task
    batch = demonstration.transitions()
    return [
        *demonstration.notes,
        *_numbers(batch, task),
        *(text for n, v in enumerate(task.variables) for text in _variable(v, batch.state[:, n])),
        *_actions(batch, task),
        *_times(samples, task),
        *_coverage(batch, task),
    ]


def _numbers(batch: Transitions, task: TaskDescription) -> Iterator[str]:
    bad = len(batch) - int(batch.usable(task.n_actions).sum())
    if bad:
        yield f"{bad} of {len(batch)} samples are not usable: not finite, or no action of the task"
    if np.isfinite(batch.reward).any() and np.ptp(batch.reward[np.isfinite(batch.reward)]) == 0.0:
        yield f"every reward is {batch.reward[0]:g}: nothing can be learned from that"
    if not (batch.terminated | batch.truncated).any():
        yield "no episode has an end"


def _variable(variable: Variable, values: np.ndarray) -> Iterator[str]:
    values = values[np.isfinite(values)]
    if not len(values):
        return
    low, high = float(values.min()), float(values.max())
    if low == high:
        yield f"{variable.name} never moves: it is {low:g} in every sample"
        return
    beyond = float(((values < variable.low) | (values > variable.high)).mean())
    if beyond:
        yield (
            f"{variable.name} is beyond its limits {variable.low:g} to {variable.high:g} in "
            f"{beyond:.1%} of the samples: from {low:g} to {high:g}"
        )
    span = variable.high - variable.low
    if variable.unit in _ANGLES and max(abs(low), abs(high)) > 4 * math.pi:
        yield f"{variable.name} reaches {max(abs(low), abs(high)):g} rad: are these degrees?"
    elif math.isfinite(span) and high - low < span / 100:
        yield (
            f"{variable.name} moves from {low:g} to {high:g} alone, less than a hundredth of its "
            "limits: is the unit right?"
        )


def _counts(batch: Transitions, task: TaskDescription) -> tuple[NDArray[np.int64], list[str]]:
    """How often each action was taken, and the names of those that never were."""
    known = batch.action[(batch.action >= 0) & (batch.action < task.n_actions)]
    counts = np.bincount(known, minlength=task.n_actions)
    return counts, [task.actions[n].name for n in np.flatnonzero(counts == 0)]


def _actions(batch: Transitions, task: TaskDescription) -> Iterator[str]:
    counts, never = _counts(batch, task)
    if never:
        yield f"never taken: {', '.join(never)}"
    most = int(counts.argmax())
    if len(never) < task.n_actions - 1 and counts[most] > ONE_ACTION * len(batch):
        share = counts[most] / len(batch)
        yield f"{task.actions[most].name} is taken {share:.0%} of the time"
    if len(never) == task.n_actions - 1:
        yield f"{task.actions[most].name} is taken all the time"


def _times(samples: list[Sample], task: TaskDescription) -> Iterator[str]:
    stamps = np.array([s.stamp for s in samples], float) / 1e9
    keys = np.array([(s.episode, s.step) for s in samples])
    if len(samples) < 2:
        return
    neighbours = (np.diff(keys[:, 0]) == 0) & (np.diff(keys[:, 1]) == 1)
    steps = np.diff(stamps)[neighbours]
    wanted = task.sampling_time
    if len(steps) and not 0.8 < np.median(steps) / wanted < 1.25:
        yield f"the sampling time is {np.median(steps):.4g} s; the task's is {wanted:g} s"
    late = int((steps > 1.5 * max(wanted, float(np.median(steps)) if len(steps) else 0)).sum())
    if late:
        yield f"{late} steps took longer than 1.5 sampling times"


def _coverage(batch: Transitions, task: TaskDescription) -> Iterator[str]:
    share = coverage(batch, task)
    if share is not None and share < LITTLE:
        names = " and ".join(task.names[n] for n in task.map_dims)
        yield f"only {share:.1%} of the boxes of {names} were seen"


def extent(batch: Transitions, task: TaskDescription) -> str:
    """What a set covers so far, in words."""
    share, (_, never) = coverage(batch, task), _counts(batch, task)
    names = " and ".join(dict.fromkeys(task.names[n] for n in task.map_dims))
    return ", ".join([
        f"{len(batch)} samples",
        *([] if share is None else [f"{share:.0%} of the boxes of {names} seen"]),
        *([f"never taken: {', '.join(never)}"] if never else []),
    ])  # fmt: skip


def coverage(batch: Transitions, task: TaskDescription) -> float | None:
    """Share of the boxes of the two map variables that have a sample; None without limits."""
    x, y = task.map_dims
    low, high = np.array(task.low)[[x, y]], np.array(task.high)[[x, y]]
    if not np.isfinite(high - low).all() or not len(batch):
        return None
    share = (batch.state[:, [x, y]] - low) / (high - low)
    inside = np.isfinite(share).all(axis=1) & (share >= 0).all(axis=1) & (share <= 1).all(axis=1)
    boxes = np.minimum((share[inside] * BOXES).astype(int), BOXES - 1)
    return len(np.unique(boxes, axis=0)) / BOXES ** len({x, y})
