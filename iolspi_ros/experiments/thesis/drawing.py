"""Figures from saved rows; nothing here knows how they were computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from iolspi_ros.experiments.thesis.study import Rows

_REFERENCE = "#c92a2a"


def curves(title: str, y: str, low: float | None = None) -> Callable[[Rows], Figure]:
    """A drawer of means with their 95 % bands over vehicle time.

    Parameters
    ----------
    title, y : str
    low : float, optional
        Lower end of the y axis, where a few bad values would hide the others.
    """

    def draw(rows: Rows) -> Figure:
        figure = Figure(figsize=(7.5, 4.0), layout="constrained")
        axes = figure.add_subplot()
        names = list(dict.fromkeys(row["curve"] for row in rows))
        plain = [name.removesuffix(", refreshed") for name in names]
        base = {name: k for k, name in enumerate(dict.fromkeys(plain))}
        for name, root in zip(names, plain, strict=True):
            mine = [row for row in rows if row["curve"] == name]
            x, mean, least, most = (
                np.array([float(row[key]) for row in mine]) for key in ("x", "mean", "low", "high")
            )
            if name == "near-optimal":
                axes.plot(x, mean, color=_REFERENCE, lw=1.0, label=name)
                continue
            colour = colormaps["tab10"](base[root] % 10)
            style = "-" if root == name else "--"
            label = f"{name} ({mine[0]['n']})"
            axes.plot(x, mean, style, color=colour, lw=1.3, label=label)
            axes.fill_between(x, least, most, color=colour, alpha=0.15, lw=0)
        if low is not None:
            axes.set_ylim(bottom=low)
        _dress(figure, title, "vehicle time [s]", y)
        axes.legend(frameon=False, fontsize=8, loc="lower right", ncols=2)
        return figure

    return draw


def _dress(figure: Figure, title: str, x: str, y: str) -> None:
    axes = figure.axes[0]
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#e9ecef")
    axes.set_axisbelow(True)
