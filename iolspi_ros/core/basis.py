"""What every basis offers: φ(s), compiled for single states and for many.

The features of a state and an action, φ(s, a), are φ(s) in the block of that action and zero
in every other block (T IV-A), so they are never built: whoever needs them works on blocks.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError, check_range

Array = NDArray[np.float64]


class Table(NamedTuple):
    """A basis as plain numbers, for compiled code.

    Attributes
    ----------
    polynomial : bool
        Chebyshev polynomials instead of Gaussians.
    counts : ndarray of int, shape (n_dims,)
        Functions of each variable.
    places : ndarray of shape (sum of counts,)
        Centres of the Gaussians; of a polynomial's interval, the middle.
    gains : ndarray of shape (n_dims,)
        What turns a distance into widths, or into [-1, 1].
    periods : ndarray of shape (n_dims,)
        After which a variable repeats; 0 for never.
    kept : ndarray of int, shape (n_kept, n_dims)
        Index per variable of each function that was kept, -1 for a factor 1; no rows when all are.
    points : ndarray of shape (n_functions, sum of counts)
        Centres of Gaussians that are no grid, in coordinates whose distances count, `counts` of
        them for each variable; no rows for a grid.
    """

    polynomial: bool
    counts: NDArray[np.int64]
    places: Array
    gains: Array
    periods: Array
    kept: NDArray[np.int64]
    points: Array


@dataclass(frozen=True)
class Basis(ABC):
    """Every product of one function of each variable (T Eqs. 4-5, 9-3).

    Parameters
    ----------
    low, high : tuple of float, length n_dims
        Limits of the state that the functions are spread over, in its own units.
    centers : tuple of int, length n_dims
        Number of functions c_d along each dimension. A dimension with one does not vary: its
        factor is 1.

    Raises
    ------
    InputError
        When the limits or the numbers do not make a basis.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    centers: tuple[int, ...]

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.centers) > 0:
            raise InputError(
                f"low, high and centers have {len(self.low)}, {len(self.high)} and "
                f"{len(self.centers)} entries; allowed: one each per dimension"
            )
        for d, (low, high, count) in enumerate(zip(self.low, self.high, self.centers, strict=True)):
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise InputError(f"low[{d}], high[{d}] are {low}, {high}; allowed: low < high")
            check_range(f"centers[{d}]", count, 1, 10_000)

    @property
    def n_dims(self) -> int:
        """Number of state variables."""
        return len(self.centers)

    @property
    def size(self) -> int:
        """Number of functions."""
        return len(self.table.kept) or math.prod(self.centers)

    @property
    @abstractmethod
    def table(self) -> Table:
        """The numbers that evaluate it."""

    @cached_property
    def _room(self) -> tuple[Array, Array]:
        """Where single states are evaluated, so that nothing is allocated for one."""
        return np.empty(int(self.table.counts.sum())), np.empty(self.size)

    def weigh(self, weights: Array, state: Array, out: Array) -> Array:
        """Sum of w φ(s) for one state.

        Parameters
        ----------
        weights : ndarray of shape (n, size)
        state : ndarray of shape (n_dims,)
        out : ndarray of shape (n,)
            Overwritten.

        Returns
        -------
        ndarray of shape (n,)
            `out`.
        """
        weigh(self.table, weights, state, *self._room, out)
        return out

    def __call__(self, states: Array, terminated: NDArray[np.bool_] | None = None) -> Array:
        """Evaluate every function.

        Parameters
        ----------
        states : ndarray of shape (n_samples, n_dims) or (n_dims,)
        terminated : ndarray of bool, shape (n_samples,), optional
            Rows after which nothing follows: their features are zero.

        Returns
        -------
        ndarray of shape (n_samples, size), or (size,) for a single state

        Raises
        ------
        InputError
            When the states do not have `n_dims` entries.
        """
        states = np.asarray(states, dtype=np.float64)
        if states.shape[-1:] != (self.n_dims,):
            raise InputError(f"state has shape {states.shape}; allowed: (..., {self.n_dims})")
        rows = np.ascontiguousarray(states.reshape(-1, self.n_dims))
        phi = np.empty((len(rows), self.size))
        _evaluate_all(self.table, rows, phi)
        if terminated is not None:
            phi[np.asarray(terminated)] = 0.0
        return phi.reshape(*states.shape[:-1], self.size)

    def along(self, transitions: Transitions) -> tuple[Array, Array]:
        """φ(s) and φ(s') of transitions that mostly follow each other, each state once.

        Returns
        -------
        phi, next_phi : ndarray of shape (n_samples, size)
            `next_phi` is zero where the task ended.
        """
        t = transitions
        phi = self(t.state)
        next_phi = np.empty_like(phi)
        next_phi[:-1] = phi[1:]
        follows = np.zeros(len(t), bool)
        follows[:-1] = (t.next_state[:-1] == t.state[1:]).all(axis=1)
        next_phi[~follows] = self(t.next_state[~follows])
        next_phi[t.terminated] = 0.0
        return phi, next_phi

    def inner(self, one: Array, other: Array) -> Array:
        """φ(s)ᵀφ(s') of some states and others, shape (n_states, n_others).

        Where φ is the product of functions of each variable, so is this, entry by entry.
        """
        if len(self.table.kept) or len(self.table.points):
            product: Array = self(one) @ self(other).T
            return product
        product = np.ones((len(one), len(other)))
        for here, there in zip(self._factors(one), self._factors(other), strict=True):
            product *= here @ there.T
        return product

    def _factors(self, states: Array) -> list[Array]:
        """The functions of each variable apart, each of shape (n_states, c_d)."""
        parts = np.empty((len(states), int(self.table.counts.sum())))
        _factors_all(self.table, np.ascontiguousarray(states), parts)
        return np.split(parts, np.cumsum(self.table.counts)[:-1], axis=1)


