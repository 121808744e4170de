"""Features without a grid: Gaussians around states that were seen, spread by the samples alone.

Nobody gives limits, numbers of centres or widths. Each variable is measured in its own range,
states far from each other become centres, and a function is as wide as the centres are apart,
so that it reaches its neighbours in two dimensions as in ten. States between the centres, picked
in the same way, divide the states for the buffer: what is nearest to one of them is one crowd.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.basis import Basis, Table
from iolspi_ros.errors import InputError

Array = NDArray[np.float64]

REACH = 1.5
"""Width of a function in distances of a centre from the nearest other one."""
RANGE = (0.005, 0.995)
"""Shares of the samples between which a variable's range is taken."""
LOYALTY = 1.3
"""A centre in use goes only for a state that is so many times farther from all others."""
MOST_CENTERS = 14
"""Functions for each variable, multiplied: narrower ones than that need more samples than help."""
LEAST_SAMPLES = 4
"""For each function: from a few samples, few and wide ones are learned."""
FINER = 4
"""Crowds for each function: half as wide in a plane."""


@dataclass(frozen=True, eq=False)
class Kernels(Basis):
    """Gaussians around some states.

    Parameters
    ----------
    points : ndarray of shape (size, n_dims)
        Centres, in the units of the state.
    scales : ndarray of shape (n_dims,)
        What a distance is divided by: the range of each variable; of one that repeats, what the
        chord between two of its values is divided by.
    periods : ndarray of shape (n_dims,)
        After which a variable repeats; 0 for never.
    width : float
        Of a function, in ranges.
    """

    points: Array
    scales: Array
    periods: Array
    width: float

    def __init__(self, points: Array, scales: Array, periods: Array, width: float) -> None:
        # Not a product of functions: the limits and numbers of the base class say nothing.
        for name, value in (("points", points), ("scales", scales), ("periods", periods),
                            ("width", width)):  # fmt: skip
            object.__setattr__(self, name, value)
        spread = points if len(points) else np.zeros((1, len(scales)))
        object.__setattr__(self, "low", tuple(spread.min(axis=0).tolist()))
        object.__setattr__(self, "high", tuple(spread.max(axis=0).tolist()))
        object.__setattr__(self, "centers", (1,) * len(scales))

    @classmethod
    def unseen(cls, periods: Array) -> Kernels:
        """Before any sample: one function that is 1 everywhere."""
        return cls(np.zeros((1, len(periods))), np.full(len(periods), np.inf), periods, 1.0)

    @property
    def size(self) -> int:
        """Number of functions."""
        return len(self.points)

    @cached_property
    def table(self) -> Table:
        """The numbers that evaluate it."""
        n_dims = len(self.scales)
        gains = 1.0 / (self.scales * self.width)
        counts = np.where(self.periods > 0.0, 2, 1)  # coordinates of each variable
        return Table(
            False, counts, np.zeros(0), gains, self.periods, np.zeros((0, n_dims), np.int64),
            flat(self.points, gains, self.periods),
        )  # fmt: skip

    def around(
        self, states: Array, size: int, metric: tuple[float, ...] = (1.0,)
    ) -> tuple[Kernels, Crowds]:
        """As many functions, at most, around states among these; present ones tend to stay.

        Parameters
        ----------
        states : ndarray of shape (n_samples, n_dims)
        size : int
        metric : tuple of float
            What a variable's range counts, one for all or each.

        Returns
        -------
        kernels : Kernels
        crowds : Crowds
            `FINER` times as many parts of the same states.
        """
        scales = ranges(states, self.periods) / np.array(metric)
        own = self.points if np.isfinite(self.scales).any() else self.points[:0]
        among = np.concatenate([own, states])
        loyalty = np.where(np.arange(len(among)) < len(own), LOYALTY**2, 1.0)
        size = min(size, MOST_CENTERS ** len(scales), 1 + len(states) // LEAST_SAMPLES)
        places = flat(among, 1.0 / scales, self.periods)
        chosen = _farthest(places, loyalty, min(FINER * size, len(among)))
        first = places[chosen[:size]]
        width = 1.0
        if len(first) > 1:
            width = REACH * float(np.median(KDTree(first).query(first, 2)[0][:, 1]))
        found = Kernels(np.ascontiguousarray(among[chosen[:size]]), scales, self.periods, width)
        return found, Crowds(among[chosen], scales, self.periods)

    def packed(self, weights: Array) -> Array:
        """A policy with its functions as one array, to send or to keep.

        Returns
        -------
        ndarray of shape (n_actions + n_dims + 1, n_columns)
            Rows of weights, of the centres' variables, and one that begins with 1 / width of
            each variable and its period. Columns beyond the functions have no weight.
        """
        n_dims = len(self.scales)
        rows = np.zeros((len(weights) + n_dims + 1, max(self.size, 2 * n_dims)))
        rows[: len(weights), : self.size] = weights
        rows[len(weights) : -1, : self.size] = self.points.T
        rows[-1, : 2 * n_dims] = *self.table.gains, *self.periods
        return rows

    @classmethod
    def unpacked(cls, rows: Array, n_actions: int) -> tuple[Kernels, Array]:
        """Functions and weights from `packed`.

        Raises
        ------
        InputError
            When these are no such rows.
        """
        n_dims = len(rows) - n_actions - 1
        if n_dims < 1 or rows.shape[1] < 2 * n_dims or not np.isfinite(rows).all():
            raise InputError(
                f"a policy with its functions has shape {rows.shape} for {n_actions} actions; "
                "allowed: finite numbers, a row for each action, one for each variable, one more"
            )
        gains, periods = rows[-1, :n_dims], rows[-1, n_dims : 2 * n_dims]
        points = np.ascontiguousarray(rows[n_actions:-1].T)
        scales = np.divide(1.0, gains, out=np.full(n_dims, np.inf), where=gains != 0.0)
        return cls(points, scales, periods.copy(), 1.0), rows[:n_actions].copy()


@dataclass(frozen=True, eq=False)
class Crowds:
    """Parts of the state space for a buffer: each is what is nearest to one point.

    Parameters
    ----------
    points : ndarray of shape (n_points, n_dims)
    scales, periods : ndarray of shape (n_dims,)
        As of `Kernels`.
    """

    points: Array
    scales: Array
    periods: Array

    @property
    def n_dims(self) -> int:
        """Number of state variables."""
        return len(self.scales)

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(flat(self.points, 1.0 / self.scales, self.periods))

    def __call__(self, states: Array, action: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of the part and action of each sample, shape (n_samples,)."""
        nearest = self._tree.query(flat(states, 1.0 / self.scales, self.periods))[1]
        return nearest.astype(np.int64) + action * len(self.points)


def flat(states: Array, gains: Array, periods: Array) -> Array:
    """Coordinates whose distances count: a variable that repeats is a place on a circle."""
    columns = []
    for value, gain, period in zip(states.T, gains, periods, strict=True):
        if period > 0.0:
            angle, radius = 2.0 * np.pi * value / period, gain * period / (2.0 * np.pi)
            columns += [radius * np.cos(angle), radius * np.sin(angle)]
        else:
            columns.append(gain * value)
    return np.ascontiguousarray(np.stack(columns, axis=1))


def ranges(states: Array, periods: Array) -> Array:
    """Range of each variable; a variable that stands still does not count."""
    low, high = np.quantile(states, RANGE, axis=0)
    ranges = high - low
    for d in np.flatnonzero(periods):
        angle = 2.0 * np.pi * states[:, d] / periods[d]
        sides = [np.ptp(np.quantile(f(angle), RANGE)) for f in (np.cos, np.sin)]
        ranges[d] = max(sides) * periods[d] / (2.0 * np.pi)
    scales: Array = np.where(ranges > 1e-12, ranges, np.inf)
    return scales


@cached_njit(nogil=True)
def _farthest(places: Array, loyalty: Array, size: int) -> NDArray[np.int64]:
    """Numbers of some places, each time of the one farthest from all before."""
    far = np.full(len(places), np.inf)
    chosen, count, last = np.zeros(size, np.int64), 1, 0
    while count < size:
        best, most = 0, 0.0
        for i in range(len(places)):
            apart = 0.0
            for d in range(places.shape[1]):
                apart += (places[i, d] - places[last, d]) ** 2
            far[i] = min(far[i], apart)
            if far[i] * loyalty[i] > most:
                best, most = i, far[i] * loyalty[i]
        if most <= 1e-12:
            break
        last = best
        chosen[count], count = best, count + 1
    return chosen[:count]
