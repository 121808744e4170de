"""SARSA and Q-learning with linear features and eligibility traces (T Algorithms 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Proceed, Update
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.methods.base import MethodSettings, Stepwise
from iolspi_ros.settings import setting
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]
LEAST = 0.1
"""Of φᵀφ: where hardly a function reaches, a step is not made larger than the error."""


@dataclass(frozen=True)
class TraceSettings(MethodSettings):
    """What both take besides."""

    learning_rate: float = setting(
        0.2, "share of the error that is corrected, alpha", low=0.0, high=1.0, low_open=True
    )
    learning_rate_decay: float = setting(
        1.0, "factor on the learning rate per second", low=0.0, high=1.0, low_open=True
    )
    trace: float = setting(0.7, "how long a trace lasts, lambda", low=0.0, high=1.0)
    passes: int = setting(20, "Q-learning: times that demonstrations are gone through", low=1)


class _Traces(Stepwise):
    """w ← w + α δ e, where e ← γ λ e + φ / φᵀφ (Sutton and Barto, Reinforcement Learning, ch. 7).

    Divided by φᵀφ a step corrects the share α of the error, whatever the functions overlap; of
    a table's functions it is 1. T's algorithms are λ = 0.
    """

    Settings: ClassVar[type[Any]] = TraceSettings
    changeable: ClassVar[tuple[str, ...]] = (
        *Stepwise.changeable, "learning_rate", "learning_rate_decay", "trace",
    )  # fmt: skip

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        super().__init__(task, settings, rng)
        self.memory = np.zeros_like(self.weights)  # e

    def correct(self, t: Transition, following: float) -> None:
        """One step towards r + γ times the value that follows."""
        s, gamma = self.settings, self.task.gamma
        phi = self.features(t.state)
        rate = s.learning_rate * s.learning_rate_decay ** (self.step * self.task.sampling_time)
        error = t.reward + gamma * following - float(self.weights[t.action] @ phi)
        self.memory *= gamma * s.trace
        self.memory[t.action] += phi / max(float(phi @ phi), LEAST)
        if np.isfinite(error):
            self.weights += rate * error * self.memory
        if t.terminated or t.truncated:
            self.memory[:] = 0.0

    def best(self, state: Array) -> float:
        """The largest value in a state."""
        return float(self.values(state[None])[0].max())


class QLearning(_Traces):
    """Towards the best that may follow, whatever is done (T Algorithm 2).

    A trace ends where the action is not the best one (Watkins). Demonstrations are gone through
    several times, as if they were flown (T Algorithm 10 sets Q to their mean returns, in a table).
    """

    name = "q_learning"

    def take(self, transition: Transition) -> None:
        """Learn from it."""
        t = transition
        q = self.values(t.state[None])[0]
        if q[t.action] < q.max():
            self.memory[:] = 0.0
        self.correct(t, 0.0 if t.terminated else self.best(t.next_state))

    def inform(self, rows: Transitions, proceed: Proceed) -> Update:
        """Fly through them again and again, with one learning rate."""
        before, passes = self.weights.copy(), self.settings.passes
        flown = list(rows)
        apart = np.append((rows.next_state[:-1] != rows.state[1:]).any(axis=1), True)
        for number in range(passes):
            for t, ends in zip(flown, apart.tolist(), strict=True):
                self.take(t)
                if ends:
                    self.memory[:] = 0.0
            if not proceed((number + 1) / passes):
                break
        return self.report(0, before, True, f"{len(rows)} samples, {number + 1} times")


class Sarsa(_Traces):
    """Towards what follows with the next action that is really taken (T Algorithm 1).

    So a transition waits for the next one. Where the clock cuts an episode, or a message was
    lost, the best action stands for the next.
    """

    name = "sarsa"

    def take(self, transition: Transition) -> None:
        """Learn from the one before, and wait."""
        for before in self.waiting.take():
            if (before.next_state == transition.state).all():
                value = float(self.values(transition.state[None])[0, transition.action])
                self.correct(before, value)
            else:
                self.correct(before, self.best(before.next_state))
                self.memory[:] = 0.0
        if transition.terminated:
            self.correct(transition, 0.0)
        elif transition.truncated:
            self.correct(transition, self.best(transition.next_state))
        else:
            self.waiting.append(transition)
