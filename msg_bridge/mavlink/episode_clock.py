"""One episode on a flying vehicle: its steps, and what was really applied in each."""

from __future__ import annotations

import numpy as np

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink.flown import FlownTask
from msg_bridge.mavlink.motion import Motion


class EpisodeClock:
    """Counts steps by the clock, and remembers which action was in force for how long.

    A state that comes late by more than half a step gets the number that its time says, not the
    next one: with a number left out, nobody makes a transition of an interval that is too long.

    Parameters
    ----------
    task : FlownTask
    number : int
    start : float
        Vehicle time of the first state [s].
    motion : Motion
        The first.
    """

    def __init__(self, task: FlownTask, number: int, start: float, motion: Motion) -> None:
        self._task = task
        self.number, self.start = number, start
        self.motion, self.step = motion, 0
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
        return Observation(self.number, 0, self._task.state(self.motion))

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

    def advance(self, now: float, motion: Motion) -> Observation:
        """The vehicle has come to another state."""
        before, action = self.motion, self._applied()
        reward, terminated = self._task.judge(before, motion)
        step = max(self.step + 1, round((now - self.start) / self._task.description.sampling_time))
        self.step, self.motion, self.time = step, motion, now
        cut = not terminated and step >= self._task.description.episode_steps
        source = self._source if action == self.action else Source.HOLD
        return Observation(
            self.number, step, self._task.state(motion), reward, action, terminated, cut,
            source=source,
        )  # fmt: skip

    def landed(self, now: float, motion: Motion, reward: float) -> Observation:
        """The load is down: the end, with what the task gives for it."""
        self.step, self.motion, self.time = self.step + 1, motion, now
        return Observation(
            self.number, self.step, self._task.state(motion), reward, self._task.release, True,
            False, source=self._source,
        )  # fmt: skip

    def _applied(self) -> int:
        """The action that was in force for the longest part of the step."""
        action = int(np.argmax(self._held)) if self._held.any() else self._task.description.neutral
        self._held[:] = 0.0
        return action
