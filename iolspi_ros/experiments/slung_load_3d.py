"""One realisation of learning the drop-off in three dimensions, from a pilot's demonstrations."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transitions, transition_between
from iolspi_ros.core.symmetric import SymmetricLSPI
from iolspi_ros.experiments.evaluate import Evaluation, evaluate
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.methods.temporal_difference import QLearning
from iolspi_ros.settings import from_mapping
from iolspi_ros.task import TaskDescription
from sim_nodes.pilots import PilotSettings, ScriptedPilot
from sim_nodes.tasks.slung_load_3d import SlungLoad3D
from sim_nodes.world import WorldSettings, make_world

TASK = "slung_load_3d"
PILOT = PilotSettings(mode="explore", reaction_delay=0.2, hold_time=0.2)
LEARNERS: Mapping[str, Any] = {
    "iolspi": OnlineLSPI,
    "iolspi_symmetric": SymmetricLSPI,
    "q_learning": QLearning,
}
AVERAGED = 4


@dataclass(frozen=True)
class SlungLoad3DRun:
    """What is learned, from what and for how long.

    Attributes
    ----------
    vehicle : mapping
        Settings of `SlungLoad3D` other than the defaults.
    learner : mapping
        Settings other than those of config/slung_load_3d.yaml; `learner` names another one.
    pilot : PilotSettings
        Who demonstrates.
    demonstrations : int
        Episodes shown, from starts drawn at random; 0 for none.
    episodes, every : int
        Flown online; policies are judged after each so many.
    changed : mapping
        Settings of the vehicle that are other from the episode `change` on, before whose start a
        policy is judged under both.
    change : int
        0 for never; else a multiple of `every`.
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    learner: Mapping[str, Any] = field(default_factory=dict)
    pilot: PilotSettings = PILOT
    demonstrations: int = 50
    episodes: int = 300
    every: int = 100
    changed: Mapping[str, Any] = field(default_factory=dict)
    change: int = 0

    def inputs(self) -> list[Path]:
        """Files that the result depends on."""
        return [_config()]

    def quick(self) -> SlungLoad3DRun:
        """A third of the episodes."""
        shorter = max(self.episodes // (3 * self.every), 1) * self.every
        return replace(self, episodes=shorter) if not self.change else self


def demonstrate(task: Any, pilot: PilotSettings, episodes: int, seed: int) -> Transitions:
    """Let the scripted pilot fly some episodes from starts drawn at random."""
    hand = ScriptedPilot(task, pilot, np.random.default_rng([seed, 2]))
    world = make_world(task, WorldSettings(), np.random.default_rng([seed, 3]))
    rows = []
    for episode in range(episodes):
        seen = world.begin(episode)
        hand.begin()
        while not seen.last:
            after = world.move(episode, hand.act(seen.state))
            rows.append(transition_between(seen, after))
            seen = after
    return Transitions.of(rows, task.description.n_dims)


def learner(changed: Mapping[str, Any], about: TaskDescription, seed: int) -> Any:
    """A learner as config/slung_load_3d.yaml has it, with some settings changed."""
    file = _config()
    values = resources.parameters(file, "learner") | dict(changed)
    cls = LEARNERS[str(values["learner"])]
    settings = from_mapping(cls.Settings, values, str(file))
    return cls(about, settings, np.random.default_rng([seed, 1]))


def drop(setting: SlungLoad3DRun, seed: int) -> Mapping[str, Any]:
    """One realisation.

    Returns
    -------
    ending : ndarray of int, shape (episodes,)
        How each ended while learning, as the task's endings are numbered.
    score : ndarray of shape (episodes,)
        Sum of its rewards.
    after : ndarray of int, shape (looks,)
        Episodes flown before each look; where the vehicle changes there are two looks.
    judged : ndarray of int, shape (looks, 5)
        How the greedy policy's episodes end, one from each of the 100 starts, before the first
        episode and after each `every`; without the shield.
    judged_score, discounted : ndarray of shape (looks,)
        Their mean sum of rewards, and mean discounted return.
    averaged : ndarray of int, shape (every hundredth, 5)
        As `judged`, after each 100 episodes, of the policy that is greedy by the mean Q̂ of the
        last `AVERAGED` updates.
    vetoes, steps, samples : int
        Of the shield; flown in all; demonstrated.
    """
    task = _vehicle(setting.vehicle)
    about = task.description
    core = learner(setting.learner, about, seed)
    shown = demonstrate(task, setting.pilot, setting.demonstrations, seed)
    if len(shown):
        core.pretrain(shown)
    world = make_world(task, WorldSettings(), np.random.default_rng([seed, 0]))
    endings, scores, looks = list[int](), list[float](), list[tuple[int, Evaluation]]()

    def ended(score: float, reward: float, terminated: bool) -> None:
        scores.append(score)
        endings.append(int(about.ending(reward, terminated)))

    kept: deque[NDArray[np.float64]] = deque(maxlen=AVERAGED)
    averaged: list[NDArray[np.int64]] = []

    def together(states: NDArray[np.float64]) -> NDArray[np.int64]:
        values = sum(core.values(states, snapshot) for snapshot in kept)
        return np.asarray(values).argmax(axis=1)

    def look() -> None:
        looks.append((len(endings), evaluate(task, greedy_policy(core))))
        if endings and len(endings) % 100 == 0:
            policy = together if kept else greedy_policy(core)  # from nothing that may take longer
            averaged.append(counted(evaluate(task, policy).ending))

    listener = Listener(on_update=lambda _: kept.append(core.snapshot), on_episode=ended)

    look()
    while len(endings) < setting.episodes:
        if setting.change and len(endings) == setting.change:
            task = _vehicle({**setting.vehicle, **setting.changed})
            world = make_world(task, WorldSettings(), np.random.default_rng([seed, 4]))
            look()
        train(world, core, setting.every, listener)
        look()
    return {
        "ending": np.array(endings, np.int8), "score": np.array(scores),
        "after": np.array([after for after, _ in looks]),
        "judged": np.array([counted(flown.ending) for _, flown in looks]),
        "judged_score": np.array([flown.score.mean() for _, flown in looks]),
        "discounted": np.array([flown.discounted_return for _, flown in looks]),
        "averaged": np.array(averaged).reshape(-1, len(about.endings)),
        "vetoes": getattr(core, "vetoes", 0), "steps": core.step, "samples": len(shown),
    }  # fmt: skip


def counted(ending: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many episodes ended in each way, shape (5,)."""
    return np.bincount(ending, minlength=len(SlungLoad3D.description.endings))


def with_learner(setting: SlungLoad3DRun, **values: Any) -> SlungLoad3DRun:
    """The same with other settings of the learner."""
    return replace(setting, learner=dict(setting.learner) | values)


def _config() -> Path:
    return resources.find("config", f"{TASK}.yaml")


def _vehicle(values: Mapping[str, Any]) -> Any:
    return from_mapping(SlungLoad3D, dict(values), TASK)
