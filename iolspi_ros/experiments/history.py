"""What happened in a run, from a graph or without one, for whoever reports on it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.online import Update
from iolspi_ros.core.refresh import Refresh
from iolspi_ros.core.samples import Observation, Transitions

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
    refresh : Refresh, optional
        Why these weights, when policies were compared.
    """

    number: int
    time: float
    weights: Array
    condition: float
    status: str
    refresh: Refresh | None = None

    @classmethod
    def of(cls, update: Update, time: float, weights: Array) -> Policy:
        """Weights in use after an update."""
        solve = update.solve
        return cls(update.number, time, weights, solve.condition, solve.status, update.refresh)


@dataclass
class Episode:
    """One episode as it was seen.

    Attributes
    ----------
    states : list of ndarray, each of shape (n_dims,)
    rewards : list of float
        What led to each of them; zero for the first.
    terminated : bool
        Whether the task ended there, not the clock.
    whole : bool
        Whether its last state was seen.
    """

    states: list[Array] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    terminated: bool = False
    whole: bool = False

    def take(self, observation: Observation) -> int:
        """Add an observation; those missed before it are filled with it. Returns their number."""
        missed = observation.step - len(self.states)
        self.states += [observation.state] * (missed + 1)
        self.rewards += [observation.reward] * (missed + 1)
        self.terminated, self.whole = observation.terminated, observation.last
        return missed


@dataclass
class History:
    """A run of demonstration, offline and online learning.

    Attributes
    ----------
    dt : float
        Sampling time [s].
    taught : Transitions
        What was demonstrated.
    episodes : list of Episode
        Those flown while learning.
    scores : list of float
        Sum of rewards of each of them (T: learning score).
    policies : list of Policy
    shown : list of Episode
        Those flown at the end, greedily and without learning.
    offline : str
        How offline LSPI stopped.
    """

    dt: float
    taught: Transitions
    episodes: list[Episode] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    policies: list[Policy] = field(default_factory=list)
    shown: list[Episode] = field(default_factory=list)
    offline: str = ""

    @property
    def vehicle_time(self) -> float:
        """Time that the vehicle moved while learning online [s]."""
        return self.dt * sum(max(len(episode.states) - 1, 0) for episode in self.episodes)
