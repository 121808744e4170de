"""What a scripted pilot wants: laws, and the base of those that explore."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MODES = ("perform", "explore")


class Law(Protocol):
    """What a pilot wants in a state."""

    def begin(self) -> None:
        """Start an episode."""
        ...

    def decide(self, state: Array, time: float) -> int:
        """Index of the action for a state, shape (n_dims,), at a time in the episode [s]."""
        ...


class Explorer:
    """Changes its intention every now and then; a task's own says what each of them means."""

    shortest, longest = 0.0, 0.0  # s between two intentions
    intentions: tuple[str, ...] = ()  # drawn from; one that stands twice comes twice as often

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.begin()

    def begin(self) -> None:
        """Start with an intention drawn at random."""
        self.until = 0.0
        self.intention = self.intentions[0]

    def decide(self, state: Array, time: float) -> int:
        """Act on the present intention."""
        if time >= self.until:
            self.intention = self.intentions[int(self.rng.integers(len(self.intentions)))]
            self.until = time + float(self.rng.uniform(self.shortest, self.longest))
        return self.follow(self.intention, state, time)

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Action for an intention in a state."""
        raise NotImplementedError
