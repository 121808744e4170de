"""The bridge on the embedded autopilot: how well it is flown, and how it ends without a learner."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from iolspi_ros.bags import read_demonstration
from iolspi_ros.bench import latency
from iolspi_ros.bench.flying import PATIENT, Act, Dying, Flying, lost
from iolspi_ros.bench.rows import Row, at_least, at_most
from iolspi_ros.bench.worlds import RealTime
from iolspi_ros.experiments.headless import Listener, prepare, train
from iolspi_ros.resources import find
from msg_bridge.mavlink.phases import Phase
from sim_nodes.tasks.slung_load import CABLE, DUNK, WALL

LIKES = ("px4", "ardupilot")
EPISODES = 30
REPEATED = 3
MEASUREMENTS = 2 + len(LIKES) * (1 + REPEATED)
"""How often `rows` says that one is done."""


def learned() -> Act:
    """IOLSPI: pretrained on shipped set 5, then 500 episodes on the model; greedy from then on."""
    world, learner, _ = prepare("slung_load", find("config", "slung_load.yaml"), 0)
    bag = find("demos", "slung_load", "set_5")
    learner.pretrain(read_demonstration(bag, world.task.description).transitions())
    train(world, learner, 500, Listener())
    return lambda seen: learner.act(seen.state, explore=False)[0]


def rows(show: Callable[[int], None]) -> list[Row]:
    """Everything that is measured."""
    found: list[Row] = []
    done = 0

    def tick() -> None:
        nonlocal done
        done += 1
        show(done)

    act = learned()
    tick()
    with tempfile.TemporaryDirectory() as folder:
        for like in LIKES:
            found += flown(Path(folder), like, act)
            tick()
            found += left_alone(Path(folder), like, tick)
        found += latency.rows(Path(folder))
    tick()
    return found


def flown(folder: Path, like: str, act: Act, episodes: int = EPISODES) -> list[Row]:
    """Episodes flown by a policy that was warm-started from demonstrations."""
    world = partial(RealTime, factor=2.0)
    with Flying(
        folder, like, act, world=world, factor=2.0, timeouts=PATIENT, episodes=episodes, seed=2
    ) as f:
        f.until(lambda: f.flight.phase is Phase.DOWN, 120.0 + 40.0 * episodes)
        rewards = np.array([end.reward for end in f.ends])
        crashes = np.isin(rewards, (WALL, CABLE)).sum() + f.broken
        violations = f.flight.violations
    name = f"like {like}, {len(rewards)} episodes"
    return [
        at_least(f"{name}: dunks", float((rewards == DUNK).mean()), "share", 0.8),
        at_most(f"{name}: crashes", float(crashes), "", 0.0),
        at_most(f"{name}: envelope left", float(violations), "times", 0.0),
    ]


def left_alone(folder: Path, like: str, tick: Callable[[], None]) -> list[Row]:
    """A learner that is lost while it accelerates by 3 m/s² from rest, in real time."""
    lates, distances = [], []
    world = partial(RealTime, factor=1.0)
    for seed in range(REPEATED):
        with Flying(folder, like, world=world, initial="narrow", seed=seed) as f:
            f.act = dying = Dying(f.task, 3)
            late, distance = lost(f, dying)
        lates.append(late)
        distances.append(distance)
        tick()
    name = f"like {like}, learner lost"
    return [
        at_most(f"{name}: neutral after its deadline", 1e3 * max(lates), "ms", 100.0),
        at_most(f"{name}: distance to rest", max(distances), "m", 1.0),
    ]
