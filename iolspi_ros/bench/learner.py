"""What is learned: cost over near-optimal, from every kind of sample, over vehicle time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.bags import read_demonstration
from iolspi_ros.bench.rows import Row, at_least, at_most, interval
from iolspi_ros.core.learner_settings import LearnerSettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy, policy_of
from iolspi_ros.experiments.headless import Listener, train
from sim_nodes.tasks import make_task
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.pendulum import UPRIGHT_ANGLE, UPRIGHT_TIME
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

SECONDS = 600.0
SOURCES = ("set 1", "set 2", "set 3", "set 4", "set 5", "random", "nothing")
DEADLINE = dict.fromkeys(SOURCES, 20.0) | {"nothing": 40.0}
"""Vehicle time by which a policy should be near-optimal [s]."""
LITERAL = LearnerSettings(algorithm="literal", periodic=(False,))
REFRESHED = LearnerSettings()
STILL = make_task("pendulum", {}, "bench")
JUMP = make_task("pendulum", {"g_after": 19.81, "g_change_start": 300.0}, "bench")
"""T IV-A-4."""
FORGETTING = 0.99991
"""η of the jump: 1 % left after 50,000 steps, the best of T IV-A-5."""


@dataclass(frozen=True)
class Curve:
    """Policies of one realisation over time.

    Attributes
    ----------
    source : str
    algorithm : str
    seed : int
    time : ndarray of shape (n_policies,)
        Vehicle time [s].
    ratio : ndarray of shape (n_policies,)
        Discounted cost over near-optimal.
    upright : ndarray of shape (n_policies,)
        Share of the episodes' last 0.5 s spent within 15° of upright.
    whole : ndarray of shape (n_policies,)
        Share of the episodes that were upright for all of it.
    """

    source: str
    algorithm: str
    seed: int
    time: Array
    ratio: Array
    upright: Array
    whole: Array


@cache
def best_return(jump: bool, time: float) -> float:
    """Near-optimal mean discounted return under the conditions of a time."""
    task = JUMP if jump else STILL
    return evaluate(task, near_optimal_policy(task, time=time), time).discounted_return


def samples(source: str, seed: int) -> Transitions | None:
    """What a realisation learns from before it flies."""
    task = STILL
    if source.startswith("set "):
        path = resources.find("demos", "pendulum", f"set_{source[4:]}")
        return read_demonstration(path, task.name, task.joints).transitions(2)
    if source == "nothing":
        return None
    rng = np.random.default_rng([seed, 2])  # random actions in whole episodes (T fig. 8)
    world = World(task, WorldSettings(order="sweep"), rng)
    rows = []
    for episode in range(len(task.initial_states())):
        seen = world.begin(episode)
        while not seen.last:
            after = world.move(episode, int(rng.integers(3)))
            rows.append(
                Transition(
                    seen.state, after.action, after.reward, after.state, after.terminated,
                    after.truncated,
                )
            )  # fmt: skip
            seen = after
    return Transitions.of(rows, 2)


def fly(source: str, settings: LearnerSettings, seed: int, task: Task, seconds: float) -> Curve:
    """One realisation: learn from samples, go on online, judge every policy on the model."""
    core = OnlineLSPI(settings, np.random.default_rng([seed, 1]))
    found: list[tuple[float, float, float, float]] = []

    def look(time: float) -> None:
        flown = evaluate(task, policy_of(core.weights, core.features), time)
        ends = np.abs(flown.states[-round(UPRIGHT_TIME / task.dt) :, :, 0]) <= UPRIGHT_ANGLE
        ratio = flown.discounted_return / best_return(task == JUMP, time)
        found.append((time, ratio, float(ends.mean()), flown.success_fraction))

    taught = samples(source, seed)
    if taught is not None:
        core.inform(taught)
    look(0.0)
    world = World(task, WorldSettings(), np.random.default_rng([seed, 0]))
    listener = Listener(on_update=lambda update: look(update.step * task.dt))
    train(world, core, round(seconds / (task.dt * task.episode_steps)), listener)
    return Curve(source, settings.algorithm, seed, *np.array(found).T)


def curves(seeds: int, show: Callable[[int], None]) -> tuple[list[Curve], list[Curve]]:
    """Every realisation, on every core.

    Returns
    -------
    still, jump : list of Curve
        With constant g, and with g that jumps.
    """
    task = STILL
    work = [
        delayed(fly)(source, settings, seed, task, SECONDS)
        for source in SOURCES
        for settings in (LITERAL, REFRESHED)
        for seed in range(seeds)
    ]
    for still in (LITERAL, REFRESHED):
        settings = replace(still, epsilon=0.05, forget_factor=FORGETTING)
        work += [delayed(fly)("set 5", settings, seed, JUMP, 420.0) for seed in range(seeds)]
    for time in (0.0, 300.0):
        best_return(True, time)  # into the cache, once for all processes
    best_return(False, 0.0)
    done: list[Curve] = []
    for curve in Parallel(n_jobs=-1, return_as="generator")(work):
        done.append(curve)
        show(len(done))
    split = 2 * len(SOURCES) * seeds
    return done[:split], done[split:]


def total(seeds: int) -> int:
    """Number of realisations."""
    return 2 * (len(SOURCES) + 1) * seeds


def rows(still: list[Curve], jump: list[Curve]) -> list[Row]:
    """The figures: refreshed ones with their goals, literal ones beside."""
    found = []
    for source in SOURCES:
        for algorithm in ("refreshed", "literal"):
            chosen = [c for c in still if (c.source, c.algorithm) == (source, algorithm)]
            found += _figures(chosen, DEADLINE[source], f"{source}, {algorithm}")
    for algorithm in ("refreshed", "literal"):
        chosen = [c for c in jump if c.algorithm == algorithm]
        at = np.stack([c.ratio[np.searchsorted(c.time, 360.0)] for c in chosen])
        name = f"g jumps, {algorithm}: cost after 60 s"
        found.append(_goal(algorithm, at_most, name, interval(at)[2], 1.03))
    return found


def _figures(chosen: list[Curve], deadline: float, name: str) -> list[Row]:
    time = chosen[0].time
    first = int(np.searchsorted(time, deadline))
    ratio, upright, whole = (
        np.stack([getattr(curve, part) for curve in chosen])
        for part in ("ratio", "upright", "whole")
    )
    algorithm = chosen[0].algorithm
    later = max(interval(ratio[:, k])[2] for k in range(first, len(time)))
    mean, _, most = interval(ratio[:, first])
    up, least, _ = interval(upright[:, first])
    at = f"at {deadline:g} s"
    return [
        Row(f"{name}: cost {at}, mean", mean, "x near-optimal"),
        _goal(algorithm, at_most, f"{name}: cost {at}, upper 95 %", most, 1.01),
        Row(f"{name}: cost {at}, worst seed", float(ratio[:, first].max()), "x near-optimal"),
        _goal(algorithm, at_most, f"{name}: cost at any later update, upper 95 %", later, 1.02),
        Row(f"{name}: cost, worst later update of all seeds",
            float(ratio[:, first:].max()), "x near-optimal"),
        _goal(algorithm, at_least, f"{name}: last 0.5 s upright {at}, mean", up, 0.98),
        Row(f"{name}: last 0.5 s upright {at}, lower 95 %", least, "share"),
        Row(f"{name}: episodes upright for all of it {at}", float(whole[:, first].mean()), "share"),
        Row(f"{name}: last 0.5 s upright, mean of later updates",
            float(upright[:, first:].mean()), "share"),
    ]  # fmt: skip


def _goal(
    algorithm: str,
    compare: Callable[[str, float, str, float], Row],
    name: str,
    value: float,
    goal: float,
) -> Row:
    """A row with its goal for the refreshed learner, and without one for the literal."""
    row = compare(name, value, "share" if compare is at_least else "x near-optimal", goal)
    return row if algorithm == "refreshed" else Row(row.name, row.value, row.unit)
