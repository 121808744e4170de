"""One realisation of learning the pendulum: from samples, then online, every policy judged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.experiments.evaluate import (
    Evaluation,
    evaluate,
    evaluate_weights,
    near_optimal_policy,
)  # fmt: skip
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.samplesets import NOTHING, bag, samples
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.pendulum import UPRIGHT_ANGLE, UPRIGHT_TIME, Pendulum
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

LITERAL = LSPISettings(algorithm="literal", centers=(11, 11), periodic=(False,))
"""T Algorithm 2 on T's grid of 11 by 11 functions, K_theta = 1000, epsilon = 0.2."""
REFRESHED = LSPISettings(centers=(11, 11))
HANGING: Any = Pendulum()  # a Task, and a dataclass

_LAST = round(UPRIGHT_TIME / Pendulum.description.sampling_time)
_QUICK = 10
_QUICK_LOOKS = 15


@dataclass(frozen=True)
class PendulumRun:
    """What is learned, where, from what and for how long.

    Attributes
    ----------
    learner : LSPISettings
    task : Pendulum
    world : WorldSettings
    gamma : float
        Discount factor that the learner takes; policies are judged by the task's.
    samples : str
        One of `samplesets.SOURCES`, gathered hanging down.
    seconds : float
        Vehicle time [s].
    looks : int
        How often policies are judged after the beginning, in equal times.
    """

    learner: LSPISettings = LITERAL
    task: Any = HANGING
    world: WorldSettings = WorldSettings()  # noqa: RUF009  frozen
    gamma: float = Pendulum.description.gamma
    samples: str = NOTHING
    seconds: float = 600.0
    looks: int = 30

    def inputs(self) -> list[Path]:
        """Files that the result depends on."""
        path = bag(self.samples)
        return sorted(path.glob("*.mcap")) if path else []

    def quick(self) -> PendulumRun:
        """A tenth of the time, and g changing in a tenth of its time."""
        task = replace(
            self.task,
            g_change_start=self.task.g_change_start / _QUICK,
            g_change_duration=self.task.g_change_duration / _QUICK,
        )
        looks = min(self.looks, _QUICK_LOOKS)
        return replace(self, task=task, seconds=self.seconds / _QUICK, looks=looks)

    @property
    def times(self) -> Array:
        """Vehicle times at which policies are judged [s], shape (looks + 1,)."""
        return np.linspace(0.0, self.seconds, self.looks + 1)


def make(setting: PendulumRun, seed: int) -> OnlineLSPI:
    """The learner of a realisation."""
    task = replace(setting.task.description, gamma=setting.gamma)
    return OnlineLSPI(task, setting.learner, np.random.default_rng([seed, 1]))


def learn(setting: PendulumRun, seed: int) -> Mapping[str, Any]:
    """One realisation.

    Returns
    -------
    time : ndarray of shape (n_looks,)
        At which policies are judged [s].
    discounted : ndarray of shape (n_looks,)
        Mean discounted return from all initial conditions, of the policy then in use, under the
        conditions of that time, without noise.
    upright : ndarray of shape (n_looks,)
        Share of the episodes' last 0.5 s spent within 15° of upright.
    whole : ndarray of shape (n_looks,)
        Share of the episodes that were upright for all of it.
    score : ndarray of shape (n_episodes,)
        Sum of rewards of each episode while learning (T: learning score).
    """
    core = make(setting, seed)
    demonstrations = samples(setting.samples, HANGING, seed)
    if demonstrations is not None:
        core.pretrain(demonstrations)
    task, judged, scores = setting.task, _Judge(setting, core), list[float]()
    world = World(task, setting.world, np.random.default_rng([seed, 0]))
    listener = Listener(
        on_update=lambda update: judged.updated(update.step * task.description.sampling_time),
        on_episode=lambda score, *_: scores.append(score),
    )
    train(world, core, round(setting.seconds / task.description.episode_time), listener)
    judged.updated(np.inf)
    columns = zip(*judged.found, strict=True)
    named = dict(zip(("discounted", "upright", "whole"), map(np.array, columns), strict=True))
    return {"time": setting.times, **named, "score": np.array(scores)}


class _Judge:
    """Judges the policy in use at each of some times."""

    def __init__(self, setting: PendulumRun, core: OnlineLSPI) -> None:
        self._task, self._core = setting.task, core
        self._waiting = setting.times.tolist()
        self._weights = core.weights
        self.found: list[tuple[float, float, float]] = []

    def updated(self, time: float) -> None:
        """Other weights are in use from now on."""
        while self._waiting and self._waiting[0] < time:
            now = self._waiting.pop(0)
            flown = evaluate_weights(self._task, self._weights, self._core.features, now)
            self.found.append(grades(self._task, flown))
        self._weights = self._core.weights


def grades(task: Task, flown: Evaluation) -> tuple[float, float, float]:
    """Discounted return, and how upright episodes end: by time, and as a whole."""
    ends = np.abs(flown.states[-_LAST:, :, 0]) <= UPRIGHT_ANGLE
    return flown.discounted_return, float(ends.mean()), flown.success_fraction


def best(setting: PendulumRun, seed: int) -> Mapping[str, Any]:
    """What the near-optimal policy reaches on the setting's task; nothing else plays a part.

    Returns
    -------
    time, discounted, score : ndarray of shape (n_looks,)
        As in `learn`, under the conditions of each time; `score` without exploration.
    """
    task, times = setting.task, setting.times
    flown = [best_flight(Pendulum(task.initial, g=task.gravity(time))) for time in times]
    return {
        "time": times,
        "discounted": np.array([f.discounted_return for f in flown]),
        "score": np.array([f.score.mean() for f in flown]),
    }


@cache
def best_flight(task: Any) -> Evaluation:
    """Episodes of the near-optimal policy under the conditions of time 0."""
    return evaluate(task, near_optimal_policy(task))
