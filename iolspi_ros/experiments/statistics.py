"""Means, shares and differences over realisations, each with its 95 % interval."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]


class Interval(NamedTuple):
    """An estimate and the limits of its 95 % interval."""

    mean: float
    low: float
    high: float


def exactly(value: float) -> Interval:
    """A number that no draw has a part in."""
    return Interval(value, value, value)


def interval(values: NDArray[Any]) -> Interval:
    """Mean and the limits of its 95 % interval (T 9-16, 9-17).

    Student's t stands for T's 1.96, which is its limit for many realisations: of 50 it is 2.01.

    Parameters
    ----------
    values : ndarray of shape (n,)
        Of independent realisations. One alone says nothing of how far it is from the mean.
    """
    if len(values) < 2:
        return Interval(float(np.mean(values)), -math.inf, math.inf)
    mean, low, high = intervals(np.asarray(values, float)[:, None])
    return Interval(float(mean[0]), float(low[0]), float(high[0]))


def intervals(values: NDArray[Any]) -> tuple[Array, Array, Array]:
    """Mean and limits as in `interval`, of each column: (n, m) to three of shape (m,).

    The limits of one realisation are itself: there is nothing to draw around it.
    """
    n = len(values)
    mean = np.mean(values, axis=0, dtype=float)
    if n < 2:
        return mean, mean, mean
    half = stats.t.ppf(0.975, n - 1) * np.std(values, axis=0, ddof=1) / math.sqrt(n)
    return mean, mean - half, mean + half


def difference(first: NDArray[Any], second: NDArray[Any]) -> Interval:
    """Interval of the mean of first - second, realisation by realisation: what seeds share cancels.

    Parameters
    ----------
    first, second : ndarray of shape (n,)
        From the same seeds; where one has more, the others are left out.
    """
    n = min(len(first), len(second))
    return interval(np.asarray(first[:n], float) - np.asarray(second[:n], float))


def proportion(successes: int, trials: int) -> Interval:
    """Share and the limits of its 95 % interval (Wilson's, which also holds near 0 and 1)."""
    z = float(stats.norm.ppf(0.975))
    share = successes / trials
    centre = (share + z * z / (2 * trials)) / (1 + z * z / trials)
    half = math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    half *= z / (1 + z * z / trials)
    return Interval(share, max(centre - half, 0.0), min(centre + half, 1.0))
