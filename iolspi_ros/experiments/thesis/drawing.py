"""Figures from saved rows; nothing here knows how they were computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iolspi_ros import figures
from iolspi_ros.experiments.thesis.study import Rows
from iolspi_ros.figures import FAINT, REFERENCE, Look, look

_PLANE = ("angle [rad]", "rate [rad/s]")
_KINDS = ("", "refreshed", "near-optimal")
"""Of curves that go together: they have a colour and a marker in common."""


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
        figure, axes = figures.one(title, x_label, y, 3.2)
        means(axes, rows)
        if low is not None:
            axes.set_ylim(bottom=low)
        if near_zero is not None:
            axes.set_xscale("symlog", linthresh=near_zero)
            figures.dress(axes)
        figures.legend(figure)
        return figure

    return draw


def means(axes: Axes, rows: Rows) -> None:
    """Draw the mean of each curve, and the band of its 95 % interval."""
    for name, how in looks(list(dict.fromkeys(row["curve"] for row in rows))).items():
        mine = [row for row in rows if row["curve"] == name]
        x, mean, least, most = (
            np.array([float(row[key]) for row in mine]) for key in ("x", "mean", "low", "high")
        )
        if how is not REFERENCE:
            figures.band(axes, x, least, most, how)
        label = name if how is REFERENCE else f"{name} ({mine[0]['n']})"
        figures.draw(axes, x, mean, how, label)


def looks(names: list[str]) -> dict[str, Look]:
    """How each curve looks, by its name: what is of one setting goes together."""
    found, roots = dict[str, Look](), dict[str, int]()
    for name in names:
        if name == "near-optimal":
            found[name] = REFERENCE
            continue
        root = name.removesuffix(", refreshed").removeprefix("near-optimal, ")
        kind = next((k for k, word in enumerate(_KINDS) if k and word in name), 0)
        found[name] = look(roots.setdefault(root, len(roots)), kind)
    return found


def samples(title: str, by: str = "action") -> Callable[[Rows], Figure]:
    """A drawer of samples in the plane of angle and rate, by action or by set."""

    def draw(rows: Rows) -> Figure:
        figure, axes = figures.one(title, *_PLANE, 3.2)
        kinds = sorted({row[by] for row in rows})
        counts = []
        for number, kind in enumerate(kinds):
            mine = [row for row in rows if row[by] == kind]
            x, y = (np.array([float(row[key]) for row in mine]) for key in ("angle", "rate"))
            how = look(number)
            axes.plot(x, y, how.marker, ms=3, color=how.colour, alpha=0.7, mew=0, label=kind)
            counts.append(len(mine))
        angles, rates = ([float(row[key]) for row in rows] for key in ("angle", "rate"))
        figures.say(
            axes, f"{len(rows)} samples, angle {min(angles):.3g} to {max(angles):.3g} rad, rate "
            f"{min(rates):.3g} to {max(rates):.3g} rad/s; {by}: {figures.shares(kinds, counts)}",
        )  # fmt: skip
        figures.legend(figure)
        return figure

    return draw


def distributions(title: str) -> Callable[[Rows], Figure]:
    """A drawer of how angle and rate of samples are distributed, side by side."""

    def draw(rows: Rows) -> Figure:
        figure, panels = figures.panels(2.4, columns=2, sharey=True)
        for axes, key, words in zip(panels, ("angle", "rate"), _PLANE, strict=True):
            values = np.array([float(row[key]) for row in rows])
            axes.hist(values, bins=40, color=figures.ACCENT)
            first = axes is panels[0]
            figures.dress(axes, title if first else "", words, "samples" if first else "")
            figures.say(
                axes, f"{len(values)} samples, {words} {values.mean():.3g} in the mean, "
                f"{np.quantile(values, 0.05):.3g} to {np.quantile(values, 0.95):.3g} for nine "
                "in ten",
            )  # fmt: skip
        return figure

    return draw


def histories(title: str) -> Callable[[Rows], Figure]:
    """A drawer of angle and reward over the recorded episodes, one row of panels a run."""

    def draw(rows: Rows) -> Figure:
        runs = list(dict.fromkeys(row["run"] for row in rows))
        figure, panels = figures.panels(1.8 * len(runs) + 0.8, len(runs))
        for axes, run in zip(panels, runs, strict=True):
            mine = [row for row in rows if row["run"] == run]
            angle, reward = (np.array([float(r[key]) for r in mine]) for key in ("angle", "reward"))
            episode = [row["episode"] for row in mine]
            begins = [0, *(k for k in range(1, len(mine)) if episode[k] != episode[k - 1])]
            jumps = np.abs(np.diff(angle, prepend=angle[0])) > np.pi
            figures.draw(
                axes, np.arange(len(angle)), np.where(jumps, np.nan, angle),
                look(0)._replace(marker=""), "angle [rad]",
            )  # fmt: skip
            figures.draw(
                axes, np.arange(len(angle)), reward / 10.0, look(1)._replace(marker=""),
                "reward / 10",
            )  # fmt: skip
            for begin in begins[1:]:
                axes.axvline(begin, color=FAINT, lw=0.8)
            every = -(-len(begins) // 5)  # more would run into each other
            ticks = begins[::every]
            figures.dress(axes, title if run == runs[0] else "", "", run)
            axes.set_xticks(ticks, [f"{float(mine[k]['x']):.4g}" for k in ticks])
        figures.dress(panels[-1], "", "vehicle time at which each episode begins [s]")
        figures.legend(figure)
        return figure

    return draw
