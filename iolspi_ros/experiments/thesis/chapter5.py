"""T chapter 5 and appendix A: Q-learning on the discrete slung load, alone and informed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.slung_grid import (
    CUTOFFS,
    DIMENSIONS,
    Survey,
    Sweep,
    Trial,
    best,
    survey,
    sweep,
    trial,
)
from iolspi_ros.experiments.slung_grid_demonstrations import demonstrate
from iolspi_ros.experiments.statistics import interval
from iolspi_ros.experiments.thesis import drawing
from iolspi_ros.experiments.thesis.chapter5_claims import CLAIMS
from iolspi_ros.experiments.thesis.study import Rows, Study
from iolspi_ros.methods.tabular import optimal
from sim_nodes.tasks.slung_grid import SlungGrid

Array = NDArray[np.float64]

TABLE_3 = {
    1: "tries to perform best",
    2: "tries to perform best, again",
    3: "first steers to the left, then tries to perform best",
    4: "deliberately poor",
}
TABLE_4 = {
    "set 1": (-5.15, -4.0), "set 2": (-5.45, -4.0), "set 3": (-7.37, -5.76),
    "set 4": (-25.60, -24.84), "Q-learning": (-40.75, -1.96),
}  # fmt: skip
"""T Table 5-4: average and final greedy return of 5,000 episodes."""
TABLE_5 = {
    "scattered starts": {"visits": 1_422_657, "pairs": 285_649},
    "one start": {"pairs": 69_379},
}
"""Of 100,000 episodes (T 5-4-1)."""
LABELS = ("position x [m]", "velocity [m/s]", "angle of the cable [deg]", "its rate [deg/s]")
Q0S = (0.0, -1.0, -2.0, -5.0, -10.0, -20.0, -50.0, -100.0, -200.0)
EPSILONS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)
ALPHAS = (0.0, 0.001, 0.005, 0.01, 0.05, 0.1, 0.2, 0.5, 1.0)
_AVERAGE, _RETURN = "average return", "return"
_OPTIMUM = Cell("near-optimal", best, SlungGrid(), 1, 1.0)


def studies() -> list[Study]:
    """Every study of these chapters."""
    five = {label: Trial(number, episodes=5000) for number, label in enumerate(
        list(TABLE_4)[:4], 1)} | {"Q-learning": Trial(q0=0.0, episodes=5000)}  # fmt: skip
    five |= {
        "Q-learning, 20,000 episodes": replace(five["Q-learning"], episodes=20_000),
        "Q-learning, ties in order": replace(five["Q-learning"], ordered=True),
        "Q-learning, Q_0 = -50": replace(five["Q-learning"], q0=-50.0),
    }
    two = {label: replace(setting, episodes=2000) for label, setting in five.items()
           if label.startswith("set")}  # fmt: skip
    alone_and_informed = {"Q-learning": Trial(), "set 1": two["set 1"]}
    surveyed = tuple(
        Cell(label, survey, Survey(scattered=label == "scattered starts"), 50, 0.5)
        for label in TABLE_5
    )
    return [
        Study("table5-3", "Demonstration sets, as the scripted pilot flies them",
              "5-3-1, Table 5-3, Figs. 5-2 and 5-3", _cells(two), _shown,
              claims=CLAIMS["table5-3"]),
        _running("fig5-4", "Q-learning, and from demonstrations", "5-3-3, Fig. 5-4",
                 {"Q-learning": Trial()} | two),
        Study("table5-4", "Average and final greedy return of 5,000 episodes",
              "5-3-3, Table 5-4", (*_cells(five), _OPTIMUM), _beside,
              claims=CLAIMS["table5-4"]),
        Study("fig5-5", "The best flight", "5-3-3, Figs. 5-5 and 5-6",
              _cells({"Q-learning, 20,000 episodes": five["Q-learning, 20,000 episodes"]}),
              _best_flight, claims=CLAIMS["fig5-5"]),
        Study("table5-5", "States and visits of 100,000 episodes", "5-4-1, Table 5-5", surveyed,
              _visited, claims=CLAIMS["table5-5"]),
        *(_by_dimension(f"fig5-{7 + d}", d, surveyed[:1]) for d in range(len(DIMENSIONS))),
        _running("figA-1", "ε = 0.01, α = 0.01, Q_0 = -50", "Appendix A, Fig. A-1",
                 alone_and_informed),
        _sweep("figA-2", "q0", Q0S, "Q_0", 1.0),
        _running("figA-3", "ε = 0.001, α = 0.01, Q_0 = -50", "Appendix A, Fig. A-3",
                 {k: replace(s, epsilon=0.001) for k, s in alone_and_informed.items()}),
        _sweep("figA-4", "epsilon", EPSILONS, "ε", 0.001),
        _running("figA-5", "ε = 0.01, α = 0.001, Q_0 = -50", "Appendix A, Fig. A-5",
                 {k: replace(s, alpha=0.001) for k, s in alone_and_informed.items()}),
        _sweep("figA-6", "alpha", ALPHAS, "α", 0.001),
    ]  # fmt: skip


def _cells(settings: Mapping[str, Trial]) -> tuple[Cell, ...]:
    return tuple(Cell(label, trial, s, 50, 0.1) for label, s in settings.items())


def _running(name: str, title: str, where: str, settings: Mapping[str, Trial]) -> Study:
    """Average return over all passed episodes."""
    return Study(
        name, f"{title}: {_AVERAGE}", where, (*_cells(settings), _OPTIMUM), _curves,
        drawing.curves(title, _AVERAGE, x_label="episode"), CLAIMS.get(name, ()),
    )  # fmt: skip


def _sweep(name: str, parameter: str, values: tuple[float, ...], x: str, linear: float) -> Study:
    """Average return of 2,000 episodes by a parameter."""
    cells = tuple(
        Cell(label, sweep, Sweep(Trial(number), parameter, values), 50, 0.4)
        for label, number in (("Q-learning", 0), ("set 1", 1))
    )
    title = f"Average return of 2,000 episodes by {x}"
    return Study(
        name, title, f"Appendix A, Fig. {name[3:]}", cells, _by_value,
        drawing.curves(title, _AVERAGE, x_label=x, near_zero=linear), CLAIMS.get(name, ()),
    )  # fmt: skip


def _by_dimension(name: str, d: int, cells: tuple[Cell, ...]) -> Study:
    """Mean value by one variable of the state, for each cutoff number; visits are in the rows."""
    grid, title = SlungGrid(), f"Value by {LABELS[d]}"

    def tabulate(data: Data) -> Rows:
        x = grid.low[d] + grid.spacing[d] * np.arange(float(grid.counts[d]))
        cell = data["scattered starts"]
        visits = cell[f"visits_{DIMENSIONS[d]}"].mean(axis=0)
        found: Rows = []
        for k, least in enumerate(CUTOFFS):
            rows = _lines(f"C = {least}", x, cell[f"value_{DIMENSIONS[d]}"][:, k])
            found += [{**row, "visits": v} for row, v in zip(rows, visits, strict=True)]
        return found

    return Study(
        name, title, f"5-4-2, Fig. {name[3:]}", cells, tabulate,
        drawing.curves(title, "mean value", x_label=LABELS[d]), CLAIMS[name],
    )  # fmt: skip


def _lines(label: str, x: Array, values: Array) -> Rows:
    """Rows of one curve; `values` has shape (n_seeds, n_x), entries may be missing."""
    found: Rows = []
    for at, column in zip(x, values.T, strict=True):
        known = column[np.isfinite(column)]
        mean, low, high = interval(known) if len(known) else (np.nan,) * 3
        found.append({"curve": label, "x": float(at), "mean": mean, "low": low, "high": high,
                      "n": len(values)})  # fmt: skip
    return found


def _curves(data: Data) -> Rows:
    """Average of all passed episodes, and the mean return since the point before."""
    found: Rows = []
    for label, cell in data.items():
        if label == _OPTIMUM.label:
            ends = np.array([found[0]["x"], found[-1]["x"]])
            rows = _lines(label, ends, np.repeat(cell["score"][:, None], 2, axis=1))
            found += [{**row, "since": row["mean"]} for row in rows]
        else:
            rows = _lines(label, cell["episode"][0], cell["running"])
            since = cell["score"].mean(axis=0)
            found += [{**row, "since": s} for row, s in zip(rows, since, strict=True)]
    return found


def _by_value(data: Data) -> Rows:
    return [row for label, cell in data.items()
            for row in _lines(label, cell["value"][0], cell["average"])]  # fmt: skip


def _shown(data: Data) -> Rows:
    """What the flights of a set score, and their first inputs, of the first realisation."""
    grid, found = SlungGrid(), []
    for number, words in TABLE_3.items():
        mean, low, high = interval(data[f"set {number}"]["shown"])
        inputs = [" ".join("LNR"[a] for a in flight.actions)
                  for flight in demonstrate(grid, number, 0)]  # fmt: skip
        found.append({"set": number, "description": words, "return": mean, "low": low,
                      "high": high, "inputs": " / ".join(inputs)})  # fmt: skip
    return found


def _beside(data: Data) -> Rows:
    """Ours and T's."""
    optimum = float(data[_OPTIMUM.label]["score"][0])
    found: Rows = []
    for label, cell in data.items():
        if label == _OPTIMUM.label:
            continue
        printed = TABLE_4.get(label, ("", ""))
        row: dict[str, object] = {"setting": label}
        for name, theirs in zip(("average", "greedy"), printed, strict=True):
            mean, low, high = interval(cell[name])
            row |= {name: mean, f"{name}_low": low, f"{name}_high": high, f"{name}_T": theirs}
        share = float(np.mean(cell["greedy"] > optimum - 1e-9))
        found.append(row | {"best_greedy": float(cell["greedy"].max()), "optimal_share": share})
    return found


def _best_flight(data: Data) -> Rows:
    """Every step of a flight that no other beats."""
    grid = SlungGrid()
    flight = optimal(grid.task, grid.start)
    states = grid.states(flight.states)
    return [
        {"time": 0.2 * k, **dict(zip(DIMENSIONS, state.tolist(), strict=True)),
         "input": "LNR"[flight.actions[k]] if k < len(flight.actions) else "",
         "reward": float(flight.rewards[k - 1]) if k else 0.0}
        for k, state in enumerate(states)
    ]  # fmt: skip


def _visited(data: Data) -> Rows:
    """The grid of T Table 5-5, and how much of it was seen, beside T's numbers."""
    grid = SlungGrid()
    total = grid.task.successor.size
    found: Rows = []
    for label, printed in TABLE_5.items():
        for name in ("visits", "pairs"):
            mean, low, high = interval(data[label][name])
            found.append({"starts": label, "number": name, "mean": mean, "low": low, "high": high,
                          "T": printed.get(name, ""), "share_of_pairs": mean / total,
                          "all_pairs": total})  # fmt: skip
    return found
