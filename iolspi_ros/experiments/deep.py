"""A deep baseline from a library: DQN of Stable-Baselines3 (the extra `deep`), to compare with.

V. Mnih et al., "Human-level control through deep reinforcement learning", Nature 518, 2015.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.life import Life, Record
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription
from sim_nodes.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DeepSettings(Settings):
    """What it takes; the rest is the library's default."""

    learning_rate: float = setting(1e-3, "of Adam", low=0.0, low_open=True)
    buffer_size: int = setting(50_000, "transitions kept", low=1)
    learning_starts: int = setting(500, "steps before the first gradient", low=1)
    train_interval: int = setting(4, "steps between gradients", low=1)
    target_interval: int = setting(500, "steps between copies of the target network", low=1)
    exploration: float = setting(0.3, "share of the run in which epsilon falls", low=0.0, high=1.0)
    epsilon_min: float = setting(0.05, "where it ends", low=0.0, high=1.0)


def settings(task: TaskDescription) -> DeepSettings:
    """Its settings, where it can be had, and the task has limits.

    Raises
    ------
    InputError
        When the library is not installed.
    """
    library()
    if not np.isfinite([*task.low, *task.high]).all():
        raise InputError(f"dqn needs limits of every variable; allowed: a task other than "
                         f"{task.name}, or a learner that needs none, such as iolspi")  # fmt: skip
    return DeepSettings()


def library() -> Any:
    """Stable-Baselines3, which computes with one thread.

    Raises
    ------
    InputError
        When it is not installed.
    """
    try:
        import gymnasium  # noqa: F401
        import stable_baselines3
        import torch
    except ImportError as error:
        raise InputError(
            f"dqn needs {error.name}; allowed: install the package's extra 'deep', or leave it out"
        ) from None
    torch.set_num_threads(1)
    return stable_baselines3


def learn(setting: Life, seed: int) -> Mapping[str, Any]:
    """One realisation; what is returned is as of `life.learn`."""
    baselines = library()
    s, about = setting.settings, setting.task.description
    world = World(setting.task, setting.world, np.random.default_rng([seed, 0]))
    scale = _largest_reward(setting.task, seed)
    model: Any = None

    def policy(states: Array) -> NDArray[np.int64]:
        return np.asarray(model.predict(_seen(about, states), deterministic=True)[0], np.int64)

    record = Record(setting, lambda: policy)
    environment = _environment(world, record, scale)
    steps = round(setting.seconds / about.sampling_time)
    model = baselines.DQN(
        "MlpPolicy", environment, learning_rate=s.learning_rate, buffer_size=s.buffer_size,
        learning_starts=s.learning_starts, train_freq=s.train_interval, gamma=about.gamma,
        target_update_interval=s.target_interval, exploration_fraction=s.exploration,
        exploration_final_eps=s.epsilon_min, seed=seed, device="cpu",
    )  # fmt: skip
    record.look()
    environment.begin = time.process_time()
    model.learn(steps)
    return record.result()


def _seen(task: TaskDescription, states: Array) -> NDArray[np.float32]:
    """States as a network likes them: in [-1, 1], angles as places on a circle."""
    columns = []
    for variable, value in zip(task.variables, np.atleast_2d(states).T, strict=True):
        if variable.periodic:
            turn = 2.0 * np.pi * (value - variable.low) / (variable.high - variable.low)
            columns += [np.cos(turn), np.sin(turn)]
        else:
            columns.append(2.0 * (value - variable.low) / (variable.high - variable.low) - 1.0)
    return np.stack(columns, axis=1).astype(np.float32)


def _largest_reward(task: Any, seed: int) -> float:
    """What rewards are divided by: the largest of random states and actions."""
    about, rng = task.description, np.random.default_rng([seed, 2])
    states = rng.uniform(about.low, about.high, (1000, about.n_dims))
    reward = task.step(states, rng.integers(about.n_actions, size=1000))[1]
    return float(np.abs(reward).max()) or 1.0


def _environment(world: World, record: Record, scale: float) -> Any:
    """A world as the library wants it; what happens between two steps is the learner's time."""
    import gymnasium

    about = world.task.description
    size = _seen(about, np.zeros((1, about.n_dims))).shape[1]

    class Environment(gymnasium.Env[Any, Any]):  # type: ignore[misc]
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        action_space = gymnasium.spaces.Discrete(about.n_actions)
        begin, episode = 0.0, 0

        def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
            self.episode += 1
            return _seen(about, world.begin(self.episode).state)[0], {}

        def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            record.processor += time.process_time() - self.begin
            after: Observation = world.move(self.episode, int(action))
            record.flown(after)
            seen = _seen(about, after.state)[0]
            self.begin = time.process_time()
            return seen, after.reward / scale, after.terminated, after.truncated, {}

    return Environment()
