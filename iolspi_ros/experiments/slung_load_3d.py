"""One realisation of learning the drop-off in three dimensions, from a pilot's demonstrations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from iolspi_ros import resources
from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.core.samples import Transitions, transition_between
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import Listener, make_learner, train
from sim_nodes.pilots import PilotSettings, ScriptedPilot
from sim_nodes.tasks import make_task
from sim_nodes.world import WorldSettings, make_world

TASK = "slung_load_3d"
PILOT = PilotSettings(mode="explore", reaction_delay=0.2, hold_time=0.2)


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
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    learner: Mapping[str, Any] = field(default_factory=dict)
    pilot: PilotSettings = PILOT
    demonstrations: int = 50
    episodes: int = 300
    every: int = 100


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


def drop(setting: SlungLoad3DRun, seed: int) -> Mapping[str, Any]:
    """One realisation.

    Returns
    -------
    ending : ndarray of int, shape (episodes,)
        How each ended while learning, as the task's endings are numbered.
    score : ndarray of shape (episodes,)
        Sum of its rewards.
    judged : ndarray of int, shape (looks, 5)
        How the greedy policy's episodes end, one from each of the 100 starts, before the first
        episode and after each `every`; without the shield.
    judged_score : ndarray of shape (looks,)
        Their mean sum of rewards.
    vetoes, steps, samples : int
        Of the shield; flown in all; demonstrated.
    """
    task: Any = make_task(TASK, dict(setting.vehicle), TASK)
    file = resources.find("config", f"{TASK}.yaml")
    values = resources.parameters(file, "learner") | dict(setting.learner)
    about = task.description
    core = make_learner(str(values["learner"]), about, values, TASK, seed)
    shown = demonstrate(task, setting.pilot, setting.demonstrations, seed)
    if len(shown):
        core.pretrain(shown)
    world = make_world(task, WorldSettings(), np.random.default_rng([seed, 0]))
    endings, scores, looks = list[int](), list[float](), list[tuple[Any, float]]()

    def ended(score: float, reward: float, terminated: bool) -> None:
        scores.append(score)
        endings.append(int(about.ending(reward, terminated)))

    def look() -> None:
        flown = evaluate(task, greedy_policy(core))
        looks.append((np.bincount(flown.ending, minlength=len(about.endings)), flown.score.mean()))

    look()
    while len(endings) < setting.episodes:
        train(world, core, setting.every, Listener(on_episode=ended))
        look()
    judged, judged_score = map(np.array, zip(*looks, strict=True))
    return {
        "ending": np.array(endings, np.int8), "score": np.array(scores), "judged": judged,
        "judged_score": judged_score, "vetoes": getattr(core, "vetoes", 0), "steps": core.step,
        "samples": len(shown),
    }  # fmt: skip


def with_learner(setting: SlungLoad3DRun, **values: Any) -> SlungLoad3DRun:
    """The same with other settings of the learner."""
    return replace(setting, learner=dict(setting.learner) | values)