@cached_njit(nogil=True)
def _factors(table: Table, state: Array, out: Array) -> None:
    first = 0
    for d in range(len(table.counts)):
        count, gain, period = table.counts[d], table.gains[d], table.periods[d]
        if table.polynomial:
            x = min(max((state[d] - table.places[first]) * gain, -1.0), 1.0)
            out[first] = 1.0
            if count > 1:
                out[first + 1] = x
            for i in range(first + 2, first + count):
                out[i] = 2.0 * x * out[i - 1] - out[i - 2]  # T Eq. 4-2
        else:
            for i in range(first, first + count):
                distance = state[d] - table.places[i]
                if period > 0.0:
                    distance -= period * np.round(distance / period)
                distance *= gain
                out[i] = np.exp(-0.5 * distance * distance)  # T Eq. 9-3
        first += count


@cached_njit(nogil=True)
def evaluate(table: Table, state: Array, factors: Array, phi: Array) -> None:
    """φ of one state, compiled: `factors` and `phi` are overwritten."""
    if len(table.points):
        place = 0
        for d in range(len(state)):
            gain, period = table.gains[d], table.periods[d]
            if period > 0.0:  # a place on a circle
                angle, radius = 2.0 * math.pi * state[d] / period, gain * period / (2.0 * math.pi)
                factors[place] = radius * math.cos(angle)
                factors[place + 1] = radius * math.sin(angle)
                place += 2
            else:
                factors[place] = gain * state[d]
                place += 1
        for k in range(len(table.points)):
            total = 0.0
            for d in range(place):
                total += (factors[d] - table.points[k, d]) ** 2
            phi[k] = math.exp(-0.5 * total)
        return
    _factors(table, state, factors)
    if len(table.kept):
        for k in range(len(table.kept)):
            product, first = 1.0, 0
            for d in range(len(table.counts)):
                if table.kept[k, d] >= 0:
                    product *= factors[first + table.kept[k, d]]
                first += table.counts[d]
            phi[k] = product
        return
    phi[0] = 1.0
    done, first = 1, 0
    for d in range(len(table.counts)):
        count = table.counts[d]
        for i in range(done - 1, -1, -1):  # backwards, so that nothing is overwritten too early
            left = phi[i]
            for j in range(count):
                phi[i * count + j] = left * factors[first + j]
        done *= count
        first += count


@cached_njit(nogil=True)
def weigh(
    table: Table, weights: Array, state: Array, factors: Array, phi: Array, out: Array
) -> None:
    """Sum of w φ(s) for each row of weights, compiled; the last three are overwritten."""
    evaluate(table, state, factors, phi)
    for a in range(len(weights)):
        total = 0.0
        for k in range(len(phi)):
            total += weights[a, k] * phi[k]
        out[a] = total


@cached_njit(nogil=True)
def _evaluate_all(table: Table, states: Array, phi: Array) -> None:
    factors = np.empty(table.counts.sum())
    for row in range(len(states)):
        evaluate(table, states[row], factors, phi[row])


@cached_njit(nogil=True)
def _factors_all(table: Table, states: Array, parts: Array) -> None:
    for row in range(len(states)):
        _factors(table, states[row], parts[row])
