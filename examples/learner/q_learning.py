"""A learner of one's own in a page: Q-learning on a table of boxes of the state space.

    iolspi learn --task pendulum --learner q_learning:QLearning     # this folder on the PYTHONPATH
    iolspi run learner --ros-args -p learner:=q_learning:QLearning -p wait_for_demonstrations:=false

C.J.C.H. Watkins and P. Dayan, "Q-learning", Machine Learning 8, 1992. It learns at every step, so
an update has nothing left to compute: it only reports.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from iolspi_ros.core.learner import Source, Update, always
from iolspi_ros.settings import Settings, setting


@dataclass(frozen=True)
class QSettings(Settings):
    """What it takes."""

    boxes: int = setting(20, "boxes along each variable", low=1, high=1000)
    learning_rate: float = setting(0.3, "share of the error that is corrected", low=0.0, high=1.0)
    epsilon: float = setting(0.1, "exploration rate", low=0.0, high=1.0)
    update_interval: int = setting(1000, "steps between two reports", low=1)


@dataclass(frozen=True)
class QState:
    """What is saved."""

    weights: np.ndarray[Any, np.dtype[np.float64]]
    step: int
    n_samples: int
    updates: int
    dropped: int
    rng: dict[str, Any]


class QLearning:
    """Q-learning; a learner as described in iolspi_ros.core.learner.Learner."""

    Settings, State = QSettings, QState
    changeable, shaping = ("learning_rate", "epsilon"), ("boxes",)

    def __init__(self, task: Any, settings: QSettings, rng: np.random.Generator) -> None:
        self.task, self.settings, self.rng = task, settings, rng
        self.low, self.high = np.array(task.low), np.array(task.high)
        self.weights = np.zeros((task.n_actions, settings.boxes**task.n_dims))  # Q, by box
        self.step = self.n_samples = self.updates = self.dropped = 0
        self.changed = 0.0

    @property
    def epsilon(self) -> float:
        return self.settings.epsilon

    def box(self, states: Any) -> Any:
        share = (np.asarray(states) - self.low) / (self.high - self.low)
        places = np.clip(share * self.settings.boxes, 0, self.settings.boxes - 1).astype(int)
        return np.ravel_multi_index(tuple(places.T), (self.settings.boxes,) * self.task.n_dims)

    @property
    def snapshot(self) -> Any:
        return self.weights.copy()

    def values(self, states: Any, snapshot: Any = None) -> Any:
        return (self.weights if snapshot is None else snapshot)[:, self.box(states)].T

    def act(self, state: Any, explore: bool = True) -> tuple[int, Source]:
        if explore and self.rng.random() < self.epsilon:
            return int(self.rng.integers(self.task.n_actions)), Source.EXPLORE
        return int(self.values(state[None])[0].argmax()), Source.EXPLOIT

    def learn(self, t: Any) -> None:
        if not np.isfinite([*t.state, t.reward, *t.next_state]).all():
            self.dropped += 1
            return
        here, there = self.box(np.stack([t.state, t.next_state]))
        following = 0.0 if t.terminated else self.weights[:, there].max()
        error = t.reward + self.task.gamma * following - self.weights[t.action, here]
        self.weights[t.action, here] += self.settings.learning_rate * error
        self.changed += abs(self.settings.learning_rate * error)
        self.n_samples += 1

    def observe(self, transition: Any) -> bool:
        self.learn(transition)
        self.step += 1
        return self.step % self.settings.update_interval == 0

    def pretrain(self, demonstrations: Any, proceed: Any = always) -> Update:
        for transition in demonstrations:
            self.learn(transition)
        return self.report(0)

    def begin_update(self) -> Any:
        return lambda: None

    def finish_update(self, found: Any) -> Update:
        self.updates += 1
        return self.report(self.updates)

    def report(self, number: int) -> Update:
        changed, self.changed = self.changed, 0.0
        visited = float((self.weights != 0.0).mean())
        text = f"update {number}: {visited:.0%} of the table visited"
        return Update(number, self.step, True, True, changed, text, {"visited": visited})

    def health(self) -> dict[str, object]:
        return {}

    def state(self) -> QState:
        rng = dict(self.rng.bit_generator.state)
        counters = (self.step, self.n_samples, self.updates, self.dropped)
        return QState(self.weights.copy(), *counters, rng)

    def restore(self, state: QState) -> None:
        self.weights, self.rng.bit_generator.state = state.weights, state.rng
        self.step, self.n_samples = state.step, state.n_samples
        self.updates, self.dropped = state.updates, state.dropped
