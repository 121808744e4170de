"""How fast it computes: ratios in one run, both sides first proven to agree."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from iolspi_ros.bench import mushroom
from iolspi_ros.bench.machine import fastest
from iolspi_ros.bench.rows import Row, at_least, at_most
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.lspi import offline_lspi
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.pendulum import LITERAL
from sim_nodes.tasks import make_task
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

COMPARISONS = 5
AGREEMENT = 1e-6
"""Relative difference of weights up to which two sides agree."""
EPISODES = 400  # 600 s
TASK = make_task("pendulum", {}, "bench")


def rows(show: Callable[[int], None]) -> list[Row]:
    """Every comparison."""
    found: list[Row] = []
    parts = (_offline, _online, _own_products, _parallel, _step)
    for number, part in enumerate(parts, 1):
        found += part()
        show(number)
    return found


def _agree(name: str, ours: Array, theirs: Array) -> Row:
    difference = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
    return at_most(f"{name}: weights differ", difference, "relative", AGREEMENT)


def _offline() -> list[Row]:
    """Offline LSPI on uniform samples against MushroomRL's."""
    name = "offline LSPI, 7,500 samples, 363 functions"
    task, rng, n = TASK, np.random.default_rng(0), 7500
    state, action = (
        rng.uniform(task.description.low, task.description.high, (n, 2)),
        rng.integers(3, size=n),
    )
    next_state, reward, ended = task.step(state, action)
    samples = Transitions(state, action, reward, next_state, ended, ended)
    basis = RBFGrid(task.description.low, task.description.high, (11, 11))
    weights = rng.standard_normal((3, 121))

    def ours() -> Array:
        found, _ = offline_lspi(
            samples, basis, 3, weights=weights, gamma=0.98, delta=0.0, chi=1e-2, max_iterations=50
        )
        return found.solve.weights

    found = [Row(f"{name}: ours", fastest(ours, 5), "s")]
    if not mushroom.available():
        return [*found, Row(f"{name}: MushroomRL is not installed", np.nan, "s")]
    for own, label in ((True, "with its own functions"), (False, "with ours")):
        fit, result = mushroom.lspi(samples, basis, 3, 0.98, weights, own)
        took = fastest(fit, 1)
        found += [
            Row(f"{name}: MushroomRL 1.10.2 {label}", took, "s"),
            _agree(f"{name}: MushroomRL {label}", ours(), result()),
        ]
        ratio = took / found[0].value
        title = f"{name}: MushroomRL {label} over ours"
        found.append(at_least(title, ratio, "times", 150.0) if own else Row(title, ratio, "times"))
    return found


@dataclass
class _Flown:
    """What one run of the literal learner saw and found."""

    transitions: list[Transition]
    weights: list[Array]


def _run(interval: int, episodes: int, flown: _Flown | None = None) -> OnlineLSPI:
    settings = LSPISettings(algorithm="literal", periodic=(False,), update_interval=interval)
    core = OnlineLSPI(TASK.description, settings, np.random.default_rng([0, 1]))
    listener = Listener()
    if flown is not None:
        flown.weights.append(core.weights)
        begin = core.begin_update

        def keep() -> Callable[[], object]:
            flown.transitions += list(core.batch.rows())
            return begin()

        core.begin_update = keep  # type: ignore[method-assign,assignment]
        listener = Listener(on_update=lambda update: flown.weights.append(core.weights))
    train(World(TASK, WorldSettings(), np.random.default_rng([0, 0])), core, episodes, listener)
    return core


def _algorithm_2(settings: LSPISettings, interval: int, episodes: int) -> Array:
    """T Algorithm 2 written out: one sample at a time, dense φ(s, a), plain numpy."""
    s, task = settings.resolve(TASK.description), TASK
    mesh = np.meshgrid(*(np.linspace(*limits, 11) for limits in zip(s.low, s.high, strict=True)),
                       indexing="ij")  # fmt: skip
    centers = np.stack([axis.ravel() for axis in mesh], axis=1)
    spacing = np.subtract(s.high, s.low) / 10

    def features(state: Array) -> Array:
        return np.exp(-0.5 * (((state - centers) / spacing) ** 2).sum(axis=1))

    rng, vehicle = np.random.default_rng([0, 1]), np.random.default_rng([0, 0])
    weights: Array = rng.standard_normal((3, 121)).ravel()
    gram, cross, vector = s.delta * np.eye(363), np.zeros((363, 363)), np.zeros(363)
    starts, count = task.initial_states(), 0
    for _ in range(episodes):
        state = starts[vehicle.integers(len(starts))]
        for _ in range(task.description.episode_steps):
            phi = features(state)
            if rng.random() < s.epsilon:
                action = int(rng.integers(3))
            else:
                action = int(np.argmax(weights.reshape(3, -1) @ phi))
            next_state, reward, _ = task.step(state, action)
            after = features(next_state)
            chosen = int(np.argmax(weights.reshape(3, -1) @ after))
            here, there = np.zeros(363), np.zeros(363)
            here[action * 121 : (action + 1) * 121] = phi
            there[chosen * 121 : (chosen + 1) * 121] = after
            gram += np.outer(here, here)
            cross += np.outer(here, there)
            vector += here * reward
            count += 1
            if count % interval == 0:
                matrix = (gram - task.description.gamma * cross) / count
                weights[:] = np.linalg.solve(matrix, vector / count)
                rng.integers(2**63)  # ours draws a generator for ties there
            state = next_state
    return weights.reshape(3, -1)


