"""When a learner asks for help: where it has hardly been, or where its shield steps in often."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Source
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription

BOXES = 1000
"""Of the whole state space, about. Whoever enters one visits it, however long they stay."""
SECONDS, LEAST = 0.5, 5
"""Of vehicle time that are looked back on; steps of it at least."""


@dataclass(frozen=True)
class HelpSettings(Settings):
    """When the learner asks a person for help; the vehicle goes on meanwhile."""

    ask_for_help: bool = setting(False, "say on `help` where it is unsure, or vetoed often")
    help_visits: int = setting(
        3, "help: a state is unsure when its box was visited less often than this", low=1
    )
    help_unsure: float = setting(
        0.5, "help: share of the last 0.5 s in such states from which it asks",
        low=0.0, high=1.0, low_open=True,
    )  # fmt: skip
    help_vetoes: float = setting(
        0.3, "help: share of the last 0.5 s vetoed by the shield from which it asks",
        low=0.0, high=1.0, low_open=True,
    )  # fmt: skip


@dataclass(frozen=True)
class Visits:
    """Where a learner has been, for a checkpoint.

    Attributes
    ----------
    boxes : ndarray of int, shape (n, n_dims)
    counts : ndarray of int, shape (n,)
    at : ndarray of int, shape (n_dims,) or (0,)
        The box under way.
    """

    boxes: NDArray[np.int64]
    counts: NDArray[np.int64]
    at: NDArray[np.int64]


class Unsure:
    """Counts visits and vetoes; asks, and goes on asking until it is half as bad.

    Parameters
    ----------
    task : TaskDescription
    settings : HelpSettings

    Attributes
    ----------
    asks : bool
    """

    def __init__(self, task: TaskDescription, settings: HelpSettings) -> None:
        self.settings = settings
        self._low, self._high = np.array(task.low), np.array(task.high)
        self._limited = np.isfinite(self._high - self._low)
        self._n_dims = task.n_dims
        self._each = max(3, round(BOXES ** (1.0 / task.n_dims)))
        self._visits: Counter[bytes] = Counter()
        self._at, self._new = b"", False  # the box under way, and whether it is hardly known
        window = max(LEAST, round(SECONDS / task.sampling_time))
        self._unsure, self._vetoes = deque[bool](maxlen=window), deque[bool](maxlen=window)
        self.asks = False

    def _box(self, state: NDArray[np.float64]) -> bytes:
        """Where a state is; without limits finer near zero, and never without an end."""
        with np.errstate(invalid="ignore", over="ignore"):
            share = np.where(
                self._limited, (state - self._low) / (self._high - self._low), np.arcsinh(state)
            )
            return np.floor(share * self._each).astype(np.int64).tobytes()

    def memory(self) -> Visits:
        """Where it has been."""
        boxes = np.frombuffer(b"".join(self._visits), np.int64).reshape(-1, self._n_dims)
        counts = np.fromiter(self._visits.values(), np.int64, len(self._visits))
        return Visits(boxes.copy(), counts, np.frombuffer(self._at, np.int64).copy())

    def recall(self, visits: Visits) -> None:
        """Go on from what `memory` gave; what is of another task counts for nothing."""
        if visits.boxes.ndim != 2 or visits.boxes.shape[1] != self._n_dims:
            return
        boxes = (np.ascontiguousarray(box).tobytes() for box in visits.boxes)
        self._visits = Counter(dict(zip(boxes, visits.counts.tolist(), strict=False)))
        self._at = visits.at.tobytes()

    def known(self, states: Iterable[NDArray[np.float64]]) -> None:
        """Take states that were demonstrated as visited."""
        for state in states:
            if np.isfinite(state).all():
                self._enter(self._box(state))

    def _enter(self, box: bytes) -> None:
        """Visit a box, unless it is the one before."""
        if box != self._at:
            self._at, self._new = box, self._visits[box] < self.settings.help_visits
            self._visits[box] += 1

    def take(self, state: NDArray[np.float64], source: int) -> None:
        """Take a state, and who chose what was done there."""
        if not np.isfinite(state).all():
            return
        self._enter(self._box(state))
        self._unsure.append(self._new)
        self._vetoes.append(source == Source.SHIELD)
        if len(self._unsure) == self._unsure.maxlen:
            ease = 0.5 if self.asks else 1.0
            s = self.settings
            self.asks = self.unsure >= ease * s.help_unsure or self.vetoes >= ease * s.help_vetoes

    @property
    def unsure(self) -> float:
        """Share of the last steps in states that were hardly visited before."""
        return sum(self._unsure) / max(len(self._unsure), 1)

    @property
    def vetoes(self) -> float:
        """Share of the last steps that the shield vetoed."""
        return sum(self._vetoes) / max(len(self._vetoes), 1)

    @property
    def reason(self) -> str:
        """Why it asks, in words; empty when it does not."""
        if not self.asks:
            return ""
        found = []
        if self.unsure >= 0.5 * self.settings.help_unsure:
            found.append(
                f"it has hardly been where it is now ({self.unsure:.0%} of the last steps)"
            )
        if self.vetoes >= 0.5 * self.settings.help_vetoes:
            found.append(f"its shield vetoed {self.vetoes:.0%} of the last steps")
        return f"asks for help: {', and '.join(found)}"
