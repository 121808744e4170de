"""Pictures of whole episodes, for the animation of a report and RViz; some tasks have none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import Task
from sim_nodes.tasks.shapes import FALL_TIME, Picture

Array = NDArray[np.float64]


def picture(task: Task | None, state: Array) -> Picture:
    """What a state, shape (n_dims,), looks like; always the same shapes in the same order."""
    draw = getattr(task, "picture", None)
    return draw(state) if draw else ()


def released(task: Task, before: Array, reward: float, times: Array) -> Array:
    """Where something is that was released in an episode's last step.

    Parameters
    ----------
    task : Task
    before : ndarray of shape (n_dims,)
        The state that the step left.
    reward : float
        Of the step.
    times : ndarray of shape (n,)
        Since then [s].

    Returns
    -------
    ndarray of shape (n, 3)
        x, y and z [m]; of shape (0, 3) when nothing was released.
    """
    follow = getattr(task, "released", None)
    return follow(before, reward, times) if follow else np.empty((0, 3))


def film(task: Task, states: Sequence[Array], reward: float) -> list[Picture]:
    """A picture for each state of an episode, and of what falls after it, T_s apart.

    Parameters
    ----------
    task : Task
    states : sequence of ndarray of shape (n_dims,)
        At least two.
    reward : float
        Of the last step.
    """
    dt = task.description.sampling_time
    falling = released(task, states[-2], reward, dt * np.arange(1.0, round(FALL_TIME / dt)))
    if not len(falling):
        return [picture(task, state) for state in states]
    with_released: Any = task
    pictures = [picture(task, state) for state in states[:-1]]
    return pictures + [with_released.picture(states[-2], at) for at in map(tuple, falling.tolist())]


def trail(task: Task | None, states: Array, reward: float) -> Array | None:
    """The way in the plane that tells how an episode went; None when its variables do.

    Parameters
    ----------
    task : Task
    states : ndarray of shape (n_states, n_dims)
        At least two.
    reward : float
        Of the last step.

    Returns
    -------
    ndarray of shape (n, 2), or None
        x and z [m].
    """
    follow = getattr(task, "trail", None)
    return follow(states, reward) if follow else None
