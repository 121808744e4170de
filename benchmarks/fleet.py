"""How much sooner one learner is near-optimal with three pendulums than with one.

From nothing, in lockstep, for some vehicle seconds of each; then its greedy policy is flown from
every start on the model. docs/own_vehicle.md keeps what this prints.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from pathlib import Path

from iolspi_ros import graph, resources
from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy
from iolspi_ros.experiments.headless import prepare
from iolspi_ros.saving import checkpoint

SECONDS, SEEDS, VEHICLES = (6, 9, 12, 18, 27), (0, 1, 2), (1, 3)


def learned(vehicles: int, seconds: float, seed: int) -> float:
    """Return of the policy that came of so much flying on each of so many vehicles."""
    config = resources.find("config", "pendulum.yaml")
    setup = prepare("pendulum", config, seed)
    episodes = round(seconds / setup.learner.task.episode_time)
    with tempfile.TemporaryDirectory() as folder, graph.Graph(Path(folder)) as nodes:
        kept = Path(folder) / "c.npz"
        values = {"seed": seed, "wait_for_demonstrations": False, "checkpoint": str(kept),
                  "vehicle_timeout": 60.0}  # fmt: skip
        names = [f"v{number}" for number in range(1, vehicles + 1)]
        others = {"other_vehicles": [f"/{name}" for name in names[1:]]} if names[1:] else {}
        nodes.start("learner", values | others, config, namespace="/v1", name="learner")
        for number, name in enumerate(names):
            what = {"seed": 100 * seed + number, "episodes": episodes}
            nodes.start("simulator", what, config, namespace=f"/{name}", name=name)
        logs = [Path(folder) / f"{name}.log" for name in names]
        while not all("done:" in log.read_text() for log in logs):
            nodes.check()
            time.sleep(0.1)
        nodes.stop()
        checkpoint.load(kept, setup.learner, "iolspi")
    return evaluate(setup.world.task, greedy_policy(setup.learner)).discounted_return


def main() -> None:
    """Measure, and print the costs as multiples of the near-optimal one."""
    print(f"domain {graph.isolate()}; medians of seeds {SEEDS}, all of them behind")
    model = prepare("pendulum", None, 0).world.task
    best = evaluate(model, near_optimal_policy(model)).discounted_return
    for seconds in SECONDS:
        for vehicles in VEHICLES:
            found = sorted(learned(vehicles, seconds, seed) / best for seed in SEEDS)
            each = ", ".join(f"{ratio:.3f}" for ratio in found)
            print(f"{seconds} s each, {vehicles}: {statistics.median(found):.3f} ({each})")


if __name__ == "__main__":
    main()
