"""Plots of what was measured, as docs/benchmarks.md shows them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from iolspi_ros.bench.learner import DEADLINE, JUMP, SOURCES, Curves
from iolspi_ros.bench.scale import T_SECONDS, Grown, exponent, series
from iolspi_ros.report.plots import ACCENT, FAINT, INK, REFERENCE

_COLOURS = {"literal": FAINT, "refreshed": ACCENT}


def learning(found: Mapping[tuple[str, str], Curves], folder: Path) -> None:
    """Cost over near-optimal by source, median and range of the seeds: learning.png."""
    figure = Figure(figsize=(11.0, 6.0), layout="constrained")
    panels = figure.subplots(2, 4, sharey=True).ravel()
    for axes, title in zip(panels, (*SOURCES, JUMP), strict=True):
        for algorithm, colour in _COLOURS.items():
            curves = found[title, algorithm]
            time, ratio = curves.time, curves.ratio
            axes.fill_between(time, ratio.min(axis=0), ratio.max(axis=0), color=colour, alpha=0.25)
            axes.plot(time, np.median(ratio, axis=0), color=colour, label=algorithm)
        axes.axhline(1.0, color=REFERENCE, lw=1.0)
        if title in DEADLINE:
            axes.axvline(DEADLINE[title], color=INK, lw=0.5, ls=":")
        axes.set_title(title, loc="left", fontsize=10)
        axes.set_ylim(0.99, 1.15)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].legend(frameon=False)
    figure.supxlabel("vehicle time [s]")
    figure.supylabel("discounted cost over near-optimal (median, and range of all seeds)")
    figure.savefig(folder / "learning.png", dpi=110)


def scaling(found: list[Grown], folder: Path) -> None:
    """Time against the numbers of functions and of samples: scaling.png."""
    figure = Figure(figsize=(9.0, 4.0), layout="constrained")
    panels = figure.subplots(1, 2)
    panels[0].loglog(*zip(*T_SECONDS.items(), strict=True), "s--", color=INK, label="T Table 3")
    for axes, over in zip(panels, ("functions", "samples"), strict=True):
        for algorithm, colour in _COLOURS.items():
            x, y = series(found, algorithm, over)
            label = f"{algorithm}: {over} to the {exponent(x, y):.2f}"
            axes.loglog(x, y, "o-", color=colour, label=label)
        axes.set_xlabel(over)
        axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("time [s]")
    panels[0].set_title("1,000 episodes", loc="left", fontsize=10)
    panels[1].set_title("324 functions", loc="left", fontsize=10)
    figure.savefig(folder / "scaling.png", dpi=110)
