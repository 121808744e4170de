"""Samples written anew: as a bag, a table, or arrays."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from iolspi_ros import wire
from iolspi_ros.bags.demonstration import Demonstration
from iolspi_ros.bags.reader import TEXT
from iolspi_ros.bags.typestore import types
from iolspi_ros.bags.writer import BagWriter
from iolspi_ros.core.samples import Sample
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription, dump


def pieces(samples: Sequence[Sample]) -> Iterator[list[Sample]]:
    """Samples in runs, each of which begins where the one before it ended."""
    piece: list[Sample] = []
    for sample in samples:
        if piece and not _follows(piece[-1], sample):
            yield piece
            piece = []
        piece.append(sample)
    if piece:
        yield piece


def _follows(before: Sample, sample: Sample) -> bool:
    last = before.transition
    return (
        (sample.episode, sample.step) == (before.episode, before.step + 1)
        and not (last.terminated or last.truncated)
        and np.array_equal(last.next_state, sample.transition.state)
    )


def write_bag(path: Path, samples: Sequence[Sample], task: TaskDescription) -> None:
    """A bag of samples, which says its task.

    Raises
    ------
    InputError
        When it cannot be made.
    """
    rows = wire.SampleRows(task.names)
    with BagWriter(path) as writer:
        said = types().types[TEXT](dump(task))
        writer.write("task", TEXT, 0, bytes(types().serialize_cdr(said, TEXT)))
        for sample in samples:
            writer.write("sample", wire.ROW, sample.stamp, rows.of(sample))


def write_csv(path: Path, found: Demonstration) -> None:
    """A table with one row for each sample, its columns called as on the topic `sample`."""
    names = wire.sample_names(found.task.names)
    try:
        with path.open("x", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            table.writerow(names)
            for s in found.samples:
                t = s.transition
                table.writerow(
                    [s.episode, s.step, *wire.split(s.stamp), *t.state.tolist(), t.action, t.reward,
                     *t.next_state.tolist(), int(t.terminated), int(t.truncated), int(s.source)]
                )  # fmt: skip
    except OSError as error:
        raise refused(path, error) from error


def write_npz(path: Path, found: Demonstration) -> None:
    """Arrays by name: of the transitions, their keys, and the task as JSON."""
    batch = found.transitions()
    try:
        np.savez_compressed(
            os.fspath(path),
            state=batch.state, action=batch.action, reward=batch.reward,
            next_state=batch.next_state, terminated=batch.terminated, truncated=batch.truncated,
            episode=np.array([s.episode for s in found.samples]),
            step=np.array([s.step for s in found.samples]),
            stamp=np.array([s.stamp for s in found.samples]),
            source=np.array([int(s.source) for s in found.samples]),
            task=np.array(dump(found.task)),
        )  # fmt: skip
    except OSError as error:
        raise refused(path, error) from error


def refused(path: Path, error: OSError) -> InputError:
    """A place that cannot be written to."""
    return InputError(
        f"--out {path} cannot be written: {error.strerror}; allowed: a place you may write to"
    )
