"""The yardstick: the near-optimal return of a task, by dynamic programming on its model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Array = NDArray[np.float64]
Step = Callable[[Array, NDArray[np.int64]], tuple[Array, Array, NDArray[np.bool_]]]


@dataclass(frozen=True)
class Grid:
    """Points of a regular grid, between which values are interpolated linearly.

    Parameters
    ----------
    low, high : sequence of float
        Limits per dimension.
    counts : sequence of int
        Points per dimension.
    periodic : sequence of bool
        Dimensions in which `high` is `low` again.
    """

    low: Sequence[float]
    high: Sequence[float]
    counts: Sequence[int]
    periodic: Sequence[bool]

    @property
    def points(self) -> Array:
        """Every point, shape (prod(counts), n_dims), last dimension fastest."""
        axes = [
            np.linspace(low, high, count, endpoint=not wraps)
            for low, high, count, wraps in zip(
                self.low, self.high, self.counts, self.periodic, strict=True
            )
        ]
        return np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)

    def interpolation(self, states: Array) -> sparse.csr_array:
        """Matrix that turns values at the points into values at `states`.

        Returns
        -------
        scipy.sparse.csr_array of shape (n_states, prod(counts))
        """
        n = len(states)
        index = np.zeros((n, 1), np.int64)
        weight = np.ones((n, 1))
        for d, (low, high, count, wraps) in enumerate(
            zip(self.low, self.high, self.counts, self.periodic, strict=True)
        ):
            position = (states[:, d] - low) / (high - low) * (count if wraps else count - 1)
            if not wraps:
                position = np.clip(position, 0.0, count - 1)
            left = np.floor(position).astype(np.int64)
            if not wraps:
                left = np.minimum(left, count - 2)
            share = position - left
            ends = np.stack([left, left + 1], axis=1) % count
            shares = np.stack([1.0 - share, share], axis=1)
            index = (index[:, :, None] * count + ends[:, None, :]).reshape(n, -1)
            weight = (weight[:, :, None] * shares[:, None, :]).reshape(n, -1)
        rows = np.arange(0, n * index.shape[1] + 1, index.shape[1])
        shape = (n, int(np.prod(self.counts)))
        return sparse.csr_array((weight.ravel(), index.ravel(), rows), shape=shape)


@dataclass(frozen=True)
class NearOptimal:
    """A policy that looks one step ahead on the model and trusts V beyond.

    Attributes
    ----------
    grid : Grid
    values : ndarray of shape (prod(counts),)
        V at the points of the grid.
    step : callable
        The model: (states, actions) → (next states, rewards, terminated).
    n_actions : int
    gamma : float
    """

    grid: Grid
    values: Array
    step: Step
    n_actions: int
    gamma: float

    def __call__(self, states: Array) -> NDArray[np.int64]:
        """Best action in each state, shape (n,)."""
        q = np.empty((len(states), self.n_actions))
        for a in range(self.n_actions):
            following, reward, ended = self.step(states, np.full(len(states), a))
            beyond = self.grid.interpolation(following) @ self.values
            q[:, a] = reward + self.gamma * np.where(ended, 0.0, beyond)
        return q.argmax(axis=1)


def near_optimal(
    step: Step, grid: Grid, n_actions: int, gamma: float, tolerance: float = 1e-4
) -> NearOptimal:
    """Value iteration until no value changes by more than `tolerance`.

    Parameters
    ----------
    step : callable
        Deterministic model: (states, actions) → (next states, rewards, terminated).
    grid : Grid
    n_actions : int
    gamma : float in [0, 1)
    tolerance : float
        In the unit of the reward.

    Returns
    -------
    NearOptimal
    """
    points = grid.points
    moves, rewards = [], []
    for a in range(n_actions):
        following, reward, ended = step(points, np.full(len(points), a))
        alive = sparse.diags_array(np.where(ended, 0.0, gamma))
        moves.append(alive @ grid.interpolation(following))
        rewards.append(reward)
    transition = sparse.vstack(moves, format="csr")
    gain = np.concatenate(rewards)
    values = np.zeros(len(points))
    while True:
        q = (gain + transition @ values).reshape(n_actions, -1)
        new = q.max(axis=0)
        change = float(np.abs(new - values).max())
        values = new
        if change <= tolerance:
            return NearOptimal(grid, values, step, n_actions, gamma)
