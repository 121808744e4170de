"""How far it grows: the slung load with more and more functions (T Table 3)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from iolspi_ros.bench.machine import fastest
from iolspi_ros.bench.rows import Row, at_most
from iolspi_ros.core.dual import DualSystem
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.lspi import BlockSystem
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.refresh import refresh
from iolspi_ros.core.samples import Transitions
from iolspi_ros.experiments.evaluate import evaluate, policy_of
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.pendulum import HANGING, best_flight
from iolspi_ros.experiments.samplesets import samples
from sim_nodes.tasks import make_task
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.slung_load import Outcome, outcome
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

TASK = make_task("slung_load", {}, "bench")
EPISODES = 1000
THREADS = 2
GRIDS = ((9, 1, 1, 1), (9, 1, 9, 1), (9, 9, 9, 1), (9, 9, 9, 9))
"""T Table 3; times four actions."""
T_SECONDS = {36: 10.2, 324: 18.5, 2916: 349.5}
"""T Table 3, Matlab R2015a in 2016."""
ALGORITHMS = ("literal", "refreshed")
CASES = (
    *(("literal", grid, EPISODES) for grid in GRIDS[:3]),
    *(("refreshed", grid, EPISODES) for grid in GRIDS),
    *((name, GRIDS[1], count) for name in ALGORITHMS for count in (2000, 4000, 8000)),
)
RUNS = len(CASES)


@dataclass(frozen=True)
class Grown:
    """One run.

    Attributes
    ----------
    algorithm : str
    episodes : int
    functions : int
        n_actions times the functions of a state.
    samples : int
    seconds : float
        Of flying, learning and solving, after compilation.
    bytes : int
        Largest memory of the process.
    dunks, crashes : float
        Shares of greedy episodes afterwards, over the task's initial states.
    """

    algorithm: str
    episodes: int
    functions: int
    samples: int
    seconds: float
    bytes: int
    dunks: float
    crashes: float


def settings(algorithm: str, grid: tuple[int, ...]) -> LSPISettings:
    """A learner of the slung load (T IV-B, Table 11-1)."""
    return LSPISettings(
        algorithm=algorithm,
        low=(-6.0, -4.0, -np.pi / 2, -np.pi), high=(0.0, 4.0, np.pi / 2, np.pi),
        centers=grid, periodic=(False,),
        epsilon=1.0, epsilon_decay=0.995, epsilon_min=0.01, update_interval=1000,
        buffer_size=4000,
    )  # fmt: skip


def run(algorithm: str, grid: tuple[int, ...], episodes: int = EPISODES) -> Grown:
    """Learn from nothing, then fly greedily."""
    task = TASK

    def learn(count: int) -> tuple[OnlineLSPI, float]:
        core = OnlineLSPI(
            TASK.description, settings(algorithm, grid), np.random.default_rng([0, 1])
        )
        world = World(task, WorldSettings(), np.random.default_rng([0, 0]))
        start = time.perf_counter()
        train(world, core, count, Listener())
        return core, time.perf_counter() - start

    with threadpool_limits(THREADS):
        if episodes > 2:
            learn(2)  # compiles
        core, seconds = learn(episodes)
        ends = _ends(task, core)
    crashes = (ends == Outcome.WALL) | (ends == Outcome.CABLE)
    return Grown(
        algorithm, episodes, task.description.n_actions * core.features.size, core.step, seconds,
        _peak_memory(),
        float((ends == Outcome.DUNK).mean()), float(crashes.mean()),
    )  # fmt: skip


def _peak_memory() -> int:
    """Largest memory of this process [bytes]; getrusage would count the parent's, too."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024


def _ends(task: Task, core: OnlineLSPI) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """How greedy episodes from every initial state end."""
    state = task.initial_states()
    ends = np.full(len(state), int(Outcome.OPEN))
    for _ in range(task.description.episode_steps):
        action = (core.features(state) @ core.weights.T).argmax(axis=1)
        state, reward, terminated = task.step(state, action)
        found = outcome(reward, terminated)
        ends = np.where(ends == Outcome.OPEN, found, ends)
    return ends


def measure(show: Callable[[int], None]) -> list[Grown]:
    """Every case, each in a process of its own so that its memory is its own."""
    found = []
    for number, case in enumerate(CASES, 1):
        with get_context("spawn").Pool(1) as pool:
            found.append(pool.apply(run, case))
        show(number)
    return found


