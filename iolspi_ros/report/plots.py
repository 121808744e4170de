"""Plots of a run. Each function draws one figure from data and knows nothing of files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm, hsv_to_rgb, to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from iolspi_ros.experiments.evaluate import Policy, endings
from iolspi_ros.experiments.history import EpisodeRecord
from iolspi_ros.task import TaskDescription
from iolspi_ros.task.maps import Limits, map_states
from sim_nodes import pictures
from sim_nodes.tasks import shapes
from sim_nodes.tasks.base import Task

Array = NDArray[np.float64]

INK, ACCENT, REFERENCE, FAINT = "#1f2933", "#0b7285", "#c92a2a", "#adb5bd"
_ENDING_COLOURS = ("#adb5bd", "#0b7285", "#e8590c", "#c92a2a", "#862e9c")
_ACTION_COLOURS = ("#3b6fb6", "#e9ecef", "#d9822b", "#5f3dc4", "#2b8a3e")
_STYLES = ("-", "--", "-.", ":")


def _colours(few: Sequence[str], count: int) -> list[str]:
    """So many colours that can be told apart: the few, or else one round of the circle of hues.

    Neighbours of many hues differ in lightness, too.
    """
    if count <= len(few):
        return list(few[:count])
    hues = np.linspace(0.0, 1.0, count, endpoint=False)
    light = np.resize([0.95, 0.6, 0.8], count)
    return [to_hex(colour) for colour in hsv_to_rgb(np.stack([hues, 0.8 + 0 * hues, light], 1))]


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


def learning_score(time: Array, scores: Sequence[float]) -> Figure:
    """Sum of rewards of each episode while learning, over the vehicle time at its end."""
    axes = _axes("Learning score per episode", "vehicle time [s]", "sum of rewards")
    axes.plot(time, scores, ".", ms=3 if len(scores) > 200 else 6, color=FAINT, label="episode")
    if len(scores) >= 5:
        window = max(min(9, len(scores) // 2 * 2 - 1), len(scores) // 40 * 2 + 1)
        middle = np.convolve(scores, np.ones(window) / window, "valid")
        half = window // 2
        axes.plot(time[half : half + len(middle)], middle, color=ACCENT, label=f"mean of {window}")
        axes.legend(frameon=False)
    return _figure(axes)


def interventions(time: Array, counts: Sequence[int]) -> Figure:
    """Times that a person took over in each episode, over the vehicle time at its end."""
    axes = _axes("Interventions per episode", "vehicle time [s]", "times taken over", (8.0, 2.8))
    axes.plot(time, counts, "o", ms=4, color=ACCENT)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0.0)
    return _figure(axes)


class Curve(NamedTuple):
    """The policies of a run, each flown from every start.

    Attributes
    ----------
    label : str
    times : list of float
        At which each came into use [s].
    returns : list of float
        Their mean discounted returns.
    successes : list of float
        Shares of the starts from which they reached the goal.
    """

    label: str
    times: list[float]
    returns: list[float]
    successes: list[float]


def discounted_return(curves: Sequence[Curve], best: float | None) -> Figure:
    """Discounted returns of intermediate policies over time, beside the near-optimal one.

    The first curve stands out.
    """
    axes = _axes(
        "Discounted return of the intermediate policies", "vehicle time [s]", "discounted return"
    )
    if best is not None:
        axes.axhline(best, color=REFERENCE, lw=1.5, label="near-optimal (dynamic programming)")
    _draw(axes, [(curve.label, curve.times, curve.returns) for curve in curves])
    axes.legend(frameon=False, loc="lower right")
    if best:
        ratio = axes.secondary_yaxis(
            "right", functions=(lambda r: np.divide(r, best), lambda q: np.multiply(q, best))
        )
        ratio.set_ylabel(f"ratio to near-optimal {'cost' if best < 0 else 'return'}")
    return _figure(axes)


def successes(curves: Sequence[Curve], success: str) -> Figure:
    """Shares of the starts from which intermediate policies reached the goal."""
    axes = _axes(f"Starts that {success}", "vehicle time [s]", "share of the starts", (8.0, 2.8))
    _draw(axes, [(curve.label, curve.times, curve.successes) for curve in curves])
    axes.set_ylim(-0.02, 1.02)
    return _figure(axes)


def _draw(axes: Axes, lines: Sequence[tuple[str, list[float], list[float]]]) -> None:
    for number, (label, x, y) in reversed(list(enumerate(lines))):
        axes.plot(x, y, "o-", ms=3, color=FAINT if number else ACCENT, label=label)


def solve_condition(times: Sequence[float], conditions: Sequence[float]) -> Figure:
    """Condition number of each solve."""
    axes = _axes("Condition of each solve", "vehicle time [s]", "condition", (8.0, 2.4))
    axes.semilogy(times, conditions, "o-", ms=3, color=INK)
    return _figure(axes)


def policy_maps(
    task: TaskDescription, policies: Sequence[tuple[str, Policy]], limits: Limits, points: int = 181
) -> Figure:
    """Greedy actions over the two variables of the task's maps, of one policy or several.

    Parameters
    ----------
    task : TaskDescription
    policies : sequence of (str, callable)
        Each with its title.
    limits : ((x, x), (y, y))
        Of the map; the other variables are zero there.
    points : int
        Each way.
    """
    x, y = (np.linspace(*limit, points) for limit in limits)
    states = map_states(task, limits, points)
    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    colours = ListedColormap(_colours(_ACTION_COLOURS, task.n_actions))
    edges = BoundaryNorm(np.arange(task.n_actions + 1) - 0.5, task.n_actions)
    panels = figure.subplots(1, len(policies), sharey=True, squeeze=False)[0]
    for axes, (title, policy) in zip(panels, policies, strict=True):
        _label(axes, title, *_map_axes(task, axes is panels[0]))
        chosen = policy(states).reshape(points, points)
        image = axes.pcolormesh(x, y, chosen, cmap=colours, norm=edges, rasterized=True)
        axes.grid(False)
    bar = figure.colorbar(image, ax=panels, ticks=range(task.n_actions), shrink=0.8)
    bar.set_ticklabels([action.name for action in task.actions])
    return figure


def _map_axes(task: TaskDescription, leftmost: bool) -> tuple[str, str]:
    x, y = (task.variables[d].axis for d in task.map_dims)
    return x, y if leftmost else ""


def visit_maps(
    task: TaskDescription, demonstrated: Array, online: Array, limits: Limits, bins: int = 60
) -> Figure:
    """Where the demonstrated and the online samples lie."""
    figure = Figure(figsize=(8.0, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, states, title in zip(
        panels, (demonstrated, online), ("Demonstrated", "Online"), strict=True
    ):
        labels = _map_axes(task, axes is panels[0])
        _label(axes, f"{title}: {len(states)} states", *labels)
        across, up = states[:, task.map_dims].T
        counts, x, y = np.histogram2d(across, up, bins=bins, range=limits)
        axes.pcolormesh(
            x, y, np.where(counts > 0, counts, np.nan).T,
            norm=LogNorm(1, max(counts.max(), 2)), cmap="viridis", rasterized=True,
        )  # fmt: skip
    return figure


def positions(task: TaskDescription, episodes: Sequence[Array], title: str) -> Figure:
    """First state variable of some episodes over time, a faint line each."""
    axes = _axes(title, "time in the episode [s]", task.variables[0].axis)
    for states in episodes:
        time = task.sampling_time * np.arange(len(states))
        value = np.array(states)[:, 0]
        if task.periodic[0]:
            period = task.high[0] - task.low[0]
            jumps = np.abs(np.diff(value, prepend=value[0])) > period / 2
            value = np.where(jumps, np.nan, value)
        axes.plot(time, value, color=ACCENT, alpha=0.45, lw=1.2)
    axes.axhline(0.0, color=REFERENCE, lw=1)
    return _figure(axes)


def trails(model: Task, episodes: Sequence[EpisodeRecord], title: str) -> Figure:
    """Ways in the vehicle's plane, one for each episode, among the things that stand there."""
    task = model.description
    axes = _axes(title, "x [m]", "z [m], upwards", (8.0, 2.8))
    still = [pictures.picture(model, np.array(episodes[0].states[k])) for k in (0, -1)]
    for shape, later in zip(*still, strict=True):
        if shape.kind == shapes.BOX and shape == later:  # what does not move
            (x, _, z), (wide, _, high) = shape.points[0], shape.size
            corner = (x - wide / 2, z - high / 2)
            axes.add_patch(Rectangle(corner, wide, high, color=shape.colour))
    colours = _colours(_ENDING_COLOURS, len(task.endings))
    shown = set()
    for episode, end in zip(episodes, endings(task, episodes), strict=True):
        way = pictures.trail(model, np.array(episode.states), episode.rewards[-1])
        if way is None:
            continue
        label = None if end in shown else task.endings[end].name
        shown.add(end)
        axes.plot(*way.T, color=colours[end], alpha=0.35, lw=1.0, label=label)
        axes.plot(*way[0], ".", color=INK, ms=2)
    axes.set_aspect("equal")
    axes.set_xlim(task.low[0] - 0.3, task.high[0] + 0.3)
    axes.set_ylim(-2.0, 0.6)
    axes.legend(frameon=False, loc="lower left", bbox_to_anchor=(0.4, 1.0), ncols=5, fontsize=8)
    return _figure(axes)


def ending_shares(task: TaskDescription, ends: NDArray[np.int64], window: int) -> Figure:
    """Shares of the ways in which episodes ended, over a moving window of episodes."""
    axes = _axes(
        f"How episodes ended while learning, mean of {window}", "episode", "share of episodes"
    )
    colours = _colours(_ENDING_COLOURS, len(task.endings))
    for way, ending in enumerate(task.endings):
        share = np.convolve(ends == way, np.ones(window) / window, "valid")
        axes.plot(
            np.arange(len(share)) + window, share, _STYLES[way % len(_STYLES)],
            color=colours[way], label=ending.name,
        )  # fmt: skip
    axes.set_ylim(-0.02, 1.02)
    axes.legend(frameon=False, ncols=min(len(task.endings), 5), fontsize=8)
    return _figure(axes)
