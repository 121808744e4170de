"""Plots of a run. Each function draws one figure from data and knows nothing of files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap, LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from iolspi_ros import figures
from iolspi_ros.experiments.evaluate import Policy, endings
from iolspi_ros.experiments.history import EpisodeRecord
from iolspi_ros.figures import FAINT, INK, REFERENCE, look
from iolspi_ros.task import TaskDescription
from iolspi_ros.task.maps import Limits, map_states
from sim_nodes import pictures
from sim_nodes.tasks import shapes
from sim_nodes.tasks.base import Task

Array = NDArray[np.float64]

TIME = "vehicle time [s]"


def learning_score(time: Array, scores: Sequence[float]) -> Figure:
    """Sum of rewards of each episode while learning, over the vehicle time at its end."""
    figure, axes = figures.one("Learning score per episode", TIME, "sum of rewards")
    size = 2 if len(scores) > 200 else 4
    axes.plot(time, scores, "o", ms=size, color=FAINT, label="episode")
    if len(scores) >= 5:
        window = max(min(9, len(scores) // 2 * 2 - 1), len(scores) // 40 * 2 + 1)
        middle = np.convolve(scores, np.ones(window) / window, "valid")
        half = window // 2
        figures.draw(
            axes, time[half : half + len(middle)], middle, look(0)._replace(marker=""),
            f"mean of {window}",
        )  # fmt: skip
        figures.legend(figure)
    return figure


def interventions(time: Array, counts: Sequence[int]) -> Figure:
    """Times that a person took over in each episode, over the vehicle time at its end."""
    figure, axes = figures.one("Interventions per episode", TIME, "times taken over", 2.2)
    axes.plot(time, counts, "o", ms=4, color=figures.ACCENT)
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(bottom=0.0)
    first, last = np.array_split(np.asarray(counts), 2)
    figures.say(
        axes, f"{sum(counts)} in {len(counts)} episodes; {first.sum()} in the first half, "
        f"{last.sum()} in the second",
    )  # fmt: skip
    return figure


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
    """Discounted returns of intermediate policies over time, beside the near-optimal one."""
    figure, axes = figures.one("Return of each policy", TIME, "discounted return", 3.0)
    if best is not None:
        last = max((time for curve in curves for time in curve.times), default=0.0)
        figures.draw(axes, [0.0, last], [best, best], REFERENCE, "near-optimal")
    for number, curve in enumerate(curves):
        figures.draw(axes, curve.times, curve.returns, look(number), curve.label)
    if best:
        ratio = axes.secondary_yaxis(
            "right", functions=(lambda r: np.divide(r, best), lambda q: np.multiply(q, best))
        )
        ratio.tick_params(labelsize=figures.SMALL)
        ratio.set_ylabel(
            f"times near-optimal {'cost' if best < 0 else 'return'}", fontsize=figures.SMALL
        )
    figures.legend(figure)
    return figure


def successes(curves: Sequence[Curve], success: str) -> Figure:
    """Shares of the starts from which intermediate policies reached the goal."""
    figure, axes = figures.one(f"Starts that {success}", TIME, "share of the starts", 2.4)
    for number, curve in enumerate(curves):
        figures.draw(axes, curve.times, curve.successes, look(number), curve.label)
    axes.set_ylim(-0.04, 1.04)
    figures.legend(figure)
    return figure


def solve_condition(times: Sequence[float], conditions: Sequence[float]) -> Figure:
    """Condition number of each solve."""
    figure, axes = figures.one("Condition of each solve", TIME, "condition", 2.2)
    figures.draw(axes, times, conditions, look(0))
    axes.set_yscale("log")
    figures.dress(axes)
    return figure


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
    figure, panels = figures.panels(2.8, columns=len(policies), sharey=True)
    names, shades = [action.name for action in task.actions], figures.shades(task.n_actions)
    edges = BoundaryNorm(np.arange(task.n_actions + 1) - 0.5, task.n_actions)
    for axes, (title, policy) in zip(panels, policies, strict=True):
        figures.dress(axes, title, *_map_axes(task, axes is panels[0]))
        chosen = policy(states)
        axes.pcolormesh(
            x, y, chosen.reshape(points, points), cmap=ListedColormap(shades), norm=edges,
            rasterized=True,
        )  # fmt: skip
        axes.grid(False)
        figures.say(axes, figures.shares(names, np.bincount(chosen, minlength=task.n_actions)))
    patches = [
        Patch(facecolor=shade, edgecolor=INK, lw=0.5, label=name)
        for shade, name in zip(shades, names, strict=True)
    ]
    figures.legend(figure, patches)
    return figure


def _map_axes(task: TaskDescription, leftmost: bool) -> tuple[str, str]:
    x, y = (task.variables[d].axis for d in task.map_dims)
    return x, y if leftmost else ""


def visit_maps(
    task: TaskDescription, sets: Sequence[tuple[str, Array]], limits: Limits, bins: int = 60
) -> Figure:
    """Where some sets of states lie, each with its title."""
    figure, panels = figures.panels(2.8, columns=len(sets), sharey=True)
    for axes, (title, states) in zip(panels, sets, strict=True):
        words = f"{title}: {len(states)} states" if len(sets) == 1 else title
        figures.dress(axes, words, *_map_axes(task, axes is panels[0]))
        across, up = states[:, task.map_dims].T
        counts, x, y = np.histogram2d(across, up, bins=bins, range=limits)
        axes.pcolormesh(
            x, y, np.where(counts > 0, counts, np.nan).T,
            norm=LogNorm(1, max(counts.max(), 2)), cmap="viridis_r", rasterized=True,
        )  # fmt: skip
        figures.say(axes, f"{len(states)} states, in {(counts > 0).mean():.0%} of the map")
    return figure


def positions(task: TaskDescription, episodes: Sequence[Array], title: str) -> Figure:
    """First state variable of some episodes over time, a faint line each."""
    figure, axes = figures.one(title, "time in the episode [s]", task.variables[0].axis)
    ends, last = [], 0.0
    for states in episodes:
        time = task.sampling_time * np.arange(len(states))
        value = np.array(states)[:, 0]
        if task.periodic[0]:
            period = task.high[0] - task.low[0]
            jumps = np.abs(np.diff(value, prepend=value[0])) > period / 2
            value = np.where(jumps, np.nan, value)
        axes.plot(time, value, color=figures.ACCENT, alpha=0.45, lw=1.2)
        ends.append(float(np.array(states)[-1, 0]))
        last = max(last, float(time[-1]))
    figures.draw(axes, [0.0, last], [0.0, 0.0], REFERENCE)
    figures.say(
        axes, f"{len(episodes)} episodes over {last:.3g} s; at their ends "
        f"{task.variables[0].axis} is between {min(ends):.3g} and {max(ends):.3g}",
    )  # fmt: skip
    return figure


def trails(model: Task, episodes: Sequence[EpisodeRecord], title: str) -> Figure:
    """Ways in the vehicle's plane, one for each episode, among the things that stand there."""
    task = model.description
    figure, axes = figures.one(title, "x [m]", "z [m]", 2.2)
    still = [pictures.picture(model, np.array(episodes[0].states[k])) for k in (0, -1)]
    for shape, later in zip(*still, strict=True):
        if shape.kind == shapes.BOX and shape == later:  # what does not move
            (x, _, z), (wide, _, high) = shape.points[0], shape.size
            corner = (x - wide / 2, z - high / 2)
            axes.add_patch(Rectangle(corner, wide, high, color=shape.colour))
    ended = endings(task, episodes)
    shown = set()
    for episode, end in zip(episodes, ended, strict=True):
        way = pictures.trail(model, np.array(episode.states), episode.rewards[-1])
        if way is None:
            continue
        how, label = look(int(end)), None if end in shown else task.endings[end].name
        shown.add(end)
        axes.plot(
            *way.T, how.line, marker=how.marker, markevery=[len(way) - 1], ms=5,
            color=how.colour, alpha=0.5, lw=1.0, label=label,
        )  # fmt: skip
        axes.plot(*way[0], ".", color=INK, ms=2)
    axes.set_aspect("equal")
    axes.set_xlim(task.low[0] - 0.3, task.high[0] + 0.3)
    axes.set_ylim(-2.0, 0.6)
    names = [ending.name for ending in task.endings]
    counted = figures.shares(names, np.bincount(ended, minlength=len(names)))
    figures.say(axes, f"{len(episodes)} episodes: {counted}")
    figures.legend(figure)
    return figure


def ending_shares(task: TaskDescription, ends: NDArray[np.int64], window: int) -> Figure:
    """Shares of the ways in which episodes ended, over a moving window of episodes."""
    title = f"How episodes ended, mean of {window}"
    figure, axes = figures.one(title, "episode", "share of episodes", 3.0)
    for way, ending in enumerate(task.endings):
        share = np.convolve(ends == way, np.ones(window) / window, "valid")
        figures.draw(axes, np.arange(len(share)) + window, share, look(way), ending.name)
    axes.set_ylim(-0.04, 1.04)
    figures.legend(figure)
    return figure
