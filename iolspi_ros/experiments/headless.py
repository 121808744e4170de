"""Training without a graph: the same world and the same learner, as fast as they go."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np

from iolspi_ros import resources
from iolspi_ros.core.learner import (
    DEFAULT,
    CompiledLearner,
    Learner,
    Source,
    Update,
    learner_class,
    update,
)
from iolspi_ros.core.samples import Observation, Transitions, transition_between
from iolspi_ros.experiments.compiled import CompiledTask, Training, fly
from iolspi_ros.experiments.history import EpisodeRecord, History, PolicyRecord
from iolspi_ros.settings import from_mapping
from iolspi_ros.task import TaskDescription
from sim_nodes import world as worlds
from sim_nodes.tasks import make_task
from sim_nodes.tasks.base import Compiled
from sim_nodes.world import World, WorldSettings


def prepare(task: str, file: Path | None, seed: int, learner: str = "") -> Setup:
    """World and learner as a parameter file describes them, seeded as the nodes are.

    Parameters
    ----------
    task : str
        A registered task, or `module:Class`.
    file : Path, optional
        As in config/; without it everything has its default.
    seed : int
    learner : str
        A registered learner, or `module:Class`; what the file says by default.

    Raises
    ------
    InputError
        When the file holds what is not allowed.
    """
    values = resources.parameters(file, "learner") if file else {}
    name = learner or str(values.get("learner", DEFAULT))
    world = make_world(task, file, seed)
    return Setup(world, make_learner(name, world.task.description, values, str(file), seed), name)


def make_world(task: str, file: Path | None, seed: int) -> World:
    """The world alone, as `prepare` makes it."""
    simulated = resources.parameters(file, "simulator") if file else {}
    noise = from_mapping(WorldSettings, simulated, str(file))
    return worlds.make_world(make_vehicle(task, file), noise, np.random.default_rng([seed, 0]))


def make_vehicle(task: str, file: Path | None) -> Any:
    """A task as a parameter file describes the simulator's.

    Raises
    ------
    InputError
        When there is no such task, or the file holds what is not allowed.
    """
    return make_task(task, resources.parameters(file, "simulator") if file else {}, str(file))


def make_learner(
    name: str, task: TaskDescription, values: Mapping[str, Any], where: str, seed: int
) -> Learner:
    """A registered learner with some settings, seeded as the node is."""
    cls = learner_class(name)
    settings = from_mapping(cls.Settings, dict(values), where)
    return cls(task, settings, np.random.default_rng([seed, 1]))


class Setup(NamedTuple):
    """What a parameter file describes.

    Attributes
    ----------
    world : World
    learner : Learner
    name : str
        Of the learner, as registered.
    """

    world: World
    learner: Learner
    name: str


@dataclass
class Listener:
    """What to call while training; each may be left out.

    Attributes
    ----------
    on_observation : callable
        With each observation, the action chosen there (-1 at an end) and who chose it.
    on_update : callable
        With each policy update.
    on_episode : callable
        With each episode's sum of rewards (T: learning score), its last reward, and whether the
        task ended there.
    improve : callable
        Makes an update that is due; asked only with `on_observation`.
    """

    on_observation: Callable[[Observation, int, Source], None] | None = None
    on_update: Callable[[Update], None] = lambda update: None
    on_episode: Callable[[float, float, bool], None] = lambda score, reward, terminated: None
    improve: Callable[[Learner], Update] = update


def train(world: World, learner: Learner, episodes: int, listener: Listener) -> None:
    """Act and learn for some episodes.

    The order of every random draw is that of the simulator and learner nodes in lockstep, so
    both give the same transitions and weights, bit by bit.

    Parameters
    ----------
    world : World
    learner : Learner
    episodes : int
    listener : Listener
    """
    look = listener.on_observation
    if look is None and isinstance(learner, CompiledLearner) and isinstance(world.task, Compiled):
        fly(
            world, cast("CompiledTask", world.task), cast("Training", learner), episodes,
            listener.on_update, listener.on_episode,
        )  # fmt: skip
        return
    for episode in range(episodes):
        seen, score = world.begin(episode), 0.0
        while not seen.last:
            action, source = learner.act(seen.state)
            if look:
                look(seen, action, source)
            after = world.move(episode, action)
            if learner.observe(transition_between(seen, after)):
                listener.on_update(listener.improve(learner))
            seen = after
            score += seen.reward
        listener.on_episode(score, seen.reward, seen.terminated)
        if look:
            look(seen, -1, Source.HOLD)


def remember(history: History, learner: Learner, show: Callable[[int], None]) -> Listener:
    """A listener that fills `history`, and calls `show` with the episodes done."""

    def observed(observation: Observation, action: int, source: Source) -> None:
        if observation.step == 0:
            history.episodes.append(EpisodeRecord())
            history.scores.append(0.0)
        history.episodes[-1].take(observation)
        history.scores[-1] += observation.reward
        if observation.last:
            show(len(history.episodes))

    def updated(update: Update) -> None:
        time = update.step * learner.task.sampling_time
        history.policies.append(PolicyRecord.of(update, time, learner.snapshot))

    return Listener(observed, updated)


class Beside(NamedTuple):
    """Another learner in the same situation, to compare with.

    Attributes
    ----------
    label : str
        What it is called.
    learner : Learner
    history : History
    """

    label: str
    learner: Learner
    history: History


def train_beside(
    task: str, file: Path | None, seed: int, demonstrations: Transitions, episodes: int
) -> Beside | None:
    """The learner that a parameter file's section `beside` describes, in the same situation.

    The section says what is other than in the section `learner`, and has a `label`.

    Returns
    -------
    Beside
        Or None when the file has no such section, or the learner is the same.
    """
    changed = resources.parameters(file, "beside") if file else {}
    if file is None or not changed:
        return None
    world, configured, name = prepare(task, file, seed)
    label = str(changed.pop("label", "beside"))
    values = resources.parameters(file, "learner") | changed
    other = str(values.get("learner", DEFAULT))
    learner = make_learner(other, world.task.description, values, str(file), seed)
    if (other, learner.settings) == (name, configured.settings):
        return None
    history = History(learner.task.sampling_time, demonstrations)
    listener = remember(history, learner, lambda done: None)
    if len(demonstrations):
        update = learner.pretrain(demonstrations)
        history.policies.append(PolicyRecord.of(update, 0.0, learner.snapshot))
    train(world, learner, episodes, listener)
    return Beside(label, learner, history)
