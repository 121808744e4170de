"""Learning automata: in each box of states a probability for each action (T 4-1-5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.methods.base import MethodSettings, Stepwise
from iolspi_ros.settings import setting
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]


@dataclass(frozen=True)
class AutomataSettings(MethodSettings):
    """What they take besides; nothing explores but the probabilities themselves."""

    learning_rate: float = setting(
        0.05, "share that a probability gains at most", low=0.0, high=1.0, low_open=True
    )
    window: int = setting(
        40, "steps whose rewards an action answers for; T: of four seconds", low=1
    )


class Automata(Stepwise):
    """Linear reward-inaction: p ← p + α β (1 - p) for the action taken, p ← p (1 - α β) for others.

    β is the discounted return of a window of steps, 0 for the worst and 1 for the best that its
    box has seen: the S-model of Narendra and Thathachar, Learning Automata, 1989. Learned from
    when an episode ends, as a window must be over; one that the clock cut tells nothing.
    """

    name = "automata"
    Settings: ClassVar[type[Any]] = AutomataSettings
    changeable: ClassVar[tuple[str, ...]] = (*Stepwise.changeable, "learning_rate", "window")

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        super().__init__(task, settings, rng)
        self.weights = np.full_like(self.weights, 1.0 / task.n_actions)
        self.memory = np.zeros((3, self.features.size))  # worst and best return, visits

    @property
    def epsilon(self) -> float:
        """How often another than the most probable action is drawn, over the boxes visited."""
        seen = self.memory[2] > 0.0
        return float(1.0 - self.weights.max(axis=0)[seen].mean()) if seen.any() else 1.0

    def boxes(self, states: Array) -> NDArray[np.int64]:
        """The box of each state: that of the nearest centre."""
        return self.features(states).argmax(axis=1)

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """Probabilities of the actions."""
        return (self.weights if snapshot is None else snapshot)[:, self.boxes(states)].T

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Draw an action by its probability."""
        if not explore:
            return super().act(state, explore=False)
        p = self.values(state[None])[0]
        action = min(int(np.searchsorted(np.cumsum(p), self.rng.random())), len(p) - 1)
        return action, Source.EXPLOIT if p[action] == p.max() else Source.EXPLORE

    def take(self, transition: Transition) -> None:
        """Keep it until the episode ends."""
        self.waiting.append(transition)
        if transition.terminated or transition.truncated:
            self._learn(self.waiting.take())

    def _learn(self, rows: Transitions) -> None:
        """Judge each action by what came of it."""
        window, n = self.settings.window, len(rows)
        discounts = self.task.gamma ** np.arange(window)
        returns = np.convolve(rows.reward, discounts[::-1])[window - 1 :]
        over = n if rows.terminated[-1] else max(n - window + 1, 0)
        worst, best, visits = self.memory
        for k, box in enumerate(self.boxes(rows.state[:over]).tolist() if over else ()):
            first = not visits[box]
            worst[box] = returns[k] if first else min(worst[box], returns[k])
            best[box] = returns[k] if first else max(best[box], returns[k])
            visits[box] += 1
            if best[box] > worst[box]:
                beta = (returns[k] - worst[box]) / (best[box] - worst[box])
                p = self.weights[:, box]
                p *= 1.0 - self.settings.learning_rate * beta
                p[rows.action[k]] += 1.0 - p.sum()
