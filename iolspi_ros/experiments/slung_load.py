"""One realisation of learning to drop the slung load: how every episode ended, what it cost."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy, policy_of
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.samplesets import NOTHING, bag, samples
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.world import World, WorldSettings

ONLINE = LSPISettings(
    algorithm="literal", low=(-6.0, -4.0, -np.pi / 2, -np.pi),
    high=(0.0, 4.0, np.pi / 2, np.pi), centers=(9, 1, 9, 1), periodic=(False,),
    epsilon=1.0, epsilon_decay=0.9992, epsilon_min=0.01,
    envelope_low=(-6.5, -np.inf, -np.pi / 2, -np.inf),
    envelope_high=(3.0, np.inf, np.pi / 2, np.inf),
)  # fmt: skip
"""Online LSPI of T IV-B and 11-1: 324 functions, epsilon from 1 to 0.01.

T gives no decay; this one comes down to 0.01 in 5,800 s, about when 15,000 episodes end.
"""
INFORMED = replace(ONLINE, epsilon=0.01, epsilon_decay=1.0)
"""T 11-1: with demonstrations epsilon is 0.01 from the first episode."""
DEFAULT = replace(
    INFORMED, algorithm="refreshed", basis="rbf", centers=(5, 4, 7, 4), update_interval=500,
    epsilon_min=0.0,
)  # fmt: skip
"""As in config/slung_load.yaml."""
_QUICK = 10


@dataclass(frozen=True)
class SlungLoadRun:
    """What is learned, from where, from what and for how long.

    Attributes
    ----------
    learner : LSPISettings
    initial : str
        As of `SlungLoad`.
    samples : str
        One of `samplesets.SOURCES`, gathered from the task's wide initial conditions.
    episodes : int
    looks : int
        How often policies are judged after the beginning, in equal numbers of episodes.
    """

    learner: LSPISettings = ONLINE
    initial: str = "wide"
    samples: str = NOTHING
    episodes: int = 15_000
    looks: int = 15

    def inputs(self) -> list[Path]:
        """Files that the result depends on."""
        path = bag(self.samples, SlungLoad.description.name)
        return sorted(path.glob("*.mcap")) if path else []

    def quick(self) -> SlungLoadRun:
        """A tenth of the episodes."""
        looks = max(1, self.looks // _QUICK)
        return replace(self, episodes=self.episodes // _QUICK, looks=looks)

    @property
    def counts(self) -> list[int]:
        """Numbers of episodes after which policies are judged, shape (looks + 1,)."""
        return np.linspace(0, self.episodes, self.looks + 1).astype(int).tolist()


def drop(setting: SlungLoadRun, seed: int) -> Mapping[str, Any]:
    """One realisation.

    Returns
    -------
    score : ndarray of float, shape (episodes,)
        Sum of rewards of each episode while learning.
    ending : ndarray of int, shape (episodes,)
        How each ended, as values of `slung_load.Outcome`.
    vetoes : ndarray of int, shape (looks + 1,)
        Of the shield, so far.
    judged : ndarray of int, shape (looks + 1, 5)
        How the greedy policy's episodes end, one from each initial condition, by `Outcome`;
        behind the shield when there is one.
    discounted : ndarray of shape (looks + 1,)
        Their mean discounted return.
    flipped, flipped_discounted
        The same with the shield the other way round: lowered, or raised with what it has learned.
    steps : int
        Flown in all.
    """
    task: Any = SlungLoad(initial=setting.initial)
    core = OnlineLSPI(task.description, setting.learner, np.random.default_rng([seed, 1]))
    wide: Any = SlungLoad()
    demonstrations = samples(setting.samples, wide, seed)
    if demonstrations is not None:
        core.pretrain(demonstrations)
    world = World(task, WorldSettings(), np.random.default_rng([seed, 0]))
    scores, endings, looks = list[float](), list[int](), []

    def ended(score: float, reward: float, terminated: bool) -> None:
        scores.append(score)
        endings.append(int(task.description.ending(reward, terminated)))

    def look() -> None:
        row: list[Any] = [core.vetoes]
        for raised in (setting.learner.shield, not setting.learner.shield):
            shield = replace(core.shield, raised=raised)
            flown = evaluate(task, policy_of(core.weights, core.features, shield))
            row += [np.bincount(flown.ending, minlength=5), flown.discounted_return]
        looks.append(row)

    look()
    for first, last in zip(setting.counts[:-1], setting.counts[1:], strict=True):
        train(world, core, last - first, Listener(on_episode=ended))
        look()
    names = ("vetoes", "judged", "discounted", "flipped", "flipped_discounted")
    found = dict(zip(names, map(np.array, zip(*looks, strict=True)), strict=True))
    return {
        "score": np.array(scores), "ending": np.array(endings, np.int8), **found,
        "steps": core.step,
    }  # fmt: skip


def best(setting: SlungLoadRun, seed: int) -> Mapping[str, Any]:
    """How the near-optimal policy's episodes end; `judged`, `discounted` and `score` of `drop`."""
    task: Any = SlungLoad(initial=setting.initial)
    flown = evaluate(task, near_optimal_policy(task))
    return {
        "judged": np.bincount(flown.ending, minlength=5), "discounted": flown.discounted_return,
        "score": flown.score.mean(),
    }  # fmt: skip
