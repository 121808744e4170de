"""One episode on a flying vehicle: its steps, and what was really applied in each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from sim_nodes.tasks.slung_load import SlungLoad

Array = NDArray[np.float64]


class EpisodeClock:
    """Counts steps by the clock, and remembers which action was in force for how long.

    A state that comes late by more than half a step gets the number that its time says, not the
    next one: with a number left out, nobody makes a transition of an interval that is too long.

    Parameters
    ----------
    task : SlungLoad
    number : int
    start : float
        Vehicle time of the first state [s].
    state : ndarray of shape (4,)
    """

    def __init__(self, task: SlungLoad, number: int, start: float, state: Array) -> None:
        self._task = task
        self.number, self.start = number, start
        self.state, self.step = state, 0
        self.time = start
        """Of the newest state [s]."""
        self.answered = -1
        """The newest step that was answered."""
        self.answered_time = start
        """Of the state which that step showed [s]."""
        self.action = task.description.neutral
        self._source = int(Source.HOLD)
        self._held = np.zeros(task.description.n_actions)

    def first(self) -> Observation:
        """The observation that it begins with."""
        return Observation(self.number, 0, self.state)

    def answer(self, step: int, action: int, source: int = -1) -> bool:
        """Take an answer; False when it is older than one that was taken, or of no state yet."""
        if not self.answered < step <= self.step:
            return False
        late = (self.step - step) * self._task.description.sampling_time
        self.answered, self.answered_time = step, self.time - late
        self.action, self._source = action, source
        return True

    def hold(self, action: int, seconds: float) -> None:
        """An action was in force for so long."""
        self._held[action] += seconds

    def due(self, now: float) -> bool:
        """Whether the next state should be shown."""
        return now >= self.start + (self.step + 1) * self._task.description.sampling_time - 1e-6

    def advance(self, now: float, state: Array) -> Observation:
        """The vehicle has come to a state."""
        before, action = self.state, self._applied()
        reward, terminated = self._task.judge(before, state)
        step = max(self.step + 1, round((now - self.start) / self._task.description.sampling_time))
        self.step, self.state, self.time = step, state, now
        cut = not terminated and step >= self._task.description.episode_steps
        source = self._source if action == self.action else Source.HOLD
        return Observation(self.number, step, state, reward, action, terminated, cut, source=source)

    def landed(self, now: float, state: Array, action: int, reward: float) -> Observation:
        """The load is down: the end, with what the task gives for it."""
        self.step, self.state, self.time = self.step + 1, state, now
        return Observation(
            self.number, self.step, state, reward, action, True, False, source=self._source
        )

    def _applied(self) -> int:
        """The action that was in force for the longest part of the step."""
        action = int(np.argmax(self._held)) if self._held.any() else self._task.description.neutral
        self._held[:] = 0.0
        return action
