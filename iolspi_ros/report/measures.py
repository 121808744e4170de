"""What learners have come to beside each other: T's three metrics (T 4-4), as rows to keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.compare import CRASHES, JUMP_CASE, Case
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.statistics import Interval, interval, intervals
from iolspi_ros.experiments.thesis.study import Rows
from iolspi_ros.methods.traits import TRAITS

Array = NDArray[np.float64]

NEAR = 0.02
"""How far from the near-optimal return, relative to it, is near."""
MOST = 0.98
"""Share of starts that succeed, which is near where the near-optimal return is 0."""
DUNKS = 0.8
IN_A_ROW = 2
"""Looks that must find a policy near, so that it is not by chance."""

COUNTS = ("seeds", "reached", "safe")
MEASURES = ("time", "final", "success", "score", "crashes", "crashes_until", "processor")
"""Time to learn [s]; final return; share of successes; rewards a second while learning; crashes
in all, and until `DUNKS` of the starts succeed; processor seconds."""


def first_near(near: NDArray[np.bool_]) -> int | None:
    """The first of so many looks in a row."""
    for k in range(len(near) - IN_A_ROW + 1):
        if near[k : k + IN_A_ROW].all():
            return k
    return None


def _near(returns: Array, success: Array, best: Array) -> NDArray[np.bool_]:
    """Which looks find a policy near the best."""
    close = np.abs(returns - best) <= NEAR * np.abs(best)
    found: NDArray[np.bool_] = np.where(best == 0.0, success >= MOST, close)
    return found


def measured(case: Case, store: Store) -> tuple[Rows, Rows]:
    """What a case has come to, and its curves over time.

    Returns
    -------
    table : list of dict
        A row for each learner; empty texts where it cannot be in this case. Of a measure its mean
        and the limits of the 95 % interval; of the time, over those realisations that got there.
    curves : list of dict
        A row for each learner and look.
    """
    table: Rows = []
    curves: Rows = []
    for learner, cell in case.cells.items():
        about = {"task": case.task.name, "case": case.name, "learner": learner}
        if cell is None:
            empty = dict.fromkeys([*COUNTS, *(n for m in MEASURES for n in names_of(m))], "")
            table.append(about | empty)
            continue
        runs = [store.read(cell, seed) for seed in range(cell.seeds)]
        whole = [run for run in runs if run is not None]
        time = whole[0]["time"]
        best = _best(case, store, time)
        found: dict[str, list[float]] = {name: [] for name in MEASURES}
        for run in whole:
            for name, value in _measures(case, run, best).items():
                found[name].append(value)
        reached = [value for value in found["time"] if np.isfinite(value)]
        row = about | {"seeds": len(whole), "reached": len(reached)}
        row["safe"] = sum(first_near(run["success"] >= DUNKS) is not None for run in whole)
        for name in MEASURES:
            values = np.array(reached if name == "time" else found[name])
            spread = interval(values) if len(values) else Interval(*[np.nan] * 3)
            row |= dict(zip(names_of(name), spread, strict=True))
        table.append(row)
        curves += _curves(about, case, whole, best)
    return table, curves


def names_of(measure: str) -> tuple[str, str, str]:
    """Of a measure's mean, and of the limits of its interval."""
    return measure, f"{measure}_low", f"{measure}_high"


def _best(case: Case, store: Store, time: Array) -> Array:
    """Near-optimal return at each time; NaN where nobody knows."""
    if case.best is None:
        return np.full(len(time), np.nan)
    kept = store.read(case.best, 0)
    assert kept is not None
    before, after = kept["discounted"]
    return np.where(time < case.jump, before, after) if np.isfinite(case.jump) else (
        np.full(len(time), before))  # fmt: skip


def _measures(case: Case, run: Mapping[str, Any], best: Array) -> dict[str, float]:
    time, success = run["time"], run["success"]
    begin = int(np.searchsorted(time, case.jump)) if case.name == JUMP_CASE else 0
    at = first_near(_near(run["discounted"], success, best)[begin:])
    crashes = _crashes(case, run["endings"])
    safe = first_near(success >= DUNKS)
    span = float(time[-1])
    return {
        "time": np.nan if at is None else float(time[begin + at] - time[begin]),
        "final": float(run["discounted"][-3:].mean()), "success": float(success[-3:].mean()),
        "score": float(run["rewards"][-1]) / span, "crashes": float(crashes[-1]),
        "crashes_until": float(crashes[-1 if safe is None else safe]),
        "processor": float(run["processor"][-1]),
    }  # fmt: skip


def _crashes(case: Case, endings: NDArray[np.int64]) -> NDArray[np.int64]:
    """Episodes that broke something so far."""
    which = [ending.name.startswith(CRASHES) for ending in case.task.endings]
    found: NDArray[np.int64] = endings[:, which].sum(axis=1)
    return found


def _curves(about: dict[str, str], case: Case, runs: Sequence[Any], best: Array) -> Rows:
    returns = intervals(np.stack([run["discounted"] for run in runs]))
    success = intervals(np.stack([run["success"] for run in runs]))
    crashes = np.mean([_crashes(case, run["endings"]) for run in runs], axis=0)
    processor = np.mean([run["processor"] for run in runs], axis=0)
    columns = {
        "time": runs[0]["time"], "processor": processor, "best": best, "crashes": crashes,
        **dict(zip(names_of("returned"), returns, strict=True)),
        **dict(zip(names_of("success"), success, strict=True)),
    }  # fmt: skip
    return [
        about | {name: float(column[k]) for name, column in columns.items()}
        for k in range(len(runs[0]["time"]))
    ]


def title_of(learner: str) -> str:
    """What a learner is called among people."""
    return TRAITS[learner].title if learner in TRAITS else learner
