"""Demonstrated samples as they arrive at the learner."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from iolspi_ros import wire
from iolspi_ros.core.samples import Transition, Transitions

PATIENCE = 2.0
"""Seconds without a new sample after which those still missing are given up."""


class Demonstrations:
    """Keeps each sample once, by (session, episode, step), and knows when all are there.

    Parameters
    ----------
    joints : sequence of str
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._rows = wire.SampleRows(joints)
        self._announcements = wire.Rows("demonstration", wire.DEMONSTRATION)
        self._samples: dict[tuple[int, int, int], Transition] = {}
        self._session = 0
        self._before = 0  # samples of earlier sessions
        self._expected: int | None = None  # once the demonstration has ended
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
        key = (self._session, sample.episode, sample.step)
        self._samples.setdefault(key, sample.transition)
        self._latest = time.monotonic()

    def announce(self, message: Any) -> None:
        """Take the beginning or the end of a demonstration.

        Raises
        ------
        InputError
            When it is no announcement.
        """
        *_, active, samples = self._announcements.read(message)
        if active:
            self._session += 1
            self._before = len(self)
            self._expected = None
        else:
            self._expected = self._before + max(wire.whole(samples), 0)
            self._latest = time.monotonic()

    def complete(self) -> bool:
        """Whether the demonstration has ended and nothing more of it is to be expected."""
        if self._expected is None:
            return False
        return len(self) >= self._expected or time.monotonic() - self._latest > PATIENCE

    def forget_end(self) -> None:
        """Wait for the end of another demonstration."""
        self._expected = None

    def transitions(self) -> tuple[Transitions, int]:
        """All samples in order of (session, episode, step), and how many were lost."""
        lost = max((self._expected or 0) - len(self), 0)
        ordered = [self._samples[key] for key in sorted(self._samples)]
        return Transitions.of(ordered, self._rows.n_dims), lost
