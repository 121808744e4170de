"""T IV-B and chapter 11, the quadrotor with a slung load: figures 21 and 22, table 3."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iolspi_ros import figures
from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.slung_load import DEFAULT, INFORMED, ONLINE, SlungLoadRun, best, drop
from iolspi_ros.experiments.slung_load_timing import timed
from iolspi_ros.experiments.statistics import interval, intervals
from iolspi_ros.experiments.thesis import drawing
from iolspi_ros.experiments.thesis.curves import NEAR_OPTIMAL
from iolspi_ros.experiments.thesis.slung_load_claims import (
    BIN,
    CLAIMS,
    CONSTANT,
    DEFAULT_SHIELDED,
    DEFAULT_T,
    FINE,
    GREEDY,
    INFORMED_T,
    NARROW,
    NARROW_INFORMED,
    NARROW_LARGE,
    ONLINE_T,
    REFRESHED_T,
    SHIELDED,
    binned,
)
from iolspi_ros.experiments.thesis.study import Rows, Study

Array = NDArray[np.float64]

SET = "set 5"
"""Of the demonstrations: explore, a third of the actions random, T's best for the pendulum."""
LARGE = DEFAULT.centers
"""Centres of the larger grid: 2,240 functions, the velocities among them."""
FINEST = (5, 5, 7, 5)
"""3,500 functions: more hardly dunk more, and take longer."""
SHORTER = 6_000
"""Episodes of what takes long or has long converged by then."""
SHORTEST = 2_000
"""Episodes of the default learner: the goals are for 500 and for these."""
FEW = 6
"""Realisations of those; `iolspi bench safety` takes as many of them as of the others."""

_REFRESHED = replace(INFORMED, algorithm="refreshed")
_LARGER = replace(INFORMED, centers=LARGE)
_GRIDS = {36: (9, 1, 1, 1), 324: (9, 1, 9, 1), 2916: (9, 9, 9, 1)}
T_TABLE_3 = {36: 10.2, 324: 18.5, 2916: 349.5}
"""Seconds of Matlab R2015a; 26,244 functions did not fit in its memory."""


def _cell(label: str, setting: SlungLoadRun, cost: float, seeds: int = 20) -> Cell:
    return Cell(label, drop, setting, seeds, cost)


def safety() -> tuple[Cell, ...]:
    """What figures 21 and 22 and `iolspi bench safety` are computed from."""
    return (
        _cell(ONLINE_T, SlungLoadRun(ONLINE), 6.0),
        _cell(INFORMED_T, SlungLoadRun(INFORMED, samples=SET), 8.0),
        _cell(REFRESHED_T, SlungLoadRun(_REFRESHED, samples=SET, episodes=SHORTER, looks=6), 20.0,
              FEW),
        _cell(DEFAULT_T, SlungLoadRun(DEFAULT, samples=SET, episodes=SHORTEST, looks=4), 80.0, FEW),
        _cell(DEFAULT_SHIELDED, SlungLoadRun(replace(DEFAULT, shield=True), samples=SET,
                                             episodes=SHORTEST, looks=4), 100.0, FEW),
        _cell(GREEDY, SlungLoadRun(_LARGER, samples=SET, episodes=SHORTER, looks=6), 25.0, FEW),
        _cell(SHIELDED, SlungLoadRun(replace(_LARGER, shield=True), samples=SET, episodes=SHORTER,
                                 looks=6), 50.0, FEW),
        _cell(FINE, SlungLoadRun(replace(_LARGER, centers=FINEST), samples=SET, episodes=SHORTER,
                             looks=6), 60.0, FEW),
        Cell(NEAR_OPTIMAL, best, SlungLoadRun(), 1, 30.0),
    )  # fmt: skip


