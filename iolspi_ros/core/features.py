"""Features of a state, φ(s): tensor products of functions of one variable.

The features of a state and an action, φ(s, a), are φ(s) in the block of that action and zero
in every other block (T IV-A), so they are never built: whoever needs them works on blocks.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError, check_choice, check_range

Array = NDArray[np.float64]

BASES = ("rbf", "chebyshev")
NORMALISATIONS = ("asymmetric", "symmetric", "none")


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


@dataclass(frozen=True)
class RBFGrid(Basis):
    """An equidistant grid of Gaussian radial basis functions (T 9-1).

    Parameters
    ----------
    low, high, centers
        As of every basis; the centres are spaced evenly from low to high.
    normalisation : {"asymmetric", "symmetric"}
        "symmetric" maps every dimension to [-1, 1] (T Eq. 9-2) with one round width, that of
        the first dimension with more than one centre. "asymmetric" also scales each dimension
        by its number of centres (T Eqs. 9-4 to 9-9), which makes the functions ellipsoidal.
        "none" leaves the state as it is (T Eq. 8-2).
    width : float
        Width σ of a function in spacings of that first dimension's centres, or unnormalised in
        the units of the state; T uses 1.
    periodic : tuple of bool
        Dimensions in which `high` is `low` again, one for all or each. There the functions
        wrap around and no centre stands at `high`. T has none.
    constant : bool
        A function before the others that is 1 everywhere (T Eq. 8-2).
    kept : tuple of int
        Numbers of the Gaussians that were not trimmed away; empty for all.

    Raises
    ------
    InputError
        When the limits, the numbers of centres or the width do not make a grid.

    References
    ----------
    T (Schonebaum 2016), sections 9-1-1 to 9-1-4 and 8-1.
    """

    normalisation: str = "asymmetric"
    width: float = 1.0
    periodic: tuple[bool, ...] = (False,)
    constant: bool = False
    kept: tuple[int, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("normalisation", self.normalisation, NORMALISATIONS)
        check_range("width", self.width, 0.0, np.inf, low_open=True, high_open=True)
        if len(self.periodic) not in (1, self.n_dims):
            raise InputError(
                f"periodic has {len(self.periodic)} entries; allowed: 1 or {self.n_dims}"
            )

    @cached_property
    def _axes(self) -> tuple[list[Array], Array, Array]:
        """Centres, gain and period of each dimension."""
        wraps = np.broadcast_to(np.array(self.periodic), (self.n_dims,))
        ranges = np.subtract(self.high, self.low)
        steps = np.array(self.centers) - ~wraps
        varying = np.flatnonzero(np.array(self.centers) > 1)
        reference = steps[varying[0]] if len(varying) else 1
        # Normalised, the spacing of the reference dimension is σ = 2 / (c_ref - 1); the scale
        # of T Eq. 9-9 then makes (c_d - 1) / (H - L) of the distance in dimension d.
        spacings = {"asymmetric": steps, "symmetric": reference, "none": ranges}[self.normalisation]
        gains = np.where(np.array(self.centers) > 1, spacings / ranges / self.width, 0.0)
        centers = [
            np.linspace(low, high, count, endpoint=not wrap)
            for low, high, count, wrap in zip(self.low, self.high, self.centers, wraps, strict=True)
        ]
        return centers, gains, np.where(wraps, ranges, 0.0)

    @cached_property
    def table(self) -> Table:
        """The numbers that evaluate it."""
        centers, gains, periods = self._axes
        counts = np.array(self.centers)
        numbers = np.arange(math.prod(self.centers)) if self.constant else ()
        kept = np.stack(np.unravel_index(np.array(self.kept or numbers, np.int64), counts), axis=1)
        if self.constant:
            kept = np.insert(kept, 0, -1, axis=0)
        places = np.concatenate(centers)
        return Table(False, counts, places, gains, periods, np.ascontiguousarray(kept),
                     np.zeros((0, self.n_dims)))  # fmt: skip

    @property
    def points(self) -> Array:
        """Centres μ in the state's units, shape (size, n_dims), last dimension fastest."""
        mesh = np.meshgrid(*self._axes[0], indexing="ij")
        points = np.stack([axis.ravel() for axis in mesh], axis=1)
        return points[list(self.kept)] if self.kept else points

    def trim(self, states: Array) -> RBFGrid:
        """Keep the centres inside the convex hull of some states (T 9-1-4).

        The hull spans the dimensions that vary; the others do not count.

        Parameters
        ----------
        states : ndarray of shape (n_samples, n_dims)

        Returns
        -------
        RBFGrid

        Raises
        ------
        InputError
            When the states span no hull, or no centre is inside.
        """
        varying = [d for d, count in enumerate(self.centers) if count > 1]
        points, samples = self.points[:, varying], np.asarray(states)[:, varying]
        if len(varying) == 1:
            inside = (points[:, 0] >= samples.min()) & (points[:, 0] <= samples.max())
        else:
            try:
                inside = Delaunay(samples).find_simplex(points) >= 0
            except (QhullError, ValueError) as error:
                raise InputError(
                    f"{len(samples)} states span no convex hull in {len(varying)} dimensions; "
                    f"allowed: at least {len(varying) + 1} that do not lie in a plane or a line"
                ) from error
        if not inside.any():
            raise InputError(
                f"none of {self.size} centres is in the convex hull of {len(samples)} states; "
                "allowed: states that spread over at least one centre, or a finer grid"
            )
        numbers = np.array(self.kept)[inside] if self.kept else np.flatnonzero(inside)
        return replace(self, kept=tuple(numbers.tolist()))


@dataclass(frozen=True)
class ChebyshevGrid(Basis):
    """Chebyshev polynomials of the first kind, multiplied out by T Eqs. 4-2 to 4-5.

    Dimension d has the polynomials ψ_0 to ψ_(c_d - 1) of its variable normalised to [-1, 1]
    (T Eq. 4-3); a state beyond the limits counts as at the limit, since polynomials explode
    there. T multiplies with polynomials of the action too; as many as there are actions span
    the same functions as a block for each action, which is what we have.
    """

    @cached_property
    def table(self) -> Table:
        """The numbers that evaluate it."""
        low, high, counts = np.array(self.low), np.array(self.high), np.array(self.centers)
        places = np.repeat((low + high) / 2, counts)
        nothing = np.empty((0, self.n_dims), np.int64)
        return Table(True, counts, places, 2 / (high - low), np.zeros(self.n_dims), nothing,
                     np.zeros((0, self.n_dims)))  # fmt: skip


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
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


@njit(cache=True)
def _evaluate_all(table: Table, states: Array, phi: Array) -> None:
    factors = np.empty(table.counts.sum())
    for row in range(len(states)):
        evaluate(table, states[row], factors, phi[row])


@njit(cache=True)
def _factors_all(table: Table, states: Array, parts: Array) -> None:
    for row in range(len(states)):
        _factors(table, states[row], parts[row])
