"""One measured figure beside its goal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats


@dataclass(frozen=True)
class Row:
    """A figure.

    Attributes
    ----------
    name : str
    value : float
    unit : str
    goal : str
        Empty when there is none.
    holds : bool, optional
        Whether the goal is met; None without a goal.
    """

    name: str
    value: float
    unit: str
    goal: str = ""
    holds: bool | None = None


def at_most(name: str, value: float, unit: str, goal: float) -> Row:
    """A figure that should not be larger than its goal."""
    return Row(name, value, unit, f"at most {goal:g}", bool(value <= goal))


def at_least(name: str, value: float, unit: str, goal: float) -> Row:
    """A figure that should not be smaller than its goal."""
    return Row(name, value, unit, f"at least {goal:g}", bool(value >= goal))


def interval(values: NDArray[np.float64]) -> tuple[float, float, float]:
    """Mean and the limits of its 95 % interval (T 9-16, 9-17; Student's t for few).

    Parameters
    ----------
    values : ndarray of shape (n,)
        Of independent realisations.
    """
    mean, n = float(np.mean(values)), len(values)
    if n < 2:
        return mean, mean, mean
    half = float(stats.t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n))
    return mean, mean - half, mean + half
