"""Learning to drop the slung load with an expert at its side, who takes over when it goes wrong.

So does a person in HIL-SERL (Luo et al., arXiv:2410.21845).

The expert flies as dynamic programming would, and judges by its values. Nobody here is a person:
it is what a very good one might do. One who watches sees a mistake when it has been made, 0.2 s
late, and a release is over before anybody could stop it; one who confirms is asked before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.core.learner import Source, Update, greedy_policy, update
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy
from iolspi_ros.experiments.headless import Listener, make_learner, train
from iolspi_ros.experiments.samplesets import NOTHING, samples
from iolspi_ros.methods.near_optimal import NearOptimal
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load.dynamics import Outcome
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

NOBODY, WATCHING, CONFIRMING = "nobody", "watching", "confirming"
HELPERS = (NOBODY, WATCHING, CONFIRMING)
GOAL, IN_A_ROW = 0.95, 3
"""Greedy dunks that are wanted, from all starts, after so many updates one after the other."""
DELAY = 2
"""Steps of 0.1 s until one who watches has taken over."""
ALONE = {"epsilon": 1.0, "epsilon_decay": 0.98, "epsilon_min": 0.01}  # from nothing: T 11-1


@dataclass(frozen=True)
class InterventionRun:
    """What is learned, from what, with whom, and for how long.

    Attributes
    ----------
    helper : str
        One of `HELPERS`.
    loss : float
        How much of the return that could be had is lost when it goes wrong; the best flights return
        56 in the mean, and each step that they come later costs 2.
    stays : int
        Episodes that the helper is there for; 0 for all.
    samples : str
        One of `samplesets.SOURCES`.
    episodes : int
    """

    helper: str = NOBODY
    loss: float = 30.0
    stays: int = 0
    samples: str = NOTHING
    episodes: int = 400


class Watched:
    """A learner with an expert who may take the vehicle; what they fly counts as demonstrated.

    Once taken, the vehicle stays with the expert to the end of the episode.

    Parameters
    ----------
    learner : OnlineLSPI
    expert : NearOptimal
    setting : InterventionRun

    Attributes
    ----------
    takeovers : list of bool
        Whether there was one, of each episode begun.
    """

    def __init__(self, learner: OnlineLSPI, expert: NearOptimal, setting: InterventionRun) -> None:
        self._learner, self._expert, self._setting = learner, expert, setting
        self._gamma = learner.task.gamma
        self.takeovers: list[bool] = []
        self.begin()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._learner, name)

    def begin(self) -> None:
        """An episode begins, in the learner's hands."""
        self._held, self._wrong_for = False, 0
        self._had, self._steps, self._best = 0.0, 0, 0.0

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """The learner's choice, or the expert's."""
        if not self._steps:
            self.takeovers.append(False)
        mine = self._learner.act(state, explore)
        setting = self._setting
        gone = 0 < setting.stays < len(self.takeovers)
        if setting.helper == NOBODY or gone:
            return mine
        self._held = self._held or self._takes(self._expert.q(state[None, :], 1)[0], mine[0])
        self.takeovers[-1] |= self._held
        return (int(self._expert(state[None, :])[0]), Source.HUMAN) if self._held else mine

    def _takes(self, q: Array, chosen: int) -> bool:
        """Whether the expert takes over, where each action is worth q."""
        if self._setting.helper == CONFIRMING:
            return bool(q.max() - q[chosen] > self._setting.loss)
        still = self._had + self._gamma**self._steps * float(q.max())
        self._best = self._best if self._steps else still
        self._wrong_for += self._best - still > self._setting.loss
        return self._wrong_for > DELAY

    def observe(self, transition: Transition) -> bool:
        """Learn from a step, whoever flew it."""
        who = Source.HUMAN if self._held else Source.EXPLOIT
        due = self._learner.observe(transition._replace(source=who))
        self._had += self._gamma**self._steps * transition.reward
        self._steps += 1
        if transition.terminated or transition.truncated:
            self.begin()
        return due


def help_learning(setting: InterventionRun, seed: int) -> Mapping[str, Any]:
    """One realisation.

    Returns
    -------
    ending : ndarray of int, shape (episodes,)
        How each episode ended, as values of `slung_load.Outcome`.
    taken : ndarray of bool, shape (episodes,)
        Whether the expert took over.
    dunks : ndarray of shape (episodes,)
        Share of the starts from which the greedy policy in use after each episode dunks.
    until : int
        Episodes until that was `GOAL` or more after `IN_A_ROW` updates; `episodes` when never.
    reached : bool
    """
    task: Any = SlungLoad()
    file = resources.config(task.description.name)
    values = resources.parameters(file, "learner") if file else {}
    if setting.samples == NOTHING:
        values |= ALONE
    core: Any = make_learner("iolspi", task.description, values, str(file), seed)
    demonstrations = samples(setting.samples, task, seed)
    if demonstrations is not None:
        core.pretrain(demonstrations)
    watched: Any = Watched(core, near_optimal_policy(task), setting)
    record = _Record(task, core)
    world = World(task, WorldSettings(), np.random.default_rng([seed, 0]))
    listener = Listener(
        lambda *_: None,  # step by step: the expert looks at each
        record.updated, record.ended, lambda _: update(core),
    )  # fmt: skip
    train(world, watched, setting.episodes, listener)
    reached = record.until is not None
    return {
        "ending": np.array(record.endings, np.int8), "taken": np.array(watched.takeovers),
        "dunks": np.array(record.dunks), "reached": reached,
        "until": record.until if reached else setting.episodes,
    }  # fmt: skip


class _Record:
    """What comes of a run."""

    def __init__(self, task: Any, core: OnlineLSPI) -> None:
        self._task, self._core = task, core
        self.endings, self.dunks = list[int](), list[float]()
        self.until: int | None = None
        self._good = 0  # updates in a row
        self._share = self._judge()

    def _judge(self) -> float:
        flown = evaluate(self._task, greedy_policy(self._core))
        return float((flown.ending == Outcome.DUNK).mean())

    def updated(self, _: Update) -> None:
        self._share = self._judge()
        self._good = self._good + 1 if self._share >= GOAL else 0
        if self._good == IN_A_ROW and self.until is None:
            self.until = len(self.endings) + 1

    def ended(self, score: float, reward: float, terminated: bool) -> None:
        self.endings.append(int(self._task.description.ending(reward, terminated)))
        self.dunks.append(self._share)
