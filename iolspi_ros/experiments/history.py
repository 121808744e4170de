"""What happened in a run, from a graph or without one, for whoever reports on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Update
from iolspi_ros.core.samples import Observation, Transitions

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PolicyRecord:
    """The policy after one update.

    Attributes
    ----------
    number : int
        Of the update; 0 for what was learned from demonstrations.
    time : float
        Vehicle time at which it came into use [s].
    weights : ndarray of shape (n_rows, n_columns)
        For the learner's `values`.
    accepted, healthy : bool
        As of the update.
    facts : mapping of str to float
        The learner's own numbers.
    """

    number: int
    time: float
    weights: Array
    accepted: bool = True
    healthy: bool = True
    facts: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, update: Update, time: float, weights: Array) -> PolicyRecord:
        """The policy in use after an update."""
        return cls(update.number, time, weights, update.accepted, update.healthy, update.facts)


@dataclass
class EpisodeRecord:
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
    sampling_time : float
        T_s [s].
    demonstrations : Transitions
    episodes : list of EpisodeRecord
        Those flown while learning.
    scores : list of float
        Sum of rewards of each of them (T: learning score).
    interventions : list of int
        Times that a person took over in each of them; empty where nobody counted.
    policies : list of PolicyRecord
    shown : list of EpisodeRecord
        Those flown at the end, greedily and without learning.
    offline : str
        How learning from demonstrations went.
    """

    sampling_time: float
    demonstrations: Transitions
    episodes: list[EpisodeRecord] = field(default_factory=list)
    scores: list[float] = field(default_factory=list)
    interventions: list[int] = field(default_factory=list)
    policies: list[PolicyRecord] = field(default_factory=list)
    shown: list[EpisodeRecord] = field(default_factory=list)
    offline: str = ""

    @property
    def vehicle_time(self) -> float:
        """Time that the vehicle moved while learning online [s]."""
        return self.sampling_time * sum(
            max(len(episode.states) - 1, 0) for episode in self.episodes
        )
