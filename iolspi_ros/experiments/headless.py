"""Training without a graph: the same world and the same learner, as fast as they go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from iolspi_ros.core.online import OnlineLSPI, Source, Update
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.experiments.history import History, Policy
from sim_nodes.world import World


@dataclass
class Listener:
    """What to call while training; each may be left out."""

    on_observation: Callable[[Observation, int, Source], None] | None = None
    on_update: Callable[[Update], None] | None = None


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
    for episode in range(episodes):
        seen = world.begin(episode)
        while not seen.last:
            action, source = learner.act(seen.state)
            if listener.on_observation:
                listener.on_observation(seen, action, source)
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
                update = learner.update()
                if listener.on_update:
                    listener.on_update(update)
            seen = following
        if listener.on_observation:
            listener.on_observation(seen, -1, Source.HOLD)


def remember(history: History, learner: OnlineLSPI, show: Callable[[int], None]) -> Listener:
    """A listener that fills `history`, and calls `show` with the episodes done."""

    def observed(observation: Observation, action: int, source: Source) -> None:
        if observation.step == 0:
            history.episodes.append([])
            history.scores.append(0.0)
        history.episodes[-1].append(observation.state)
        history.scores[-1] += observation.reward
        if observation.last:
            show(len(history.episodes))

    def updated(update: Update) -> None:
        time = update.step * learner.settings.sampling_time
        history.policies.append(
            Policy.of(update.number, time, learner.weights, update.solve, update.accepted)
        )

    return Listener(observed, updated)
