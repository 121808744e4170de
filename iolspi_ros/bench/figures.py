"""Plots of what was measured, as docs/benchmarks.md shows them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from iolspi_ros import figures
from iolspi_ros.bench.learner import DEADLINE, JUMP, SOURCES, Curves
from iolspi_ros.bench.scale import T_SECONDS, Grown, exponent, series
from iolspi_ros.figures import REFERENCE, look

_LOOKS = {"literal": look(1), "refreshed": look(0)}


def learning(found: Mapping[tuple[str, str], Curves]) -> Figure:
    """Cost over near-optimal by source, median and range of the seeds."""
    figure, panels = figures.panels(9.0, 4, 2, sharey=True, sharex=True)
    for axes, title in zip(panels, (*SOURCES, JUMP), strict=True):
        figures.dress(axes, title)
        for algorithm, how in _LOOKS.items():
            curves = found[title, algorithm]
            time, ratio = curves.time, curves.ratio
            figures.band(axes, time, ratio.min(axis=0), ratio.max(axis=0), how)
            figures.draw(axes, time, np.median(ratio, axis=0), how, algorithm)
        figures.draw(axes, time[[0, -1]], [1.0, 1.0], REFERENCE, "near-optimal")
        if title in DEADLINE:
            axes.axvline(DEADLINE[title], color=figures.FAINT, lw=0.8, ls=":")
        axes.set_ylim(0.99, 1.15)
    figure.supxlabel("vehicle time [s]", fontsize=figures.SMALL)
    figure.supylabel(
        "cost over near-optimal: median, and range of all seeds", fontsize=figures.SMALL
    )
    figures.legend(figure)
    return figure


def scaling(found: list[Grown]) -> Figure:
    """Time against the numbers of functions and of samples."""
    figure, panels = figures.panels(5.6, 2)
    numbers, seconds = zip(*T_SECONDS.items(), strict=True)
    figures.draw(panels[0], numbers, seconds, REFERENCE, "T Table 3")
    titles = ("1,000 episodes", "324 functions")
    for axes, over, title in zip(panels, ("functions", "samples"), titles, strict=True):
        grown = []
        for algorithm, how in _LOOKS.items():
            x, y = series(found, algorithm, over)
            grown.append(f"{algorithm} {exponent(x, y):.2f}")
            figures.draw(axes, x, y, how, algorithm)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())  # they would overlap
        figures.dress(axes, f"{title}: to the power {', '.join(grown)}", over, "time [s]")
    figures.legend(figure)
    return figure


def write(folder: Path, name: str, figure: Figure) -> None:
    """Put a figure into a folder, and what it shows beside it, in words."""
    (folder / f"{name}.png").write_bytes(figures.png(figure))
    (folder / f"{name}.txt").write_text(figures.alt(figure) + "\n", encoding="utf-8")
