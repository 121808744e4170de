"""What is learned: cost over near-optimal, from every kind of sample, over vehicle time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.bench.rows import Row, at_least, at_most
from iolspi_ros.experiments import engine
from iolspi_ros.experiments.cells import Cell
from iolspi_ros.experiments.pendulum import HANGING, LITERAL, REFRESHED, PendulumRun, best, learn
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.samplesets import NOTHING, SEQUENTIAL
from iolspi_ros.experiments.statistics import interval

Array = NDArray[np.float64]

SOURCES = ("set 1", "set 2", "set 3", "set 4", "set 5", SEQUENTIAL, NOTHING)
JUMP = "set 5, g jumps at 300 s"
ALGORITHMS = {"refreshed": replace(REFRESHED, update_interval=250), "literal": LITERAL}
DEADLINE = dict.fromkeys(SOURCES, 10.0) | {NOTHING: 25.0}
"""Vehicle time by which a policy should be near-optimal [s]."""
HORIZON = 60.0
"""Vehicle time that is flown in all [s]."""
FORGETTING = 0.99991
"""η of the jump: 1 % left after 50,000 steps, the best of T IV-A-5."""


@dataclass(frozen=True)
class Curves:
    """Policies of all realisations of one setting over time.

    Attributes
    ----------
    time : ndarray of shape (n_policies,)
        Vehicle time [s].
    ratio : ndarray of shape (n_seeds, n_policies)
        Discounted cost over near-optimal.
    upright : ndarray of shape (n_seeds, n_policies)
        Share of the episodes' last 0.5 s spent within 15° of upright.
    whole : ndarray of shape (n_seeds, n_policies)
        Share of the episodes that were upright for all of it.
    """

    time: Array
    ratio: Array
    upright: Array
    whole: Array


def settings() -> Mapping[tuple[str, str], PendulumRun]:
    """What is learned, by source (or `JUMP`) and algorithm; every policy is looked at."""
    found = {}
    for name, learner in ALGORITHMS.items():
        for source in SOURCES:
            found[source, name] = _every_update(
                PendulumRun(learner, samples=source, seconds=HORIZON)
            )
        careful = replace(learner, epsilon=0.05, forget_factor=FORGETTING)
        jump = replace(HANGING, g_after=19.81, g_change_start=300.0)  # T IV-A-4
        found[JUMP, name] = _every_update(
            PendulumRun(careful, jump, samples="set 5", seconds=420.0)
        )
    return found


def _every_update(setting: PendulumRun) -> PendulumRun:
    between = setting.learner.update_interval * setting.task.description.sampling_time
    return replace(setting, looks=round(setting.seconds / between))


def total(seeds: int) -> int:
    """Number of realisations."""
    return seeds * len(settings())


def measure(seeds: int, show: Callable[[int], None]) -> Mapping[tuple[str, str], Curves]:
    """Every realisation, on every core; those of an earlier call are in the user's cache."""
    store = Store(resources.cache_folder() / "realisations")
    found = {}
    cells = {key: Cell(str(key), learn, s, seeds) for key, s in settings().items()}
    lacking = engine.missing(cells.values(), store)
    already = total(seeds) - len(lacking)
    engine.run(lacking, store.write, engine.local(-1), lambda done: show(already + round(done)))
    data = engine.gather(cells.values(), store)
    for key, cell in cells.items():
        curves, setting = data[cell.label], cell.setting
        times, task = curves["time"][0], setting.task
        ends = {
            g: best(PendulumRun(task=replace(task, g=g), seconds=0.0, looks=0), 0)["discounted"][0]
            for g in {task.gravity(time) for time in times}
        }
        baseline = np.array([ends[task.gravity(time)] for time in times])
        ratio = curves["discounted"] / baseline
        found[key] = Curves(times, ratio, curves["upright"], curves["whole"])
    return found


def rows(found: Mapping[tuple[str, str], Curves]) -> list[Row]:
    """The figures, refreshed ones with goals and literal ones beside."""
    rows = []
    for source in SOURCES:
        for algorithm in ALGORITHMS:
            rows += _figures(found[source, algorithm], source, algorithm)
    for algorithm in ALGORITHMS:
        chosen = found[JUMP, algorithm]
        at = chosen.ratio[:, np.searchsorted(chosen.time, 360.0)]
        name = f"g jumps, {algorithm}: cost after 60 s"
        rows.append(_goal(algorithm, at_most, name, interval(at).high, 1.03))
    return rows


def _figures(chosen: Curves, source: str, algorithm: str) -> list[Row]:
    deadline, name = DEADLINE[source], f"{source}, {algorithm}"
    ratio, upright, whole = chosen.ratio, chosen.upright, chosen.whole
    first = int(np.searchsorted(chosen.time, deadline))
    later = max(interval(column).high for column in ratio[:, first:].T)
    mean, _, most = interval(ratio[:, first])
    worst = float(ratio[:, first:].max())
    up, least, _ = interval(upright[:, first])
    at = f"at {deadline:g} s"
    return [
        _goal(algorithm, at_most, f"{name}: cost {at}, mean", mean, 1.005),
        Row(f"{name}: cost {at}, upper 95 %", most, "x near-optimal"),
        Row(f"{name}: cost {at}, worst seed", float(ratio[:, first].max()), "x near-optimal"),
        Row(f"{name}: cost at any later update, upper 95 %", later, "x near-optimal"),
        _goal(algorithm, at_most, f"{name}: cost, worst later update of all seeds", worst, 1.01),
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