def _online() -> list[Row]:
    """600 s of online LSPI against Algorithm 2 written out."""
    name = "online LSPI, 600 s, K_theta 1000"
    _run(1000, 4)
    took = fastest(lambda: _run(1000, EPISODES), 3)
    start = time.perf_counter()
    theirs = _algorithm_2(LITERAL, 1000, EPISODES)
    written_out = time.perf_counter() - start
    return [
        Row(f"{name}: ours", took, "s"),
        Row(f"{name}: sample by sample", written_out, "s"),
        _agree(name, _run(1000, EPISODES).weights, theirs),
        at_least(f"{name}: sample by sample over ours", written_out / took, "times", 40.0),
    ]


def _own_products() -> list[Row]:
    """The same against its own matrix products and solves alone."""
    flown = _Flown([], [])
    core = _run(1000, EPISODES, flown)
    basis, updates = core.features, len(flown.weights) - 1
    work = []
    for k in range(updates):
        batch = Transitions.of(flown.transitions[1000 * k : 1000 * (k + 1)], 2)
        phi, after = basis(batch.state), basis(batch.next_state)
        policy = (after @ flown.weights[k].T).argmax(axis=1)
        pairs = [(phi[batch.action == a], phi[batch.action == a]) for a in range(3)]
        pairs += [
            (phi[rows], after[rows])
            for a in range(3)
            for b in range(3)
            if (rows := (batch.action == a) & (policy == b)).any()
        ]
        work.append(pairs)
    matrix = np.random.default_rng(0).standard_normal((363, 363)) + 30.0 * np.eye(363)
    target = np.ones(363)

    def alone() -> None:
        for pairs in work:
            for left, right in pairs:
                left.T @ right
            np.linalg.solve(matrix, target)

    took, least = fastest(lambda: _run(1000, EPISODES), 3), fastest(alone, 3)
    name = "online LSPI, 600 s: all of it over its dgemm and solve calls alone"
    return [
        Row("online LSPI, 600 s: its dgemm and solve calls alone", least, "s"),
        at_most(name, took / least, "times", 1.5),
        *_often(),
    ]


def _often() -> list[Row]:
    """120 s with 800 solves."""
    name = "online LSPI, 120 s, K_theta 30"
    _run(30, 1)
    return [
        Row(f"{name}: ours, a fresh dense solve each time", fastest(lambda: _run(30, 80), 2), "s")
    ]


def _realisation(seed: int) -> float:
    core = OnlineLSPI(TASK.description, LITERAL, np.random.default_rng([seed, 1]))
    train(World(TASK, WorldSettings(), np.random.default_rng([seed, 0])), core, 100, Listener())
    return float(np.linalg.norm(core.weights))


def _parallel() -> list[Row]:
    """Fifty realisations of a setting on two cores against one core."""
    with Parallel(n_jobs=2) as pool:
        pool(delayed(_realisation)(seed) for seed in range(4))  # compiles in both processes
        start = time.perf_counter()
        both = pool(delayed(_realisation)(seed) for seed in range(50))
        together = time.perf_counter() - start
    _realisation(0)
    start = time.perf_counter()
    single = [_realisation(seed) for seed in range(50)]
    alone = time.perf_counter() - start
    name = "50 realisations of 150 s on 2 cores"
    return [
        Row(f"{name}: one core", alone, "s"),
        at_most(f"{name}: results differ", float(np.abs(np.subtract(both, single)).max()), "", 0.0),
        at_least(f"{name}: one core over two", alone / together, "times", 1.8),
    ]


def _step() -> list[Row]:
    """One step of `act` and of `observe`, as a node calls them."""
    core = OnlineLSPI(TASK.description, LSPISettings(centers=(11, 11), epsilon=0.0), np.random.default_rng(0))
    rng = np.random.default_rng(1)
    states = rng.uniform(core.settings.low, core.settings.high, (2000, 2))
    acting, observing = np.empty(2000), np.empty(2000)
    for k, state in enumerate(states):
        start = time.perf_counter()
        action, _ = core.act(state)
        middle = time.perf_counter()
        if core.observe(Transition(state, action, -1.0, states[k - 1])):
            core.batch.take()
        observing[k] = time.perf_counter() - middle
        acting[k] = middle - start
    return [
        at_most("act, 363 functions, median", 1e6 * float(np.median(acting)), "µs", 20.0),
        at_most("observe, 363 functions, median", 1e6 * float(np.median(observing)), "µs", 20.0),
    ]
