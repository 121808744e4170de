"""What an expert at the learner's side is good for: episodes until it dunks, and what breaks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.bench.rows import Row
from iolspi_ros.experiments import engine
from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.interventions import (
    CONFIRMING,
    NOBODY,
    WATCHING,
    InterventionRun,
    help_learning,
)
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.samplesets import NOTHING
from iolspi_ros.experiments.statistics import Interval, difference, interval
from sim_nodes.tasks.slung_load.dynamics import Outcome

SOURCES = (NOTHING, "set 5")
HELPERS: Mapping[str, dict[str, Any]] = {
    "alone": {"helper": NOBODY},
    "watched": {"helper": WATCHING},
    "watched, at the first loss": {"helper": WATCHING, "loss": 5.0},
    "watched, at the first loss, first 100 episodes": {
        "helper": WATCHING,
        "loss": 5.0,
        "stays": 100,
    },
    "each mistake prevented": {"helper": CONFIRMING, "loss": 5.0},
}
LAST = 50
"""Episodes at the end over which a policy is judged."""
_COST = 60.0  # s


def cells(seeds: int) -> list[Cell]:
    """What is flown."""
    return [
        Cell(f"{source}: {name}", help_learning, InterventionRun(samples=source, **how), seeds,
             _COST)
        for source in SOURCES for name, how in HELPERS.items()
    ]  # fmt: skip


def measure(seeds: int, show: Callable[[float], None]) -> Data:
    """Every realisation, on every core; those of an earlier call are in the user's cache."""
    store, wanted = Store(resources.cache_folder() / "realisations"), cells(seeds)
    lacking = engine.missing(wanted, store)
    already = sum(cell.seeds for cell in wanted) - len(lacking)
    engine.run(
        lacking, store.write, engine.local(-1), lambda done: show(already + done / _COST)
    )  # fmt: skip
    return engine.gather(wanted, store)


def rows(data: Data) -> list[Row]:
    """Each setting's numbers, and how they differ from those of a learner alone, seed by seed."""
    found: list[Row] = []
    for source in SOURCES:
        alone = numbers(data[f"{source}: alone"])
        for name in HELPERS:
            mine = numbers(data[f"{source}: {name}"])
            for what, values in mine.items():
                found += _with_interval(f"{source}, {name}: {what}", interval(values))
                if name != "alone":
                    title = f"{source}, {name}: {what}, more than alone"
                    found += _with_interval(title, difference(values, alone[what]))
    return found


def numbers(cell: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.float64]]:
    """What is looked at, of each realisation; an end never reached counts as the last episode."""
    ending, taken = cell["ending"], cell["taken"]
    quarter = taken.shape[1] // 4
    return {
        "episodes to 95 % dunks": cell["until"].astype(float),
        "reached [%]": 100.0 * cell["reached"],
        "greedy dunks at the end [%]": 100.0 * cell["dunks"][:, -LAST:].mean(axis=1),
        "dunks while learning [%]": 100.0 * (ending == Outcome.DUNK).mean(axis=1),
        "crashes per 1,000 episodes": 1000.0 * (ending >= Outcome.CABLE).mean(axis=1),
        "taken over, first quarter [%]": 100.0 * taken[:, :quarter].mean(axis=1),
        "taken over, last quarter [%]": 100.0 * taken[:, -quarter:].mean(axis=1),
    }


def _with_interval(name: str, value: Interval) -> list[Row]:
    return [
        Row(name, value.mean, ""),
        Row(f"{name}, lower 95 %", value.low, ""),
        Row(f"{name}, upper 95 %", value.high, ""),
    ]
