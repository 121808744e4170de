"""An observation as a part of a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iolspi_ros.core.samples import Array, Observation
from iolspi_ros.errors import InputError


@dataclass(frozen=True)
class Seen:
    """An observation; its step is -1 for none.

    Attributes
    ----------
    episode, step, stamp, action : int
    terminated, truncated : bool
    numbers : ndarray of shape (1 + n_dims,)
        Reward and state, which need not be finite.
    source : int
    """

    episode: int
    step: int
    stamp: int
    action: int
    terminated: bool
    truncated: bool
    numbers: Array
    source: int = -1

    @classmethod
    def of(cls, seen: Observation | None) -> Seen:
        """From an observation, or none."""
        if seen is None:
            return cls(-1, -1, 0, -1, False, False, np.zeros(1))
        return cls(
            int(seen.episode), int(seen.step), int(seen.stamp), int(seen.action),
            bool(seen.terminated), bool(seen.truncated),
            np.array([seen.reward, *seen.state], float), int(seen.source),
        )  # fmt: skip

    def __post_init__(self) -> None:
        if self.numbers.ndim != 1 or not len(self.numbers):
            raise InputError(f"numbers has shape {self.numbers.shape}; allowed: one dimension")

    def observation(self) -> Observation:
        """The observation."""
        return Observation(
            self.episode, self.step, self.numbers[1:], float(self.numbers[0]), self.action,
            self.terminated, self.truncated, self.stamp, self.source,
        )  # fmt: skip
