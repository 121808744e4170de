"""Training without a graph: the same world and the same learner, as fast as they go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iolspi_ros import resources
from iolspi_ros.core.learner_settings import LearnerSettings
from iolspi_ros.core.online import OnlineLSPI, Source, Update
from iolspi_ros.core.samples import Observation, Transition, Transitions
from iolspi_ros.experiments.compiled import fly
from iolspi_ros.experiments.history import Episode, History, Policy
from iolspi_ros.settings import from_mapping
from sim_nodes.tasks import make_task
from sim_nodes.world import World, WorldSettings


def prepare(task: str, file: Path, seed: int) -> tuple[World, OnlineLSPI]:
    """World and learner as a parameter file describes them, seeded as the nodes are.

    Parameters
    ----------
    task : str
    file : Path
        As in config/.
    seed : int

    Raises
    ------
    InputError
        When the file holds what is not allowed.
    """
    simulated = resources.parameters(file, "simulator")
    settings = from_mapping(LearnerSettings, resources.parameters(file, "learner"), str(file))
    noise = from_mapping(WorldSettings, simulated, str(file))
    vehicle = make_task(task, simulated, str(file))
    world = World(vehicle, noise, np.random.default_rng([seed, 0]))
    return world, OnlineLSPI(settings, np.random.default_rng([seed, 1]))


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
    """

    on_observation: Callable[[Observation, int, Source], None] | None = None
    on_update: Callable[[Update], None] = lambda update: None
    on_episode: Callable[[float, float, bool], None] = lambda score, reward, terminated: None


def train(world: World, learner: OnlineLSPI, episodes: int, listener: Listener) -> None:
    """Act and learn for some episodes.

    The order of every random draw is that of the simulator and learner nodes in lockstep, so
    both give the same transitions and weights, bit by bit.

    Parameters
    ----------
    world : World
    learner : OnlineLSPI
    episodes : int
    listener : Listener
    """
    look = listener.on_observation
    if look is None:
        fly(world, learner, episodes, listener.on_update, listener.on_episode)
        return
    for episode in range(episodes):
        seen, score = world.begin(episode), 0.0
        while not seen.last:
            action, source = learner.act(seen.state)
            look(seen, action, source)
            following = world.move(episode, action)
            transition = Transition(
                seen.state,
                action,
                following.reward,
                following.state,
                following.terminated,
                following.truncated,
            )
            if learner.observe(transition):
                listener.on_update(learner.update())
            seen = following
            score += seen.reward
        listener.on_episode(score, seen.reward, seen.terminated)
        look(seen, -1, Source.HOLD)


def remember(history: History, learner: OnlineLSPI, show: Callable[[int], None]) -> Listener:
    """A listener that fills `history`, and calls `show` with the episodes done."""

    def observed(observation: Observation, action: int, source: Source) -> None:
        if observation.step == 0:
            history.episodes.append(Episode())
            history.scores.append(0.0)
        history.episodes[-1].take(observation)
        history.scores[-1] += observation.reward
        if observation.last:
            show(len(history.episodes))

    def updated(update: Update) -> None:
        time = update.step * learner.settings.sampling_time
        history.policies.append(Policy.of(update, time, learner.weights))

    return Listener(observed, updated)


def literal_beside(
    task: str, file: Path, seed: int, taught: Transitions, episodes: int
) -> tuple[OnlineLSPI, History] | None:
    """The thesis' own algorithm in the same situation, to compare with.

    No dimension wraps around and nothing is vetoed; else its settings are the same, but for
    those that the file's section `literal` gives.

    Returns
    -------
    learner : OnlineLSPI
    history : History
        Or None for both when the file's own learner is just that one.
    """
    world, configured = prepare(task, file, seed)
    values = resources.parameters(file, "learner")
    values |= {"algorithm": "literal", "periodic": [False], "shield": False}
    values |= resources.parameters(file, "literal")
    settings = from_mapping(LearnerSettings, values, str(file))
    if settings == configured.settings:
        return None
    learner = OnlineLSPI(settings, np.random.default_rng([seed, 1]))
    history = History(world.task.dt, taught)
    listener = remember(history, learner, lambda done: None)
    if len(taught):
        update = learner.inform(taught)
        history.policies.append(Policy.of(update, 0.0, learner.weights))
    train(world, learner, episodes, listener)
    return learner, history