def exponent(x: list[float], y: list[float]) -> float:
    """Power of x in the best fit y = c x^power."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0]) if len(x) > 1 else np.nan


def rows(found: list[Grown]) -> list[Row]:
    """Times, memory and dunks, with goals where there are."""
    table = []
    for grown in found:
        if grown.episodes != EPISODES:
            continue
        name = f"slung load, {grown.functions} functions, {grown.algorithm}"
        limit = {("literal", 2916): 25.0, ("refreshed", 26244): 349.5}
        goal = limit.get((grown.algorithm, grown.functions))
        title = f"{name}: 1,000 episodes"
        table += [
            at_most(title, grown.seconds, "s", goal) if goal else Row(title, grown.seconds, "s"),
            at_most(f"{name}: memory", grown.bytes / 2**30, "GiB", 8.0),
            Row(f"{name}: samples", float(grown.samples), ""),
            Row(f"{name}: greedy dunks", grown.dunks, "share"),
            Row(f"{name}: greedy crashes", grown.crashes, "share"),
        ]
    for algorithm in ALGORITHMS:
        for over in ("functions", "samples"):
            power = exponent(*series(found, algorithm, over))
            table.append(Row(f"slung load, {algorithm}: time grows with {over} to the", power, ""))
    return table + _exactness() + _trimming()


def series(found: list[Grown], algorithm: str, over: str) -> tuple[list[float], list[float]]:
    """Numbers of functions or of samples, and the times they took."""
    middle = 4 * int(np.prod(GRIDS[1]))
    chosen = [
        g
        for g in found
        if g.algorithm == algorithm
        and (g.episodes == EPISODES if over == "functions" else g.functions == middle)
    ]
    return [float(getattr(g, over)) for g in chosen], [g.seconds for g in chosen]


def _exactness() -> list[Row]:
    """One unknown for each sample against one for each function, where both fit."""
    chosen, rng = settings("refreshed", GRIDS[2]), np.random.default_rng(6)
    basis, n = chosen.features(), 1500
    state = rng.uniform(chosen.low, chosen.high, (n, 4))
    action = rng.integers(4, size=n)
    following, reward, ended = TASK.step(state, action)
    rows = Transitions(state, action, reward, following, ended, ~ended)
    weight, policy = rng.uniform(0.1, 1.0, n), rng.integers(4, size=n)
    dense, dual = (
        kind(rows, basis, 4, TASK.description.gamma, weight, 1e-3).evaluate(policy).weights
        for kind in (BlockSystem, DualSystem)
    )
    difference = float(np.abs(dual - dense).max() / np.abs(dense).max())
    return [
        at_most("slung load, 2916 functions: weights by samples and by functions differ",
                difference, "relative", 1e-6),
    ]  # fmt: skip


def _trimming() -> list[Row]:
    """What trimming by convex hull (T 9-1-4) keeps, saves and costs, on demonstration set 5."""
    chosen = LSPISettings(centers=(11, 11), periodic=(False,))
    core = OnlineLSPI(HANGING.description, chosen, np.random.default_rng(0))
    demonstrations = samples("set 5", HANGING, 0)
    assert demonstrations is not None
    core.pretrain(demonstrations)
    seconds, costs = [], []
    whole = core.features
    assert isinstance(whole, RBFGrid)
    for basis in (whole, whole.trim(demonstrations.state)):
        zeros = np.zeros((3, basis.size))

        def learn(basis: RBFGrid = basis, start: Array = zeros) -> Array:
            found = refresh(core.buffer, 0, basis, core.task, core.settings, start)
            return found.weights

        seconds.append(fastest(learn, 3))
        flown = evaluate(HANGING, policy_of(learn(), basis))
        costs.append(flown.discounted_return / best_flight(HANGING).discounted_return)
    kept = whole.trim(demonstrations.state).size / whole.size
    name = "pendulum, set 5, trimmed by convex hull (T 9-1-4)"
    return [
        Row(f"{name}: functions kept", kept, "share"),
        Row(f"{name}: time of learning offline", seconds[1] / seconds[0], "of untrimmed"),
        Row(f"{name}: cost", costs[1], "x near-optimal"),
        Row("pendulum, set 5, not trimmed: cost", costs[0], "x near-optimal"),
    ]
