"""Plots of a run. Each function draws one figure from data and knows nothing of files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iolspi_ros.experiments.evaluate import Policy
from sim_nodes.tasks.base import Task

Array = NDArray[np.float64]

INK, ACCENT, REFERENCE, FAINT = "#1f2933", "#0b7285", "#c92a2a", "#adb5bd"
_ACTION_COLOURS = ("#3b6fb6", "#e9ecef", "#d9822b", "#5f3dc4", "#2b8a3e")


def _axes(title: str, x: str, y: str, size: tuple[float, float] = (8.0, 3.6)) -> Axes:
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.add_subplot()
    _label(axes, title, x, y)
    return axes


def _label(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(title, loc="left", fontsize=11, color=INK)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color="#e9ecef")
    axes.set_axisbelow(True)


def _figure(axes: Axes) -> Figure:
    figure = axes.get_figure()
    assert isinstance(figure, Figure)
    return figure


def learning_score(scores: Sequence[float], episode_time: float) -> Figure:
    """Sum of rewards of each episode while learning, over vehicle time."""
    axes = _axes("Learning score per episode", "vehicle time [s]", "sum of rewards")
    time = episode_time * np.arange(1, len(scores) + 1)
    axes.plot(time, scores, ".", color=FAINT, label="episode")
    if len(scores) >= 5:
        window = min(9, len(scores) // 2 * 2 - 1)
        middle = np.convolve(scores, np.ones(window) / window, "valid")
        half = window // 2
        axes.plot(time[half : half + len(middle)], middle, color=ACCENT, label=f"mean of {window}")
        axes.legend(frameon=False)
    return _figure(axes)


def discounted_return(
    curves: Sequence[tuple[str, Sequence[float], Sequence[float]]], best: float
) -> Figure:
    """Discounted returns of intermediate policies over time, beside the near-optimal one.

    Parameters
    ----------
    curves : sequence of (label, times, returns)
        The first stands out.
    best : float
    """
    axes = _axes(
        "Discounted return of the intermediate policies", "vehicle time [s]", "discounted return"
    )
    axes.axhline(best, color=REFERENCE, lw=1.5, label="near-optimal (dynamic programming)")
    for number, (label, times, returns) in reversed(list(enumerate(curves))):
        axes.plot(times, returns, "o-", ms=3, color=FAINT if number else ACCENT, label=label)
    axes.legend(frameon=False, loc="lower right")
    ratio = axes.secondary_yaxis(
        "right", functions=(lambda r: np.divide(r, best), lambda q: np.multiply(q, best))
    )
    ratio.set_ylabel("ratio to near-optimal cost")
    return _figure(axes)


def solve_condition(times: Sequence[float], conditions: Sequence[float]) -> Figure:
    """Condition number of each solve."""
    axes = _axes("Condition of each solve", "vehicle time [s]", "condition", (8.0, 2.4))
    axes.semilogy(times, conditions, "o-", ms=3, color=INK)
    return _figure(axes)


def policy_maps(task: Task, learned: Policy, best: Policy, points: int = 181) -> Figure:
    """Greedy action over the first two state variables, learned and near-optimal."""
    x, y = (np.linspace(task.low[d], task.high[d], points) for d in (0, 1))
    states = np.zeros((points * points, len(task.low)))
    states[:, :2] = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    colours = ListedColormap(_ACTION_COLOURS[: len(task.actions)])
    edges = BoundaryNorm(np.arange(len(task.actions) + 1) - 0.5, len(task.actions))
    panels = figure.subplots(1, 2, sharey=True)
    for axes, policy, title in zip(
        panels, (learned, best), ("Learned policy", "Near-optimal policy"), strict=True
    ):
        _label(axes, title, "position [rad]", "velocity [rad/s]" if axes is panels[0] else "")
        chosen = policy(states).reshape(points, points)
        image = axes.pcolormesh(x, y, chosen, cmap=colours, norm=edges, rasterized=True)
        axes.grid(False)
    bar = figure.colorbar(image, ax=panels, ticks=range(len(task.actions)), shrink=0.8)
    bar.set_ticklabels(
        [
            f"{value:+g} {task.action_unit}" if value else f"0 {task.action_unit}"
            for value in task.actions
        ]
    )
    return figure


def visit_maps(task: Task, demonstrated: Array, online: Array, bins: int = 60) -> Figure:
    """Where the demonstrated and the online samples lie."""
    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    limits = [[task.low[d], task.high[d]] for d in (0, 1)]
    for axes, states, title in zip(
        panels, (demonstrated, online), ("Demonstrated", "Online"), strict=True
    ):
        _label(
            axes,
            f"{title}: {len(states)} states",
            "position [rad]",
            "velocity [rad/s]" if axes is panels[0] else "",
        )
        counts, x, y = np.histogram2d(states[:, 0], states[:, 1], bins=bins, range=limits)
        axes.pcolormesh(
            x, y, np.where(counts > 0, counts, np.nan).T,
            norm=LogNorm(1, max(counts.max(), 2)), cmap="viridis", rasterized=True,
        )  # fmt: skip
    return figure


def positions(task: Task, episodes: Sequence[Array], title: str) -> Figure:
    """First state variable of some episodes over time, a faint line each."""
    axes = _axes(title, "time in the episode [s]", "position [rad]")
    for states in episodes:
        time = task.dt * np.arange(len(states))
        value = np.array(states)[:, 0]
        if task.periodic[0]:
            jumps = np.abs(np.diff(value, prepend=value[0])) > np.pi
            value = np.where(jumps, np.nan, value)
        axes.plot(time, value, color=ACCENT, alpha=0.45, lw=1.2)
    axes.axhline(0.0, color=REFERENCE, lw=1)
    return _figure(axes)
