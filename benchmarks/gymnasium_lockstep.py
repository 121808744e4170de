"""Steps per second of an environment of Gymnasium: alone, as a vehicle, and through the graph.

In turns in one run: the environment alone, with random actions; the same as a vehicle without a
graph; in lockstep with a learner in another process, and in the same one; the bare exchange of
messages of `lockstep.py`; and our own pendulum as an environment. docs/benchmarks.md keeps what
this prints.
"""

from __future__ import annotations

import re
import statistics
import sys
import tempfile
import time
from pathlib import Path

import gymnasium
import numpy as np
from lockstep import ping_pong

import msg_bridge.gym
from iolspi_ros import graph
from iolspi_ros.experiments.headless import make_world

STEPS, ROUNDS = 10_000, 3
EPISODES = {"CartPole-v1": 400, "LunarLander-v3": 80}


def alone(name: str, **arguments: object) -> float:
    """The environment with random actions."""
    env, rng = gymnasium.make(name, **arguments), np.random.default_rng(0)
    env.reset(seed=0)
    begin = time.perf_counter()
    for _ in range(STEPS):
        *_, terminated, truncated, _ = env.step(int(rng.integers(env.action_space.n)))
        if terminated or truncated:
            env.reset()
    took = time.perf_counter() - begin
    env.close()
    return STEPS / took


def vehicle(name: str) -> float:
    """The same as a vehicle, without a graph."""
    world, rng = make_world(f"gymnasium:{name}", None, 0), np.random.default_rng(0)
    actions, episode = world.task.description.n_actions, 0
    seen = world.begin(episode)
    begin = time.perf_counter()
    for _ in range(STEPS):
        seen = world.move(episode, int(rng.integers(actions)))
        if seen.last:
            episode += 1
            seen = world.begin(episode)
    return STEPS / (time.perf_counter() - begin)


def lockstep(name: str, *, composed: bool) -> float:
    """Simulator and learner, which acts at random and does not update."""
    learner = {"wait_for_demonstrations": False, "vehicle_timeout": 60.0, "epsilon": 1.0,
               "update_interval": 10**6}  # fmt: skip
    simulator = {"task": f"gymnasium:{name}", "episodes": EPISODES[name]}
    with tempfile.TemporaryDirectory() as folder, graph.Graph(Path(folder)) as nodes:
        if composed:
            both = {f"learner:{key}": value for key, value in learner.items()}
            nodes.start("graph", both | {f"simulator:{key}": v for key, v in simulator.items()})
        else:
            nodes.start("learner", learner)
            nodes.start("simulator", simulator)
        log = Path(folder) / ("graph.log" if composed else "simulator.log")
        while not (found := re.search(r"([\d.]+) steps/s", log.read_text())):
            nodes.check()
            time.sleep(0.2)
        return float(found[1])


def main() -> None:
    """Measure in turns, and print medians."""
    print(f"domain {graph.isolate()}, {STEPS} steps a run, medians of {ROUNDS}")
    msg_bridge.gym.register()
    ways = {
        f"{name}, {what}": run
        for name in EPISODES
        for what, run in (
            ("alone", lambda name=name: alone(name)),
            ("as a vehicle", lambda name=name: vehicle(name)),
            ("lockstep, two processes", lambda name=name: lockstep(name, composed=False)),
            ("lockstep, composed", lambda name=name: lockstep(name, composed=True)),
        )
    }
    ways["bare rclpy ping-pong"] = ping_pong
    ways["pendulum as an environment"] = lambda: alone(msg_bridge.gym.ID, task="pendulum")
    found: dict[str, list[float]] = {way: [] for way in ways}
    for _ in range(ROUNDS):
        for way, run in ways.items():
            found[way].append(run())
    for way, speeds in found.items():
        print(f"{way}: {statistics.median(speeds):.0f} steps/s")


if __name__ == "__main__":
    sys.exit(main())