def narrow() -> tuple[Cell, ...]:
    """From the narrow initial conditions (T 11-2), and epsilon = 0.01 from nothing (T 11-1)."""
    return (
        _cell(CONSTANT, SlungLoadRun(INFORMED), 3.0),
        _cell(INFORMED_T, SlungLoadRun(INFORMED, samples=SET), 8.0),
        _cell(NARROW, SlungLoadRun(ONLINE, "narrow"), 3.0),
        _cell(NARROW_INFORMED, SlungLoadRun(INFORMED, "narrow", SET), 4.0),
        _cell(NARROW_LARGE, SlungLoadRun(_LARGER, "narrow", SET, SHORTER, 6), 30.0, FEW),
    )


def studies() -> list[Study]:
    """Every study of this part, in T's order."""
    title = "Quadrotor with a slung load"
    return [
        Study("fig21", f"{title}: sum of rewards per episode", "Part I, IV-B-1, Fig. 21", safety(),
              _scores, drawing.curves(title, "sum of rewards per episode", -40.0, "episodes"),
              CLAIMS["fig21"]),
        Study("fig22", f"{title}: how episodes end", "Part I, IV-B-1, Fig. 22", safety(),
              _shares, _draw_shares, CLAIMS["fig22"]),
        Study("narrow", f"{title}: narrow initial conditions", "11-1 and 11-2", narrow(),
              _shares, _draw_shares, CLAIMS["narrow"]),
        Study("table3", f"{title}: time of 1,000 episodes", "Part I, IV-B-1, Table 3", _timed(),
              _times, claims=CLAIMS["table3"]),
    ]  # fmt: skip


def _timed() -> tuple[Cell, ...]:
    cells = []
    for functions, grid in _GRIDS.items():
        learner = replace(ONLINE, centers=grid, epsilon_decay=0.995)
        cells.append(Cell(f"{functions} functions", timed, learner, 5, 0.001 * functions))
    return tuple(cells)


def _times(data: Data) -> Rows:
    found: Rows = []
    for functions, (label, cell) in zip(_GRIDS, data.items(), strict=True):
        mean, low, high = interval(cell["seconds"])
        found.append(
            {"functions": functions, "seconds": mean, "low": low, "high": high,
             "samples": float(cell["samples"].mean()), "T": T_TABLE_3[functions], "cell": label}
        )  # fmt: skip
    return found


def _scores(data: Data) -> Rows:
    found: Rows = []
    for label, cell in data.items():
        score = cell["score"]
        if label == NEAR_OPTIMAL:
            last = max(other["score"].shape[-1] for other in data.values() if other is not cell)
            count = last // BIN
            values: Array = np.broadcast_to(score[:, None], (len(score), count))
        else:
            count = score.shape[1] // BIN
            values = score[:, : count * BIN].reshape(len(score), count, BIN).mean(axis=2)
        for k, (mean, low, high) in enumerate(zip(*intervals(values), strict=True)):
            found.append({"curve": label, "x": (k + 0.5) * BIN, "mean": mean, "low": low,
                          "high": high, "n": len(score)})  # fmt: skip
    return found


def _shares(data: Data) -> Rows:
    found: Rows = []
    for label, cell in data.items():
        if label == NEAR_OPTIMAL:
            continue
        for what in ("crashes", "misses", "dunks"):
            values = 100.0 * binned(cell["ending"], what)
            for k, (mean, low, high) in enumerate(zip(*intervals(values), strict=True)):
                found.append({"curve": label, "what": what, "x": (k + 0.5) * BIN, "mean": mean,
                              "low": low, "high": high, "n": len(values)})  # fmt: skip
    return found


def _draw_shares(rows: Rows) -> Figure:
    """Three panels: per cent of crashes, misses and dunks over episodes."""
    figure, panels = figures.panels(6.6, 3, sharex=True)
    for axes, what in zip(panels, ("crashes", "misses", "dunks"), strict=True):
        drawing.means(axes, [row for row in rows if row["what"] == what])
        last = "episodes" if axes is panels[-1] else ""
        figures.dress(axes, "", last, f"{what} [%]")
    figures.legend(figure)
    return figure
