"""LunarLander, informed: Gymnasium's own heuristic shows how, then the learner goes on by itself.

One in ten of the demonstrated actions is at random. docs/own_vehicle.md keeps what this prints.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from gymnasium.envs.box2d.lunar_lander import heuristic

from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.core.samples import Transitions, transition_between
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import Listener, make_learner, prepare, train

TASK, SHOWN, CORRUPTION, STRETCH, STRETCHES = "gymnasium:LunarLander-v3", 40, 0.1, 25, 4
SETTINGS = {
    "kernels": 400, "buffer_size": 20_000, "epsilon": 0.1, "epsilon_decay": 0.995,
    "epsilon_min": 0.02, "update_interval": 2000,
}  # fmt: skip


class Discrete:
    """What the heuristic asks of its environment: whether actions are continuous."""

    unwrapped: Any

    def __init__(self) -> None:
        self.unwrapped, self.continuous = self, False


def demonstrated(world: Any) -> Transitions:
    """Episodes of the heuristic."""
    rng, rows, scores = np.random.default_rng(0), [], []
    for episode in range(SHOWN):
        seen, score = world.begin(episode), 0.0
        while not seen.last:
            chance = rng.random() < CORRUPTION
            action = int(rng.integers(4)) if chance else int(heuristic(Discrete(), seen.state))
            after = world.move(episode, action)
            rows.append(transition_between(seen, after))
            seen, score = after, score + after.reward
        scores.append(score)
    print(f"shown: {len(rows)} samples, {np.mean(scores):.0f} an episode")
    return Transitions.of(rows, world.task.description.n_dims)


def main() -> None:
    """Show, learn, go on, and say what the greedy policy earns from each seed."""
    world = prepare(TASK, None, 0).world
    learner = make_learner("iolspi", world.task.description, SETTINGS, __file__, 0)
    begin = time.monotonic()
    print(learner.pretrain(demonstrated(world)).text)
    for episodes in range(0, STRETCH * (STRETCHES + 1), STRETCH):
        if episodes:
            train(world, learner, STRETCH, Listener())
        found = evaluate(world.task, greedy_policy(learner))
        print(
            f"after {episodes} episodes, {time.monotonic() - begin:.0f} s: mean "
            f"{found.score.mean():.0f}, 200 or more from {found.success_fraction:.0%} of the seeds"
        )


if __name__ == "__main__":
    main()
