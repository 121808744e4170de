"""What δ does: ratio to the near-optimal cost, by demonstration set, after offline and online LSPI.

The algorithms as in the thesis (T Algorithms 1 and 2, III-C), K_θ = 1000, ε = 0.2, hanging-down
initial conditions, the median over some seeds. T gives no δ.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

import numpy as np

from iolspi_ros import resources
from iolspi_ros.bags import read_demonstration
from iolspi_ros.core.learner_settings import LearnerSettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy, policy_of
from iolspi_ros.experiments.headless import Listener, train
from sim_nodes.tasks import Pendulum
from sim_nodes.world import World, WorldSettings

DELTAS = (0.001, 0.01, 0.1, 1.0, 10.0)
SEEDS = range(5)
EPISODES = 80


def main() -> None:
    """Print one row per set and δ."""
    task = Pendulum()
    best = evaluate(task, near_optimal_policy(task)).discounted_return
    settings = LearnerSettings(algorithm="literal", periodic=(False,))
    print("| set | δ | offline | after 20 s | after 120 s | upright at 120 s |")
    print("| --- | --- | --- | --- | --- | --- |")
    for number in range(1, 6):
        path = resources.find("demos", "pendulum", f"set_{number}")
        transitions = read_demonstration(path, task.name, task.joints).transitions(2)
        for delta in DELTAS:
            rows = []
            for seed in SEEDS:
                learner = OnlineLSPI(
                    replace(settings, delta=delta), np.random.default_rng([seed, 1])
                )
                world = World(task, WorldSettings(), np.random.default_rng([seed, 0]))
                learner.inform(transitions)
                found = [evaluate(task, policy_of(learner.weights, learner.features))]

                def look(update, learner=learner, found=found):
                    if update.number in (4, 24):
                        policy = policy_of(learner.weights, learner.features)
                        found.append(evaluate(task, policy))

                train(world, learner, EPISODES, Listener(on_update=look))
                ratios = [e.discounted_return / best for e in found]
                rows.append((*ratios, found[-1].success_fraction))
            middle = [statistics.median(column) for column in zip(*rows, strict=True)]
            cells = " | ".join(f"{value:.3f}" for value in middle[:3])
            print(f"| {number} | {delta:g} | {cells} | {middle[3]:.0%} |", flush=True)


if __name__ == "__main__":
    main()
