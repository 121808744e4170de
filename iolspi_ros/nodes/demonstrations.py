"""Demonstrated samples as they arrive at the learner."""

from __future__ import annotations

import time
from typing import Any

from iolspi_ros import wire
from iolspi_ros.core.samples import Sample, Transitions
from iolspi_ros.task import TaskDescription

PATIENCE = 10.0
"""Seconds without a new sample after which those still missing are given up; DDS notices what its
transport dropped at its next heartbeat, every three seconds."""


class Demonstrations:
    """Keeps each sample once, and knows when all of a demonstration are there.

    A sample is known by its key and its content, so neither doubled messages nor the order in
    which `sample` and `demonstration` arrive make a difference.

    Parameters
    ----------
    task : TaskDescription
    """

    def __init__(self, task: TaskDescription) -> None:
        self._rows = wire.SampleRows(task.names)
        self._announcements = wire.Rows("demonstration", wire.DEMONSTRATION)
        self._samples: dict[bytes, Sample] = {}
        self._running: set[bytes] = set()  # of the demonstration that is under way
        self._expected: int | None = None  # once it has ended
        self._latest = 0.0

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, message: Any) -> None:
        """Keep a sample, unless it is there already.

        Raises
        ------
        InputError
            When it is not a sample of this task.
        """
        sample = self._rows.sample(message)
        content = bytes(message.data)
        self._samples.setdefault(content, sample)
        self._running.add(content)
        self._latest = time.monotonic()

    def announce(self, message: Any) -> None:
        """Take the beginning or the end of a demonstration.

        Raises
        ------
        InputError
            When it is no announcement.
        """
        *_, active, samples = self._announcements.read(message)
        self._expected = None if active else max(wire.whole(samples), 0)
        self._latest = time.monotonic()

    def complete(self) -> bool:
        """Whether the demonstration has ended and nothing more of it is to be expected."""
        if self._expected is None:
            return False
        return not self.missing() or time.monotonic() - self._latest > PATIENCE

    def missing(self) -> int:
        """How many samples of the demonstration that has ended did not arrive."""
        return max((self._expected or 0) - len(self._running), 0)

    def forget_end(self) -> None:
        """Wait for the end of another demonstration."""
        self._expected = None
        self._running.clear()

    def transitions(self) -> Transitions:
        """All samples, in order of (episode, step)."""
        ordered = sorted(self._samples.values(), key=lambda s: (s.episode, s.step))
        return Transitions.of([sample.transition for sample in ordered], self._rows.n_dims)
