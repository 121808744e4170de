"""What a deep learner of a library (the extra `deep`) takes on the environments of `bench.public`.

Deep Q-learning where actions are discrete, soft actor-critic where they are continuous; their
settings are those that RL Baselines3 Zoo gives for each environment (hyperparams/dqn.yml and
sac.yml, April 2026), so they are tuned where ours is the same everywhere.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from iolspi_ros.bench.public import CHALLENGES, SETTINGS, Challenge, Judge, Reached, told
from iolspi_ros.bench.rows import Row
from iolspi_ros.experiments.deep import library

_WIDE: Mapping[str, Any] = {"net_arch": [256, 256]}
_LONG: Mapping[str, Any] = {
    "learning_rate": 6.3e-4, "batch_size": 128, "buffer_size": 50_000, "learning_starts": 0,
    "target_update_interval": 250, "train_freq": 4, "gradient_steps": -1,
    "exploration_fraction": 0.12, "exploration_final_eps": 0.1, "policy_kwargs": _WIDE,
}  # fmt: skip
TUNED: Mapping[str, tuple[str, int, Mapping[str, Any]]] = {
    "CartPole-v1": ("DQN", 50_000, {
        "learning_rate": 2.3e-3, "batch_size": 64, "buffer_size": 100_000, "learning_starts": 1000,
        "target_update_interval": 10, "train_freq": 256, "gradient_steps": 128,
        "exploration_fraction": 0.16, "exploration_final_eps": 0.04, "policy_kwargs": _WIDE,
    }),
    "Acrobot-v1": ("DQN", 100_000, _LONG),
    "MountainCar-v0": ("DQN", 120_000, {
        "learning_rate": 4e-3, "batch_size": 128, "buffer_size": 10_000, "learning_starts": 1000,
        "gamma": 0.98, "target_update_interval": 600, "train_freq": 16, "gradient_steps": 8,
        "exploration_fraction": 0.2, "exploration_final_eps": 0.07, "policy_kwargs": _WIDE,
    }),
    "Pendulum-v1": ("SAC", 20_000, {"learning_rate": 1e-3}),
    "LunarLander-v3": ("DQN", 100_000, _LONG),
}  # fmt: skip
"""By environment: the algorithm, the steps over which its exploration falls, its settings."""


def total(seeds: int) -> int:
    """Number of realisations."""
    return seeds * len(CHALLENGES)


def rows(seeds: int, show: Callable[[int], None]) -> list[Row]:
    """Steps until the threshold, by environment.

    Raises
    ------
    InputError
        When the library is not installed.
    """
    library()
    found: list[Row] = []
    for number, challenge in enumerate(CHALLENGES):
        reached = []
        for seed in range(seeds):
            reached.append(reach(challenge, seed))
            show(number * seeds + seed + 1)
        found += told(f"{challenge.id}, {TUNED[challenge.id][0]}", challenge, reached)
    return found


def reach(challenge: Challenge, seed: int) -> Reached:
    """Learn until the threshold, as `public.reach`, or for as long as its settings say."""
    import gymnasium

    baselines = library()
    name, steps, settings = TUNED[challenge.id]
    model = getattr(baselines, name)(
        "MlpPolicy", gymnasium.make(challenge.id), seed=seed, device="cpu", **settings
    )
    from stable_baselines3.common.callbacks import BaseCallback

    judge = Judge(challenge, lambda episodes: _mean(challenge, model, episodes))

    class Look(BaseCallback):  # type: ignore[misc]
        found, due = math.inf, 0

        def _on_step(self) -> bool:
            self.due -= 1
            if self.due > 0:
                return True
            self.due = SETTINGS.update_interval
            if judge.reached():
                self.found = float(self.num_timesteps)
            return not math.isfinite(self.found)

    look = Look()
    model.learn(steps, callback=look)
    return Reached(look.found, math.nan, judge.best)


def _mean(challenge: Challenge, model: Any, episodes: int) -> float:
    """Mean sum of rewards of the greedy policy; the episodes side by side, each its own seed."""
    import gymnasium

    copies = [gymnasium.make(challenge.id) for _ in range(episodes)]
    states = [copy.reset(seed=seed)[0] for seed, copy in enumerate(copies)]
    scores, flying = np.zeros(episodes), list(range(episodes))
    while flying:
        actions = model.predict(np.array([states[k] for k in flying]), deterministic=True)[0]
        after = []
        for k, action in zip(flying, actions, strict=True):
            states[k], reward, terminated, truncated, _ = copies[k].step(action)
            scores[k] += float(reward)
            if not (terminated or truncated):
                after.append(k)
        flying = after
    for copy in copies:
        copy.close()
    return float(scores.mean())
