"""How far the samples of a set spread over states and actions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from iolspi_ros.core.samples import Transitions
from iolspi_ros.experiments.samplesets import MODES, demonstrate, samples
from sim_nodes.tasks.pendulum import Pendulum

_BOXES = 22  # each way: half a spacing of T's centres
_HANGING: Any = Pendulum()


@dataclass(frozen=True)
class Spread:
    """One kind of sample set.

    Attributes
    ----------
    source : str
        "set 1" to "set 5", flown by the scripted pilot with another seed each time (seed 0 gives
        the shipped one), or a random one of `samplesets.SOURCES`.
    """

    source: str


def spread(setting: Spread, seed: int) -> Mapping[str, Any]:
    """One set, and measures of its spread.

    Returns
    -------
    state : ndarray of shape (n_samples, 2)
    action : ndarray of int, shape (n_samples,)
    visited : float
        Share of the boxes of half a spacing each way, for each action, with a sample in it.
    above : float
        Share of the samples in the upper half, |angle| < 90°.
    streak : float
        Mean length of a run of equal actions.
    n : int
        Number of samples.
    """
    taken = _taken(setting.source, seed)
    task, angle = _HANGING, taken.state[:, 0]
    low, high = np.array(task.description.low), np.array(task.description.high)
    box = np.clip((taken.state - low) / (high - low) * _BOXES, 0, _BOXES - 1).astype(int)
    key = (taken.action * _BOXES + box[:, 0]) * _BOXES + box[:, 1]
    changes = np.count_nonzero(np.diff(taken.action)) + 1
    return {
        "state": taken.state,
        "action": taken.action,
        "visited": len(np.unique(key)) / (task.description.n_actions * _BOXES**2),
        "above": float(np.mean(np.abs(angle) < np.pi / 2)),
        "streak": len(taken) / changes,
        "n": len(taken),
    }


def _taken(source: str, seed: int) -> Transitions:
    if source.startswith("set "):
        number = int(source[4:])
        return demonstrate(_HANGING, *MODES[number], number + 1000 * seed)
    found = samples(source, _HANGING, seed)
    assert found is not None
    return found
