"""Episodes of a learning run, step by step: what T shows as time histories."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.pendulum import HANGING, PendulumRun, make
from iolspi_ros.experiments.samplesets import samples
from sim_nodes.tasks.pendulum import UPRIGHT_ANGLE
from sim_nodes.world import World

_SECONDS = 600.0


@dataclass(frozen=True)
class Episodes:
    """Some episodes of a learning run.

    Attributes
    ----------
    learning : PendulumRun
    windows : tuple of (float, int, int)
        A time of a 600 s run [s], how many episodes after that to begin, and how many to keep.
    """

    learning: PendulumRun
    windows: tuple[tuple[float, int, int], ...]

    def inputs(self) -> list[Path]:
        """Files that the result depends on."""
        return self.learning.inputs()

    def quick(self) -> Episodes:
        """The same windows of a shorter run."""
        return replace(self, learning=self.learning.quick())

    @property
    def wanted(self) -> list[int]:
        """Numbers of the episodes, window by window."""
        run = self.learning
        scale = run.seconds / _SECONDS / run.task.description.episode_time
        firsts = [(round(time * scale) + offset, count) for time, offset, count in self.windows]
        return [first + k for first, count in firsts for k in range(count)]


def record(setting: Episodes, seed: int) -> Mapping[str, Any]:
    """One run, of the same draws as `pendulum.learn`.

    Returns
    -------
    episode : ndarray of int, shape (n_episodes,)
    angle, reward : ndarray of shape (n_episodes, episode_steps + 1)
        Measured; the reward is that of the step that led there.
    swings : ndarray of shape (n_episodes,)
        How often the pendulum turned round before it first was within 15° of upright; NaN when
        it never was.
    reached : ndarray of shape (n_episodes,)
        Seconds until then; NaN when it never was.
    """
    run = setting.learning
    core = make(run, seed)
    demonstrations = samples(run.samples, HANGING, seed)
    if demonstrations is not None:
        core.pretrain(demonstrations)
    wanted = setting.wanted
    kept: dict[int, list[tuple[float, float, float]]] = {number: [] for number in wanted}

    def look(seen: Observation, action: int, source: Source) -> None:
        if seen.episode in kept:
            kept[seen.episode].append((seen.state[0], seen.state[1], seen.reward))

    world = World(run.task, run.world, np.random.default_rng([seed, 0]))
    train(world, core, max(wanted) + 1, Listener(on_observation=look))
    angle, rate, reward = np.moveaxis(np.array([kept[number] for number in wanted]), 2, 0)
    found = [_swings(a, r) for a, r in zip(angle, rate, strict=True)]
    return {
        "episode": np.array(wanted),
        "angle": angle,
        "reward": reward,
        "swings": np.array([turns for turns, _ in found]),
        "reached": np.array([steps for _, steps in found]) * run.task.description.sampling_time,
    }


def _swings(angle: Any, rate: Any) -> tuple[float, float]:
    """Turns before upright, and steps until then."""
    up = np.flatnonzero(np.abs(angle) <= UPRIGHT_ANGLE)
    if not len(up):
        return np.nan, np.nan
    way = np.sign(rate[: up[0] + 1])
    way = way[way != 0]
    return float(np.count_nonzero(np.diff(way))), float(up[0])
