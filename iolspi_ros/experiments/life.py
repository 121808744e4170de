"""A learner's life on a vehicle, step by step as a node lives it, and what it is judged by."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Learner, greedy_policy, learner_class, update
from iolspi_ros.core.samples import Observation, transition_between
from iolspi_ros.experiments.evaluate import Policy, evaluate, near_optimal_policy
from iolspi_ros.experiments.samplesets import NOTHING, bag, samples
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

LOOKS = 20
"""How often a policy is judged after the beginning, in equal times."""


@dataclass(frozen=True)
class Life:
    """What is learned, by whom, from what, and for how long.

    Attributes
    ----------
    learner : str
        As registered.
    settings : dataclass
        The learner's.
    task : dataclass
        A `Task`.
    world : WorldSettings
    samples : str
        One of `samplesets.SOURCES`.
    seconds : float
        Vehicle time [s].
    looks : int
        How often the greedy policy is judged after the beginning.
    """

    learner: str
    settings: Any
    task: Any
    world: WorldSettings
    samples: str = NOTHING
    seconds: float = 60.0
    looks: int = LOOKS

    def inputs(self) -> list[Path]:
        """Files that the result depends on."""
        path = bag(self.samples, self.task.description.name)
        return sorted(path.glob("*.mcap")) if path else []

    @property
    def times(self) -> Array:
        """Vehicle times at which policies are judged [s]."""
        return np.linspace(0.0, self.seconds, self.looks + 1)


class Record:
    """What comes of a life: judged at some times, and counted in between.

    Parameters
    ----------
    life : Life
    policy : callable
        Gives the greedy policy in use.
    """

    def __init__(self, life: Life, policy: Callable[[], Policy]) -> None:
        self._life, self._policy = life, policy
        self._waiting = life.times.tolist()
        self._endings = np.zeros(len(life.task.description.endings), int)
        self._rewards, self._steps = 0.0, 0
        self._rows: list[tuple[Any, ...]] = []
        self.processor = 0.0  # seconds that the learner took

    def look(self) -> None:
        """Judge the policy, when it is time."""
        now = self._steps * self._life.task.description.sampling_time
        while self._waiting and now >= self._waiting[0] - 1e-9:
            self._waiting.pop(0)
            flown = evaluate(self._life.task, self._policy(), now)
            self._rows.append((
                flown.discounted_return, flown.success_fraction, self.processor, self._rewards,
                self._endings.copy(),
            ))  # fmt: skip

    def flown(self, seen: Observation) -> None:
        """Count a step, and judge."""
        self._steps += 1
        self._rewards += seen.reward
        if seen.last:
            ending = self._life.task.description.ending(seen.reward, seen.terminated)
            self._endings[int(ending)] += 1
        self.look()

    def result(self) -> Mapping[str, Any]:
        """As `learn` returns it."""
        names = ("discounted", "success", "processor", "rewards", "endings")
        columns = zip(*self._rows, strict=True)
        found = dict(zip(names, map(np.array, columns), strict=True))
        return {"time": self._life.times, **found}


def learn(setting: Life, seed: int) -> Mapping[str, Any]:
    """One realisation, step by step, as a node does it.

    Returns
    -------
    time, discounted, success, processor, rewards : ndarray of shape (looks + 1,)
        When the greedy policy was judged [s]; its mean discounted return and its share of
        successes from all starts, under the conditions of that time; what the learner had taken of
        a processor by then [s]; the sum of all rewards until then.
    endings : ndarray of int, shape (looks + 1, n_endings)
        Episodes while learning that had ended in each way.
    """
    about, clock = setting.task.description, time.process_time
    cls = learner_class(setting.learner)
    core: Learner = cls(about, setting.settings, np.random.default_rng([seed, 1]))
    record = Record(setting, lambda: greedy_policy(core))
    demonstrations = samples(setting.samples, setting.task, seed)
    if demonstrations is not None:
        begin = clock()
        core.pretrain(demonstrations)
        record.processor += clock() - begin
    record.look()
    world = World(setting.task, setting.world, np.random.default_rng([seed, 0]))
    episode, seen = 0, world.begin(0)
    for _ in range(round(setting.seconds / about.sampling_time)):
        begin = clock()
        action, _ = core.act(seen.state)
        chosen = clock()
        after = world.move(episode, action)
        moved = clock()
        if core.observe(transition_between(seen, after)):
            update(core)
        record.processor += clock() - moved + chosen - begin
        record.flown(after)
        if after.last:
            episode, after = episode + 1, world.begin(episode + 1)
        seen = after
    return record.result()


@dataclass(frozen=True)
class Yardstick:
    """A task and the times at which its best policy is judged."""

    task: Any
    times: tuple[float, ...]


def best(setting: Yardstick, seed: int) -> Mapping[str, Any]:
    """Return of the near-optimal policy at each time, shape (n_times,); no draw has a part."""
    returns: dict[bytes, float] = {}
    found = []
    for now in setting.times:
        key = setting.task.parameters(now).tobytes()
        if key not in returns:
            policy = near_optimal_policy(setting.task, time=now)
            returns[key] = evaluate(setting.task, policy, now).discounted_return
        found.append(returns[key])
    return {"discounted": np.array(found)}
