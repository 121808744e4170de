"""Scripted pilots: stand-ins for a person at the stick, and they say so wherever they appear.

A task's law says what an attentive pilot would do in a state; `ScriptedPilot` makes it human: it
sees late, foresees imperfectly, and does not change its mind at every step.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.law import MODES, Law

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PilotSettings(Settings):
    """How human the scripted pilot is. Times are vehicle times."""

    mode: str = setting("perform", "do the task well, or explore the states", choices=MODES)
    reaction_delay: float = setting(
        0.03, "age of the state that it reacts to [s]", low=0.0, high=5.0
    )
    hold_time: float = setting(0.02, "shortest time between two decisions [s]", low=0.0, high=5.0)
    prediction_error: float = setting(
        0.2, "standard deviation of its relative error in foreseeing the delay", low=0.0, high=10.0
    )


class ScriptedPilot:
    """A law behind human senses and hands.

    Parameters
    ----------
    task : Task
    settings : PilotSettings
    rng : numpy.random.Generator

    Raises
    ------
    InputError
        When nobody can fly this task.
    """

    def __init__(self, task: Task, settings: PilotSettings, rng: np.random.Generator) -> None:
        make: Callable[[str, np.random.Generator], Law | None] = getattr(
            task, "pilot", lambda mode, rng: None
        )
        law = make(settings.mode, rng)
        if law is None:
            raise InputError(
                f"task {task.description.name!r} has no scripted pilot for mode {settings.mode!r}; "
                "allowed: a task with a member `pilot` that knows this mode"
            )
        self.task, self.settings, self.rng = task.description, settings, rng
        self.law = law
        self._delay = round(settings.reaction_delay / self.task.sampling_time)
        self._hold = max(1, round(settings.hold_time / self.task.sampling_time))
        self.begin()

    def begin(self) -> None:
        """Start an episode with rested hands."""
        self._seen: deque[Array] = deque(maxlen=self._delay + 1)
        self._held, self._wait, self._steps = self.task.neutral, 0, 0
        self.law.begin()

    def act(self, state: Array) -> int:
        """Action of this sampling time; call once a step, in order.

        Parameters
        ----------
        state : ndarray of shape (n_dims,)

        Returns
        -------
        int
        """
        self._seen.append(state)
        if self._wait == 0:
            self._held = self.law.decide(self._foreseen(), self._steps * self.task.sampling_time)
            self._wait = self._hold
        self._wait -= 1
        self._steps += 1
        return self._held

    def _foreseen(self) -> Array:
        """The late state, carried forward along its velocities, not quite right."""
        state = self._seen[0].copy()
        ahead = (len(self._seen) - 1) * self.task.sampling_time
        error = 1.0 + self.settings.prediction_error * float(self.rng.standard_normal())
        if self.task.joints:
            state[0::2] += state[1::2] * ahead * error
        for d, wraps in enumerate(self.task.periodic):
            if wraps:
                low, high = self.task.low[d], self.task.high[d]
                state[d] = (state[d] - low) % (high - low) + low
        return state
