"""What kind of episode would help a set of demonstrations most, in words for who flies them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.bags.survey import BOXES
from iolspi_ros.core.samples import Transitions
from iolspi_ros.task import TaskDescription

SELDOM = 0.05
"""Share of the samples under which an action is hardly there."""
GOOD, POOR = 0.9, 0.3
"""Shares of the starts: from the one the policy is good enough, up to the other hardly one."""
CHANCE = 0.05
"""Share of random actions from which the learner sees what is wrong, too."""


def hint(
    batch: Transitions, task: TaskDescription, share: float | None = None, corruption: float = 0.0
) -> str:
    """What to fly next.

    Parameters
    ----------
    batch : Transitions
        Kept so far.
    task : TaskDescription
    share : float, optional
        Of the starts from which the learner would succeed now, where that is known.
    corruption : float
        Share of the person's actions that chance takes over.
    """
    if not len(batch):
        return f"Perform: fly as well as you can; episodes count that {task.success or 'go well'}."
    if share is not None and share >= GOOD:
        return "That is enough: finish, and let the learner go on from there."
    wanting = [_actions(batch, task), _states(batch, task)]
    found = next((text for text in wanting if text), "")
    if share is not None and share <= POOR and len(batch) < 3 * task.episode_steps:
        return f"Perform: another episode as good as you can. {found}".strip()
    if found and corruption < CHANCE and share is not None and share < GOOD:
        found += " A third of random actions (the slider) shows the learner what is wrong, too."
    return found or "Perform: every place that can be named was seen; fly as well as you can."


def _actions(batch: Transitions, task: TaskDescription) -> str:
    """Which action is hardly ever taken; of one that ends the task there cannot be more."""
    known = (batch.action >= 0) & (batch.action < task.n_actions)
    counts = np.bincount(batch.action[known], minlength=task.n_actions)
    ended = np.bincount(batch.action[known & batch.terminated], minlength=task.n_actions)
    few = (counts < SELDOM * max(int(counts.sum()), 1)) & (2 * ended <= counts)
    names = [task.actions[n].name for n in np.flatnonzero(few)]
    names = [f"action {name}" if name.isdigit() else name for name in names]
    if not names:
        return ""
    return f"Explore: {', '.join(names)} {'is' if len(names) == 1 else 'are'} hardly ever taken."


def _states(batch: Transitions, task: TaskDescription) -> str:
    """Where between its limits nothing was seen, next to where something was."""
    x, y = task.map_dims
    low, high = np.array(task.low)[[x, y]], np.array(task.high)[[x, y]]
    seen = boxes(batch.state[:, [x, y]], low, high)
    if seen is None or seen.all():
        return ""
    (left, right), (bottom, top) = gap(seen, (task.periodic[x], task.periodic[y]))
    edges = [
        low[0] + (high[0] - low[0]) * np.array([left, right]) / BOXES,
        low[1] + (high[1] - low[1]) * np.array([bottom, top]) / BOXES,
    ]
    words = [
        f"{task.variables[d].axis} between {a:.2g} and {b:.2g}"
        for d, (a, b) in zip((x, y), edges, strict=True)
    ]
    return f"Explore: {' with '.join(dict.fromkeys(words))} has not been seen."


def boxes(
    states: NDArray[np.float64], low: NDArray[np.float64], high: NDArray[np.float64]
) -> NDArray[np.bool_] | None:
    """Which boxes of two variables have a state; None where the limits are not finite.

    Returns
    -------
    ndarray of bool, shape (BOXES, BOXES), or None
    """
    if not np.isfinite(high - low).all():
        return None
    places = np.floor((states - low) / (high - low) * BOXES)
    inside = np.isfinite(places).all(axis=1) & (places >= 0).all(axis=1) & (places <= BOXES).all(1)
    found = np.zeros((BOXES, BOXES), bool)
    found[tuple(np.minimum(places[inside].astype(int), BOXES - 1).T)] = True
    return found


def gap(
    seen: NDArray[np.bool_], periodic: tuple[bool, bool]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """The unseen boxes that most of what was seen surrounds: they can be reached.

    Returns
    -------
    ((left, right), (bottom, top))
        First boxes, and those behind the last; all between were not seen.
    """
    around = np.pad(seen.astype(int), 1)
    if periodic[0]:
        around[0], around[-1] = around[-2], around[1]
    if periodic[1]:
        around[:, 0], around[:, -1] = around[:, -2], around[:, 1]
    n, m = seen.shape
    neighbours = sum(around[i : i + n, j : j + m] for i in range(3) for j in range(3))
    i, j = np.unravel_index(np.where(seen, -1, neighbours).argmax(), seen.shape)
    left, right, bottom, top = int(i), int(i) + 1, int(j), int(j) + 1
    reachable = ~seen & (neighbours > 0)
    while left > 0 and reachable[left - 1, bottom:top].all():
        left -= 1
    while right < n and reachable[right, bottom:top].all():
        right += 1
    while bottom > 0 and reachable[left:right, bottom - 1].all():
        bottom -= 1
    while top < m and reachable[left:right, top].all():
        top += 1
    return (left, right), (bottom, top)
