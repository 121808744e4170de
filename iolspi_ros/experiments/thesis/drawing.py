"""Figures from saved rows; nothing here knows how they were computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from iolspi_ros.experiments.thesis.study import Rows

_REFERENCE = "#1f2933"
_PLANE = ("angle [rad]", "rate [rad/s]")


def curves(
    title: str,
    y: str,
    low: float | None = None,
    x_label: str = "vehicle time [s]",
    near_zero: float | None = None,
) -> Callable[[Rows], Figure]:
    """A drawer of means with their 95 % bands over vehicle time, or something else.

    Parameters
    ----------
    title, y, x_label : str
    low : float, optional
        Lower end of the y axis, where a few bad values would hide the others.
    near_zero : float, optional
        Makes the x axis logarithmic, but linear up to this.
    """

    def draw(rows: Rows) -> Figure:
        figure = Figure(figsize=(7.5, 4.6), layout="constrained")
        axes = figure.add_subplot()
        names = list(dict.fromkeys(row["curve"] for row in rows))
        plain = [name.removesuffix(", refreshed").removeprefix("near-optimal, ") for name in names]
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
            style = "-" if root == name else "--" if name.endswith("refreshed") else ":"
            label = f"{name} ({mine[0]['n']})"
            axes.plot(x, mean, style, color=colour, lw=1.3, label=label)
            axes.fill_between(x, least, most, color=colour, alpha=0.15, lw=0)
        if low is not None:
            axes.set_ylim(bottom=low)
        if near_zero is not None:
            axes.set_xscale("symlog", linthresh=near_zero)
        _dress(figure, title, x_label, y)
        figure.legend(frameon=False, fontsize=8, loc="outside lower center", ncols=3)
        return figure

    return draw


def samples(title: str, by: str = "action") -> Callable[[Rows], Figure]:
    """A drawer of samples in the plane of angle and rate, by action or by set."""

    def draw(rows: Rows) -> Figure:
        figure = Figure(figsize=(7.5, 4.0), layout="constrained")
        axes = figure.add_subplot()
        for number, kind in enumerate(sorted({row[by] for row in rows})):
            mine = [row for row in rows if row[by] == kind]
            x, y = (np.array([float(row[key]) for row in mine]) for key in ("angle", "rate"))
            axes.plot(x, y, ".", ms=3, color=colormaps["tab10"](number), label=kind)
        _dress(figure, title, *_PLANE)
        axes.legend(frameon=False, fontsize=8, title=by)
        return figure

    return draw


def distributions(title: str) -> Callable[[Rows], Figure]:
    """A drawer of how angle and rate of samples are distributed, side by side."""

    def draw(rows: Rows) -> Figure:
        figure = Figure(figsize=(7.5, 3.0), layout="constrained")
        for axes, key in zip(figure.subplots(1, 2, sharey=True), ("angle", "rate"), strict=True):
            axes.hist([float(row[key]) for row in rows], bins=40, color=_REFERENCE)
        _dress(figure, title, _PLANE[0], "samples")
        figure.axes[1].set_xlabel(_PLANE[1])
        return figure

    return draw


def histories(title: str) -> Callable[[Rows], Figure]:
    """A drawer of angle and reward over the recorded episodes, one row of panels a run."""

    def draw(rows: Rows) -> Figure:
        runs = list(dict.fromkeys(row["run"] for row in rows))
        figure = Figure(figsize=(7.5, 2.2 * len(runs) + 1.4), layout="constrained")
        for axes, run in zip(figure.subplots(len(runs), 1, squeeze=False)[:, 0], runs, strict=True):
            mine = [row for row in rows if row["run"] == run]
            angle, reward = (np.array([float(r[key]) for r in mine]) for key in ("angle", "reward"))
            episode = [row["episode"] for row in mine]
            begins = [k for k in range(1, len(mine)) if episode[k] != episode[k - 1]]
            jumps = np.abs(np.diff(angle, prepend=angle[0])) > np.pi
            axes.plot(np.where(jumps, np.nan, angle), lw=1.0, color="#0b7285", label="angle [rad]")
            axes.plot(reward / 10.0, lw=0.8, color="#d9822b", label="reward / 10")
            for begin in begins:
                axes.axvline(begin, color="#adb5bd", lw=0.8)
            ticks = [0, *begins]
            axes.set_xticks(ticks, [f"{float(mine[k]['x']):g}" for k in ticks], fontsize=7)
            axes.set_ylabel(run, fontsize=8)
        _dress(figure, title, "", runs[0])
        figure.axes[0].legend(frameon=False, fontsize=8)
        figure.axes[-1].set_xlabel("vehicle time at which each episode begins [s]")
        return figure

    return draw


def _dress(figure: Figure, title: str, x: str, y: str) -> None:
    axes = figure.axes[0]
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    for each in figure.axes:
        each.spines[["top", "right"]].set_visible(False)
        each.grid(True, color="#e9ecef")
        each.set_axisbelow(True)
