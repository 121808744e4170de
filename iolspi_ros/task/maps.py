"""The plane of the two variables over which a task's maps are drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.task.description import TaskDescription

Array = NDArray[np.float64]
Limits = tuple[tuple[float, float], tuple[float, float]]


def map_limits(task: TaskDescription, states: Array) -> Limits:
    """Limits of the task's maps; where a variable has none, those of some states."""
    found = []
    for d in task.map_dims:
        low, high = task.low[d], task.high[d]
        seen = states[:, d] if len(states) else np.zeros(1)
        low = low if np.isfinite(low) else float(seen.min())
        high = high if np.isfinite(high) else float(seen.max())
        found.append((low, high) if low < high else (low - 1.0, low + 1.0))
    return found[0], found[1]


def map_states(task: TaskDescription, limits: Limits, points: int) -> Array:
    """States all over a map, row by row from the lowest y; the other variables are zero there.

    Returns
    -------
    ndarray of shape (points * points, n_dims)
    """
    x, y = (np.linspace(*limit, points) for limit in limits)
    states = np.zeros((points * points, task.n_dims))
    states[:, task.map_dims] = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    return states
