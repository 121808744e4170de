"""Samples that cannot be true, told from the others: they are kept aside, not learned from.

One reward of -1e9, or one state in degrees, would spoil every weight. A number is not believed
while it is far beyond all the others and hardly ever seen; what is real comes again, at the same
place, and is believed from then on. Nothing is forgotten, so a learner that has such a sample heals
at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from iolspi_ros.core.samples import Transitions
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

FAR_REWARD, FAR_PRIZE = 30.0, 1000.0
"""A reward so many times as large as all others is not believed; the second, at an end."""
FAR_STATE = 10.0
"""The same for the distance of a variable from its median."""
FEW = 6
"""What is seen more often is believed; a state stands in two samples."""
RARE = 0.1
"""Of all samples. Rewards far beyond the others that are more than few, and less than this share,
are believed where they are found together: one falsified now and then stands among true ones."""
TOGETHER = 1.0 / 3.0
"""Share of them whose nearest sample with the same action is one of them, too."""


@dataclass(frozen=True)
class Doubts:
    """Which samples are not believed, and why.

    Attributes
    ----------
    rows : ndarray of bool, shape (n_samples,)
    reasons : tuple of str
        What is doubted, with its largest value.
    """

    rows: NDArray[np.bool_]
    reasons: tuple[str, ...]


def doubts(
    transitions: Transitions, low: Array | float = -np.inf, high: Array | float = np.inf
) -> Doubts:
    """Which of some samples cannot be true.

    Parameters
    ----------
    transitions : Transitions
        Of finite numbers.
    low, high : ndarray of shape (n_dims,), or float
        Limits that the states have, in their own units; infinite where nobody knows.

    Returns
    -------
    Doubts
    """
    t = transitions
    size, reasons = np.abs(t.reward), list[str]()
    rows = far(size, FAR_PRIZE) | (_alone(t, rare(t.reward)) & ~t.terminated)
    if rows.any():
        reasons.append(f"reward {t.reward[rows][size[rows].argmax()]:.3g}")
    both = np.stack([t.state, t.next_state])
    outside = (both < low) | (both > high)
    distance = np.abs(both - np.median(both, axis=(0, 1))) if len(t) else both
    for d in range(both.shape[2]):
        bad = outside[:, :, d] | far(distance[:, :, d].ravel(), FAR_STATE).reshape(2, -1)
        if bad.any():
            value = both[:, :, d][bad][distance[:, :, d][bad].argmax()]
            reasons.append(f"variable {d} at {value:.3g}")
            rows = rows | bad.any(axis=0)
    return Doubts(rows, tuple(reasons))


def generous(task: TaskDescription) -> tuple[Array, Array]:
    """Limits beyond which a state is not believed: the task's, and as much again on either side.

    A state that ends the task may lie a little beyond its limits.

    Returns
    -------
    low, high : ndarray of shape (n_dims,)
        Infinite where the task has none.
    """
    low, high = np.array(task.low), np.array(task.high)
    span = np.where(np.isfinite(high - low), high - low, np.inf)
    return low - span, high + span


def rare(reward: Array) -> NDArray[np.bool_]:
    """Which rewards are far beyond all others, be they few or only `RARE`."""
    return far(np.abs(reward), FAR_REWARD, max(FEW, int(RARE * len(reward))))


def _alone(t: Transitions, group: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those of a group that are few, or stand among others wherever they are."""
    found = np.flatnonzero(group)
    if len(found) <= FEW:
        return group
    middle = np.median(t.state, axis=0)
    spread = np.median(np.abs(t.state - middle), axis=0)
    places = (t.state - middle) / np.where(spread > 0.0, spread, 1.0)
    together = 0
    for action in np.unique(t.action[found]):
        same = np.flatnonzero(t.action == action)
        own = same[group[same]]
        if len(same) > 1:
            _, near = cKDTree(places[same]).query(places[own], k=2)
            # The nearest is itself, or one at the very same place.
            other = np.where(same[near[:, 0]] == own, near[:, 1], near[:, 0])
            together += int(group[same[other]].sum())
    return group & (together < TOGETHER * len(found))


def far(sizes: Array, factor: float, few: int = FEW) -> NDArray[np.bool_]:
    """Which of some sizes are beyond so many times all the others, and few.

    Parameters
    ----------
    sizes : ndarray of shape (n,)
        None negative. Where all the others are zero there is nothing to compare with.
    factor : float
    few : int
        So many at most.
    """
    count = min(few, len(sizes) - 1)
    if count < 1:
        return np.zeros(len(sizes), bool)
    top = np.sort(np.partition(sizes, -count - 1)[-count - 1 :])
    apart = (top[:-1] > 0.0) & (top[1:] / factor > top[:-1])
    if not apart.any():
        return np.zeros(len(sizes), bool)
    beyond: NDArray[np.bool_] = sizes > top[:-1][apart][0]
    return beyond
