"""Pictures of learners beside each other, from rows that were kept."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iolspi_ros import figures
from iolspi_ros.experiments.thesis.study import Rows
from iolspi_ros.report.measures import title_of

Array = NDArray[np.float64]

SHADED = 4
"""Learners at most whose intervals are drawn; of more only the means can be told apart."""
LEAST = 0.01
"""Processor seconds that are told apart."""
PICTURES = ("returned", "processor", "success", "crashes")


def picture(curves: Rows, task: str, kind: str) -> Figure | None:
    """One kind of curves of a task, a panel for each case; None where all are zero."""
    rows = [row for row in curves if row["task"] == task]
    cases = list(dict.fromkeys(row["case"] for row in rows))
    learners = list(dict.fromkeys(row["learner"] for row in rows))
    y = {"processor": "returned"}.get(kind, kind)
    if kind == "crashes" and not any(float(row[y]) for row in rows):
        return None
    figure, panels = figures.panels(2.9 * len(cases), len(cases))
    for axes, case in zip(panels, cases, strict=True):
        here = [row for row in rows if row["case"] == case]
        for number, learner in enumerate(learners):
            own = [row for row in here if row["learner"] == learner]
            if not own:
                continue
            x = _column(own, "time")
            if kind == "processor":
                x = np.maximum(_column(own, "processor"), LEAST)
            how = figures.look(number)
            if f"{y}_low" in own[0] and kind != "processor" and len(learners) <= SHADED:
                figures.band(axes, x, _column(own, f"{y}_low"), _column(own, f"{y}_high"), how)
            figures.draw(axes, x, _column(own, y), how, title_of(learner))
        best = _column(here[: sum(row["learner"] == here[0]["learner"] for row in here)], "best")
        if y == "returned":
            if kind == "returned" and np.isfinite(best).all():
                when = _column(here[: len(best)], "time")
                figures.draw(axes, when, best, figures.REFERENCE, "near-optimal")
            _limit(axes, _column(here, y), best)
        if kind == "processor":
            axes.set_xscale("log")
        if y == "success":
            axes.set_ylim(-0.03, 1.03)
        words = "processor time of the learner [s]" if kind == "processor" else "vehicle time [s]"
        figures.dress(axes, case, words, _SCALES[y])
    figures.legend(figure)
    return figure


_SCALES = {"returned": "discounted return, greedy", "success": "share of starts that succeed",
           "crashes": "crashes while learning"}  # fmt: skip


def _limit(axes: Any, values: Array, best: Array) -> None:
    """Leave out what is far below everything else, so that the others can be told apart."""
    values = values[np.isfinite(values)]
    low, top = float(np.quantile(values, 0.1)), float(values.max())
    top = max(top, float(np.nanmax(best, initial=-np.inf)))
    axes.set_ylim(low - 0.05 * (top - low), top + 0.08 * (top - low))


def _column(rows: Rows, name: str) -> Array:
    return np.array([float(row[name]) for row in rows])
