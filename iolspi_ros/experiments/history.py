"""What happened in a run, from a graph or without one, for whoever reports on it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.online import Update
from iolspi_ros.core.refresh import Judgement

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Policy:
    """The weights after one update.

    Attributes
    ----------
    number : int
        Of the update; 0 for offline LSPI.
    time : float
        Vehicle time at which they came into use [s].
    weights : ndarray of shape (n_actions, size)
    condition : float
        Of the solve.
    status : str
        Of the solve.
    judgement : Judgement, optional
        Why these weights, when policies were compared.
    """

    number: int
    time: float
    weights: Array
    condition: float
    status: str
    judgement: Judgement | None = None

    @classmethod
    def of(cls, update: Update, time: float, weights: Array) -> Policy:
        """Weights in use after an update."""
        solve = update.solve
        return cls(update.number, time, weights, solve.condition, solve.status, update.judgement)


@dataclass
class History:
    """A run of demonstration, offline and online learning.

    Attributes
    ----------
    dt : float
        Sampling time [s].
    demonstrated : list of ndarray, each of shape (n_dims,)
        States of the samples that were demonstrated.
    episodes : list of list of ndarray
        States of each episode flown while learning.
    scores : list of float
        Sum of rewards of each of them (T: learning score).
    policies : list of Policy
    shown : list of list of ndarray
        States of the episodes flown at the end, greedily and without learning.
    shown_rewards : list of list of float
        What led to each of these states; zero for the first.
    offline : str
        How offline LSPI stopped.
    """

    dt: float
    demonstrated: Sequence[Array] = field(default_factory=list)
    episodes: list[list[Array]] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    policies: list[Policy] = field(default_factory=list)
    shown: list[list[Array]] = field(default_factory=list)
    shown_rewards: list[list[float]] = field(default_factory=list)
    offline: str = ""

    @property
    def vehicle_time(self) -> float:
        """Time that the vehicle moved while learning online [s]."""
        return self.dt * sum(max(len(episode) - 1, 0) for episode in self.episodes)
