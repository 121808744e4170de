"""Episodes as they are watched: what is going on now, and how those before went."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.task import TaskDescription
from iolspi_ros.task.maps import Limits, map_limits

Array = NDArray[np.float64]

WORDS: dict[int, str] = {
    Source.EXPLOIT: "learner",
    Source.EXPLORE: "learner, exploring",
    Source.HUMAN: "person",
    Source.CORRUPTED: "chance, in the demonstration",
    Source.SCRIPTED: "scripted pilot",
    Source.HOLD: "nobody: neutral",
    Source.SHIELD: "shield",
}
"""Who acts, for people."""
DEMONSTRATED = (Source.HUMAN, Source.CORRUPTED, Source.SCRIPTED)
MOST_EPISODES = 500
"""Whose scores are shown; the oldest go."""
BINS = 40
"""Of a map of visits, each way."""


@dataclass
class Score:
    """How an episode went.

    Attributes
    ----------
    episode : int
    score : float
        Sum of its rewards.
    demonstrated : bool
        Whether not the learner flew most of it.
    interventions : int
    """

    episode: int
    score: float
    demonstrated: bool = False
    interventions: int = 0


@dataclass
class Episodes:
    """What is remembered of the observations of a vehicle.

    Parameters
    ----------
    task : TaskDescription

    Attributes
    ----------
    now : Observation, optional
        The newest.
    scores : dict of int to Score
        By the number of the episode.
    limits : ((x, x), (y, y)), optional
        Of the maps, once something was seen.
    ended : str
        How the last episode ended that the task ended, and not the clock.
    source : int
        Who chose the newest action that was applied; -1 when nobody said.
    visits : ndarray of shape (BINS, BINS)
    """

    task: TaskDescription
    now: Observation | None = None
    scores: dict[int, Score] = field(default_factory=dict)
    limits: Limits | None = None
    ended: str = ""
    source: int = -1
    visits: Array = field(default_factory=lambda: np.zeros((BINS, BINS)))
    _states: list[Array] = field(default_factory=list)
    _sum: float = 0.0
    _steps: int = 0
    _demonstrated: int = 0
    _nobody: int = 0

    def take(self, seen: Observation) -> None:
        """Take an observation; older ones and repeated ones say nothing new.

        An episode that was seen whole, and that somebody flew, has a score.
        """
        before = self.now
        if before is not None and (seen.episode, seen.step) <= (before.episode, before.step):
            return
        self.now = seen
        self.source = seen.source if seen.source >= 0 else self.source
        if np.isfinite(seen.state).all():
            self._states.append(seen.state)
        if seen.step == 0 or before is None or seen.episode != before.episode:
            self._sum, self._steps, self._demonstrated, self._nobody = 0.0, 0, 0, 0
        if seen.step:
            self._sum, self._steps = self._sum + seen.reward, self._steps + 1
            self._demonstrated += seen.source in DEMONSTRATED
            self._nobody += seen.source == Source.HOLD
        if seen.last:
            ending = self.task.endings[int(self.task.ending(seen.reward, seen.terminated))]
            self.ended = ending.name if seen.terminated else ""
        if seen.last and self._steps == seen.step and 2 * self._nobody < self._steps:
            said = self.scores.get(seen.episode)  # the learner's word may have come before
            self.score(said or Score(seen.episode, self._sum))

    def score(self, score: Score) -> None:
        """Take how an episode went: from the learner, or from its rewards if nobody said."""
        if self.now is not None and score.episode == self.now.episode:
            score.demonstrated = 2 * self._demonstrated > self._steps
        self.scores[score.episode] = score
        while len(self.scores) > MOST_EPISODES:
            del self.scores[min(self.scores)]

    def map_of_visits(self) -> Array:
        """How often each place of the map was visited, from the lowest y, shape (BINS, BINS)."""
        if self._states:
            states = np.array(self._states)
            self._states.clear()
            # Without limits of the task the map is of what was seen first.
            self.limits = self.limits or map_limits(self.task, states)
            across, up = states[:, self.task.map_dims].T
            self.visits += np.histogram2d(up, across, bins=BINS, range=self.limits[::-1])[0]
        return self.visits

    def as_shown(self, asked: int) -> dict[str, Any]:
        """The present observation, for the board.

        Parameters
        ----------
        asked : int
            Source of the newest action, for a vehicle that does not say whose it applied.
        """
        seen = self.now
        if seen is None:
            return {}
        source = self.source if seen.step == 0 or seen.source >= 0 else asked
        return {
            "episode": seen.episode, "step": seen.step, "state": seen.state.tolist(),
            "reward": seen.reward, "action": seen.action, "source": source,
            "who": WORDS.get(source, "nobody yet"), "sum": self._sum,
            "ended": self.ended, "stamp": seen.stamp / 1e9,
        }  # fmt: skip
