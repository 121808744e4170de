"""The baseline: the near-optimal return of a task, by dynamic programming on its model."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.errors import InputError

Array = NDArray[np.float64]
Step = Callable[[Array, NDArray[np.int64]], tuple[Array, Array, NDArray[np.bool_]]]
Progress = Callable[[float], None]

CHUNK = 1 << 16
"""States that the model is asked for at a time."""
EVALUATIONS = 4
"""Sweeps after the chosen actions for each one that chooses."""
_MODEL_SHARE = 0.2  # of the work: asking the model, before the sweeps


@dataclass(frozen=True)
class Grid:
    """Points of a regular grid, between which values are interpolated linearly.

    A state beyond the limits has the value of the nearest one within. An angle that wraps
    needs no care: both of its ends are points, and what follows them is the same.

    Parameters
    ----------
    low, high : sequence of float
        Limits per dimension; both are points.
    counts : sequence of int
        Points per dimension, two or more.
    """

    low: Sequence[float]
    high: Sequence[float]
    counts: Sequence[int]

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(self.counts)

    def points(self, start: int, stop: int) -> Array:
        """Points from `start` until `stop`, last dimension fastest: (stop - start, n_dims)."""
        index = np.stack(np.unravel_index(np.arange(start, stop), tuple(self.counts)), axis=1)
        spacing = np.subtract(self.high, self.low) / (np.array(self.counts) - 1)
        return np.minimum(self.low + index * spacing, self.high)

    def locate(self, states: Array) -> tuple[NDArray[np.int32], Array]:
        """Where states lie.

        Parameters
        ----------
        states : ndarray of shape (n, n_dims)

        Returns
        -------
        cells : ndarray of int, shape (n,)
            Number of the point at the lower corner of the cell.
        shares : ndarray of shape (n, n_dims)
            How far across the cell, 0 to 1.
        """
        last = np.array(self.counts) - 1
        position = (states - self.low) * (last / np.subtract(self.high, self.low))
        np.clip(position, 0.0, last, out=position)
        lower = np.minimum(position.astype(np.int32), last - 1)
        return (lower @ self._strides).astype(np.int32), position - lower

    def interpolate(self, values: Array, states: Array) -> Array:
        """Values at `states` from those at the points, shape (n,)."""
        cells, shares = self.locate(states)
        return _interpolate(values, cells, shares, self.corners)

    @property
    def corners(self) -> NDArray[np.int64]:
        """Corners of a cell by how far they are from the lower one, last dimension fastest."""
        sides = np.indices((2,) * len(self.counts)).reshape(len(self.counts), -1)
        return self._strides @ sides

    @property
    def _strides(self) -> NDArray[np.int64]:
        return np.array([math.prod(self.counts[d + 1 :]) for d in range(len(self.counts))])


@cached_njit(nogil=True)
def _between(
    values: Array, cell: int, shares: Array, corners: NDArray[np.int64], work: Array
) -> float:
    """Multilinear interpolation inside a cell: one dimension after the other, the last first."""
    n = len(corners)
    for c in range(n):
        work[c] = values[cell + corners[c]]
    for d in range(len(shares) - 1, -1, -1):
        n //= 2
        for c in range(n):
            work[c] = work[2 * c] + shares[d] * (work[2 * c + 1] - work[2 * c])
    return work[0]


@cached_njit(nogil=True)
def _interpolate(
    values: Array, cells: NDArray[np.int32], shares: Array, corners: NDArray[np.int64]
) -> Array:
    found, work = np.empty(len(cells)), np.empty(len(corners))
    for k in range(len(cells)):
        found[k] = _between(values, cells[k], shares[k], corners, work)
    return found


@cached_njit(nogil=True)
def _sweep(
    values: Array,
    choice: NDArray[np.int8],
    model: tuple[Array, NDArray[np.int32], Array],
    corners: NDArray[np.int64],
    gamma: float,
    improve: bool,
    backwards: bool,
) -> float:
    """Renew every value in its place, after the best action or the chosen one; largest change."""
    rewards, cells, shares = model
    n, n_actions = rewards.shape
    work, change = np.empty(len(corners)), 0.0
    for k in range(n):
        i = n - 1 - k if backwards else k
        best = -np.inf
        first, stop = (0, n_actions) if improve else (choice[i], choice[i] + 1)
        for a in range(first, stop):
            q = rewards[i, a]
            if cells[i, a] >= 0:
                q += gamma * _between(values, cells[i, a], shares[i, a], corners, work)
            if q > best:
                best, choice[i] = q, a
        change = max(change, abs(best - values[i]))
        values[i] = best
    return change


@dataclass(frozen=True)
class NearOptimal:
    """A policy that looks some steps ahead on the model and trusts V beyond.

    Attributes
    ----------
    grid : Grid
    values : ndarray of shape (grid.size,)
        V at the points of the grid.
    step : callable
        The model: (states, actions) → (next states, rewards, terminated).
    n_actions : int
    gamma : float
    lookahead : int
        Steps, 1 or more. Each makes up for a coarse grid, and asks the model n_actions times more.
    """

    grid: Grid
    values: Array
    step: Step
    n_actions: int
    gamma: float
    lookahead: int = 1

    def __call__(self, states: Array) -> NDArray[np.int64]:
        """Best action in each state, shape (n,)."""
        return self.q(states).argmax(axis=1)

    def q(self, states: Array, ahead: int = 0) -> Array:
        """Q of each state and action, shape (n, n_actions); `ahead` is the lookahead by default."""
        ahead = ahead or self.lookahead
        q = np.empty((len(states), self.n_actions))
        for a in range(self.n_actions):
            following, reward, ended = self.step(states, np.full(len(states), a))
            if ahead > 1:
                beyond = self.q(following, ahead - 1).max(axis=1)
            else:
                beyond = self.grid.interpolate(self.values, following)
            q[:, a] = reward + self.gamma * np.where(ended, 0.0, beyond)
        return q


def near_optimal(
    step: Step,
    grid: Grid,
    n_actions: int,
    gamma: float,
    tolerance: float = 1e-4,
    progress: Progress | None = None,
) -> NearOptimal:
    """Modified policy iteration until no value changes by more than `tolerance`.

    The model is asked once, which takes grid.size * n_actions * (12 + 8 n_dims) bytes.

    Parameters
    ----------
    step : callable
        Deterministic model: (states, actions) → (next states, rewards, terminated).
    grid : Grid
    n_actions : int
    gamma : float in [0, 1)
    tolerance : float
        In the unit of the reward.
    progress : callable, optional
        Is told now and then what share of the work is done, 0 to 1.

    Returns
    -------
    NearOptimal

    Raises
    ------
    InputError
        When the model gives a reward that is not finite.

    References
    ----------
    Puterman and Shin, "Modified policy iteration algorithms for discounted Markov decision
    problems", Management Science 24(11), 1978.
    """
    tell = progress or (lambda done: None)
    model = _ask(step, grid, n_actions, tell)
    values, choice = np.zeros(grid.size), np.zeros(grid.size, np.int8)

    def sweep(improve: bool, backwards: bool) -> float:
        return _sweep(values, choice, model, grid.corners, gamma, improve, backwards)

    first, done = sweep(True, False), 0.0
    change = first
    while change > tolerance:  # ends, for γ < 1
        # A sweep after the chosen actions costs a part of one over all. News travels its way,
        # so directions alternate.
        for k in range(EVALUATIONS):
            if sweep(False, k % 2 == 0) <= max(tolerance, 0.1 * change):
                break
        change = sweep(True, False)
        digits = math.log(first / max(change, tolerance)) / math.log(first / tolerance)
        done = max(done, digits)
        tell(_MODEL_SHARE + (1.0 - _MODEL_SHARE) * done)
    return NearOptimal(grid, values, step, n_actions, gamma)


def _ask(
    step: Step, grid: Grid, n_actions: int, tell: Progress
) -> tuple[Array, NDArray[np.int32], Array]:
    """Rewards, next cells (-1: the task ends) and shares, shapes (n, n_actions[, n_dims])."""
    rewards = np.empty((grid.size, n_actions))
    cells = np.empty((grid.size, n_actions), np.int32)
    shares = np.empty((grid.size, n_actions, len(grid.counts)))
    for start in range(0, grid.size, CHUNK):
        stop = min(start + CHUNK, grid.size)
        points = grid.points(start, stop)
        for a in range(n_actions):
            following, rewards[start:stop, a], ended = step(points, np.full(len(points), a))
            found, shares[start:stop, a] = grid.locate(following)
            cells[start:stop, a] = np.where(ended, -1, found)
        tell(_MODEL_SHARE * stop / grid.size)
    if not np.isfinite(rewards).all():
        raise InputError("the model gives a reward that is not finite; allowed: finite ones")
    return rewards, cells, shares
