"""Learning curves: their cells, their numbers as rows, and what claims look at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.pendulum import PendulumRun, best, learn
from iolspi_ros.experiments.statistics import intervals
from iolspi_ros.experiments.thesis.study import Rows

Array = NDArray[np.float64]

SECONDS = 600.0
"""Length of T's runs; times below are of such a run, and are scaled for a shorter one [s]."""
NEAR_OPTIMAL = "near-optimal"
REFRESHED_SEEDS = 3
_EPISODES_AVERAGED = 4
_LITERAL_COST, _REFRESHED_COST, _BASELINE_COST = 0.45, 22.0, 3.0  # s


def refreshed(label: str) -> str:
    """Label of a cell's refreshed counterpart."""
    return f"{label}, refreshed"


def cells(
    settings: Mapping[str, PendulumRun],
    also_refreshed: Iterable[str] = (),
    baselines: tuple[str, ...] = (),
) -> tuple[Cell, ...]:
    """Cells of one figure.

    Parameters
    ----------
    settings : mapping
        Literal IOLSPI, by label.
    also_refreshed : iterable of str
        Labels that the refreshed learner learns too.
    baselines : tuple of str
        Labels whose tasks' near-optimal policies stand beside; by default the first one's, for
        all.
    """
    found = [Cell(label, learn, s, cost=_cost(s)) for label, s in settings.items()]
    for label in also_refreshed:
        setting = settings[label]
        learner = replace(setting.learner, algorithm="refreshed", periodic=(True, False))
        cost = _REFRESHED_COST * setting.seconds / SECONDS
        found.append(
            Cell(refreshed(label), learn, replace(setting, learner=learner), REFRESHED_SEEDS, cost)
        )
    for label in baselines or (next(iter(settings)),):
        setting = settings[label]
        same = PendulumRun(task=setting.task, seconds=setting.seconds, looks=setting.looks)
        name = f"{NEAR_OPTIMAL}, {label}" if baselines else NEAR_OPTIMAL
        found.append(Cell(name, best, same, seeds=1, cost=_BASELINE_COST))
    return tuple(found)


def _cost(setting: PendulumRun) -> float:
    solves = setting.seconds / 0.005 / setting.learner.update_interval
    return _LITERAL_COST * setting.seconds / SECONDS + solves * 1.6e-3


def returns(data: Data) -> Rows:
    """Discounted return of the policy in use over vehicle time."""
    return _rows(data, lambda cell: (cell["time"][0], cell["discounted"]))


def uprights(data: Data) -> Rows:
    """Share of the last 0.5 s upright of the policy in use over vehicle time; T has no such."""
    there = {name: cell for name, cell in data.items() if "upright" in cell}
    return _rows(there, lambda cell: (cell["time"][0], cell["upright"]))


def scores(data: Data) -> Rows:
    """Learning score over vehicle time, in means of four episodes."""
    return _rows(data, _binned)


def _binned(cell: Mapping[str, NDArray[Any]]) -> tuple[Array, Array]:
    score, time = cell["score"], cell["time"][0]
    if score.shape[1] == len(time):  # the baseline's, one for each time
        return time, score
    count = score.shape[1] // _EPISODES_AVERAGED
    whole = score[:, : count * _EPISODES_AVERAGED].reshape(len(score), count, -1).mean(axis=2)
    return (np.arange(count) + 0.5) / count * time[-1], whole


def only(labels: Iterable[str], tabulate: Callable[[Data], Rows]) -> Callable[[Data], Rows]:
    """Rows of some cells; the others are there for claims."""
    chosen = set(labels)
    return lambda data: tabulate({k: cell for k, cell in data.items() if k in chosen})


def _rows(data: Data, take: Callable[[Mapping[str, NDArray[Any]]], tuple[Array, Array]]) -> Rows:
    found: Rows = []
    for label, cell in data.items():
        x, y = take(cell)
        for at, mean, low, high in zip(x, *intervals(y), strict=True):
            found.append(
                {"curve": label, "x": at, "mean": mean, "low": low, "high": high, "n": len(y)}
            )
    return found


def over(data: Data, label: str, what: str, begin: float, end: float) -> Array:
    """Mean of a curve from one time to another of a 600 s run, shape (n_seeds,).

    Parameters
    ----------
    what : {"discounted", "upright", "whole", "score"}
    begin, end : float
        Ends included [s]. A stretch between two looks takes the nearer one.
    """
    cell = data[label]
    values, last = cell[what], cell["time"][0, -1]
    n = values.shape[1]
    time = cell["time"][0] if n == cell["time"].shape[1] else (np.arange(n) + 0.5) / n * last
    begin, end = begin * last / SECONDS, end * last / SECONDS
    chosen = (time >= begin) & (time <= end)
    if not chosen.any():
        chosen[np.abs(time - (begin + end) / 2).argmin()] = True
    return np.asarray(values[:, chosen].mean(axis=1))
