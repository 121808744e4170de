"""Maps of a learner's policy, from its weights."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Learner
from iolspi_ros.task.maps import Limits, map_states

Array = NDArray[np.float64]

POINTS = 41
"""Of a map, each way."""


def policy_map(learner: Learner, weights: Array, limits: Limits) -> dict[str, Any]:
    """Greedy action and its value all over a map, row by row from the lowest y.

    Parameters
    ----------
    learner : Learner
        Of the same settings as that of the weights.
    weights : ndarray
        A snapshot.
    limits : ((x, x), (y, y))
    """
    values = learner.values(map_states(learner.task, limits, POINTS), weights)
    best = values.max(axis=1)
    low, high = float(best.min()), float(best.max())
    shares = (best - low) / (high - low) if high > low else np.zeros_like(best)
    return {
        "points": POINTS, "limits": limits, "low": low, "high": high,
        "action": values.argmax(axis=1).tolist(), "value": np.round(shares, 3).tolist(),
    }  # fmt: skip
