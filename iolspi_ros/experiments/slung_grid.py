"""Runs of Q-learning on the slung load's grid: what T chapter 5 and appendix A show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.slung_grid_demonstrations import demonstrate
from iolspi_ros.methods.tabular import Learned, greedy, initial, learn, optimal
from sim_nodes.tasks.slung_grid import SlungGrid

Array = NDArray[np.float64]

BINS = 50
"""Points of a learning curve."""
SATISFACTORY = -25.0
"""Any flight into the basket within T_end, never steep, scores more: T 6-1 calls it so."""
WINDOW = 50
"""Episodes over which most must be satisfactory for learning to have converged."""
CUTOFFS = (1, 2, 5, 10, 20)
"""Least visits C of a pair to count in a mean value; T 5-4-1 has five, and does not say which."""
DIMENSIONS = ("position", "velocity", "angle", "rate")


@dataclass(frozen=True)
class Trial:
    """One run of T Algorithm 9, or 10.

    Attributes
    ----------
    demonstrations : int
        Number of the set (T Table 5-3); 0 for none.
    q0, epsilon, alpha : float
        Q_0, ε and α; the defaults are appendix A's reference setting.
    episodes : int
        K.
    ordered : bool
        Of equal values prefer doing nothing, then left, as an arg max that takes the first may;
        otherwise draw.
    """

    demonstrations: int = 0
    q0: float = -50.0
    epsilon: float = 0.01
    alpha: float = 0.01
    episodes: int = 2000
    ordered: bool = False


@dataclass(frozen=True)
class Sweep:
    """Some trials that differ in one parameter.

    Attributes
    ----------
    trial : Trial
    parameter : str
        A field of it.
    values : tuple of float
    """

    trial: Trial
    parameter: str
    values: tuple[float, ...]

    @property
    def trials(self) -> list[Trial]:
        """One for each value."""
        changes: list[dict[str, Any]] = [{self.parameter: value} for value in self.values]
        return [replace(self.trial, **change) for change in changes]


@dataclass(frozen=True)
class Survey:
    """One long run from zeros, whose values are looked at (T 5-4).

    Attributes
    ----------
    scattered : bool
        Begin at any x and θ; otherwise at the start.
    episodes : int
    """

    scattered: bool = True
    episodes: int = 100_000

    def quick(self) -> Survey:
        """A shorter one."""
        return replace(self, episodes=self.episodes // 10)


@cache
def _grid() -> SlungGrid:
    return SlungGrid()


def _run(setting: Trial, seed: int) -> tuple[Learned, list[float]]:
    """What was learned, and the scores of the demonstrations."""
    grid = _grid()
    shown = demonstrate(grid, setting.demonstrations, seed) if setting.demonstrations else []
    q = initial(grid.task, setting.q0, shown)
    if setting.ordered:
        q -= np.array([1e-9, 0.0, 2e-9])
    learned = learn(
        grid.task, q, np.array([grid.start]), setting.episodes, epsilon=setting.epsilon,
        alpha=setting.alpha, rng=np.random.default_rng([seed, 9]),
    )  # fmt: skip
    return learned, [flight.score for flight in shown]


def _converged(scores: Array) -> float:
    """Episode from which on four of five in the next `WINDOW` are satisfactory, or their number."""
    good = np.cumsum(np.insert(scores > SATISFACTORY, 0, False))
    often = np.asarray(good[WINDOW:] - good[:-WINDOW] >= 0.8 * WINDOW)
    return float(often.argmax()) if often.any() else float(len(scores))


def trial(setting: Trial, seed: int) -> Mapping[str, Any]:
    """One run.

    Returns
    -------
    average : float
        Mean return over all episodes.
    greedy : float
        Return of the greedy policy in the end.
    angle : float
        θ with which that one ends [deg].
    shown, variety : float
        Mean return of the demonstrations, and its standard deviation; NaN without.
    converged : float
        See `_converged`.
    visits, pairs : int
        Steps taken, and pairs of state and action seen.
    episode, score, running : ndarray of shape (BINS,)
        Where the curves' points are; mean return of the episodes since the point before, and of
        all so far.
    """
    learned, shown = _run(setting, seed)
    last = greedy(_grid().task, learned.q, _grid().start)
    bins = np.array_split(learned.scores, BINS)
    ends = np.cumsum([len(part) for part in bins])
    return {
        "average": learned.scores.mean(),
        "greedy": last.score,
        "angle": _grid().states(last.states[-1:])[0, 2],
        "shown": np.mean(shown) if shown else np.nan,
        "variety": np.std(shown) if shown else np.nan,
        "converged": _converged(learned.scores),
        "visits": learned.visits.sum(),
        "pairs": np.count_nonzero(learned.visits),
        "episode": ends.astype(float),
        "score": np.array([part.mean() for part in bins]),
        "running": np.cumsum(learned.scores)[ends - 1] / ends,
    }


def sweep(setting: Sweep, seed: int) -> Mapping[str, Any]:
    """Values of the parameter, with `average` and `converged` of each, shape (n_values,)."""
    scores = [_run(one, seed)[0].scores for one in setting.trials]
    return {
        "value": np.array(setting.values),
        "average": np.array([some.mean() for some in scores]),
        "converged": np.array([_converged(some) for some in scores]),
    }


def survey(setting: Survey, seed: int) -> Mapping[str, Any]:
    """Visits and values by each variable of the state.

    Returns
    -------
    visits, pairs : int
        As of `trial`.
    visits_D : ndarray of shape (n_D,)
        Visits by dimension D of `DIMENSIONS`.
    value_D : ndarray of shape (len(CUTOFFS), n_D)
        Mean Q over the pairs with at least C visits; NaN where there are none.
    """
    grid = _grid()
    starts = grid.scattered() if setting.scattered else np.array([grid.start])
    learned = learn(
        grid.task, initial(grid.task, 0.0), starts, setting.episodes, epsilon=0.01, alpha=0.01,
        rng=np.random.default_rng([seed, 5]),
    )  # fmt: skip
    seen = np.flatnonzero(learned.visits)
    visits, q = learned.visits.ravel()[seen], learned.q.ravel()[seen]
    index = np.unravel_index(seen // learned.q.shape[1], grid.counts)
    found: dict[str, Any] = {"visits": visits.sum(), "pairs": len(seen)}
    for name, entry, count in zip(DIMENSIONS, index, grid.counts, strict=True):
        found[f"visits_{name}"] = np.bincount(entry, visits, count)
        means = []
        for least in CUTOFFS:
            enough = visits >= least
            total = np.bincount(entry[enough], q[enough], count)
            number = np.bincount(entry[enough], minlength=count)
            means.append(np.where(number > 0, total / np.maximum(number, 1), np.nan))
        found[f"value_{name}"] = np.array(means)
    return found


def best(setting: SlungGrid, seed: int) -> Mapping[str, Any]:
    """The largest return that there is from the start, by dynamic programming."""
    return {"score": optimal(setting.task, setting.start).score}
