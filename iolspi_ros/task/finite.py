"""A task with finitely many states, as tables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FiniteTask:
    """A deterministic task with finitely many states, actions and steps.

    Attributes
    ----------
    successor : ndarray of int32, shape (n_states, n_actions)
        Where each action leads.
    arrival : ndarray of shape (n_states,)
        Reward for arriving in a state.
    goal : ndarray of bool, shape (n_states,)
        Arriving there ends an episode.
    reached : ndarray of shape (horizon + 1,)
        Reward besides, for having reached a goal with the k-th step; the first is never used.
    missed : float
        Reward besides, when the clock ends an episode after `horizon` steps.
    """

    successor: NDArray[np.int32]
    arrival: Array
    goal: NDArray[np.bool_]
    reached: Array
    missed: float

    @property
    def horizon(self) -> int:
        """Most steps of an episode."""
        return len(self.reached) - 1

    @property
    def tables(self) -> tuple[NDArray[np.int32], Array, NDArray[np.bool_], Array, float]:
        """The numbers, for compiled code."""
        return self.successor, self.arrival, self.goal, self.reached, self.missed
