"""A model of a vehicle by locally weighted linear regression on samples (T Eq. 4-8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from iolspi_ros.core.kernels import flat, ranges
from iolspi_ros.core.samples import Transitions
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

NEIGHBOURS = 24
"""Samples that a regression looks at; those beyond weigh nothing."""
TAU = 0.03
"""τ, in ranges of the variables."""
RIDGE = 1e-6
"""Of a slope, relative to the weights: where neighbours lie in a line or in a heap."""
MOST = 2000
"""Samples of an action around which regressions are kept; more are thinned."""


def weights(distances: Array, tau: float) -> Array:
    """W of T Eq. 4-8 up to a factor, which no regression feels: the nearest weighs 1.

    The distance is squared, as in any Gaussian; T's equation leaves the square out.
    """
    squares = distances**2
    found: Array = np.exp(-(squares - squares.min(axis=1, keepdims=True)) / (2.0 * tau**2))
    return found


def regress(offsets: Array, targets: Array, weight: Array) -> Array:
    """Weighted least squares of affine functions, many at a time.

    Parameters
    ----------
    offsets : ndarray of shape (n, k, n_dims)
        Of the samples from where the function is wanted.
    targets : ndarray of shape (n, k, n_targets)
    weight : ndarray of shape (n, k)

    Returns
    -------
    ndarray of shape (n, 1 + n_dims, n_targets)
        The value there, and its slopes.
    """
    x = np.concatenate([np.ones((*offsets.shape[:2], 1)), offsets], axis=2)
    weighted = x.transpose(0, 2, 1) * weight[:, None]
    gram = weighted @ x
    scale = RIDGE * weight.sum(axis=1)[:, None] * (1.0 + (offsets**2).mean(axis=(1, 2)))[:, None]
    diagonal = np.arange(1, x.shape[2])
    gram[:, diagonal, diagonal] += scale * TAU**2
    found: Array = np.linalg.solve(gram, weighted @ targets)
    return found


@dataclass(frozen=True)
class _Action:
    """What an action does: regressions around some of its samples."""

    points: Array
    tree: KDTree
    fits: Array


class LocalModel:
    """Next states, rewards and ends, one regression around each sample, the nearest one asked.

    A reward or a state beyond all that were seen is not believed, but cut off there.

    Parameters
    ----------
    rows : Transitions
    task : TaskDescription
    """

    def __init__(self, rows: Transitions, task: TaskDescription) -> None:
        self._periods = np.array(
            [v.high - v.low if v.periodic else 0.0 for v in task.variables]
        )  # fmt: skip
        self._wraps = np.flatnonzero(self._periods)
        self._lowest = np.array([v.low for v in task.variables])[self._wraps]
        self._scales = np.minimum(ranges(rows.state, self._periods), 1e9)
        both = np.concatenate([rows.state, rows.next_state])
        self._limits = both.min(axis=0), both.max(axis=0)
        self._rewards = rows.reward.min(), rows.reward.max()
        self._actions = [self._fit(rows[rows.action == a]) for a in range(task.n_actions)]

    @staticmethod
    def possible(rows: Transitions, task: TaskDescription) -> bool:
        """Whether every action was taken often enough for a regression."""
        counts = np.bincount(rows.action, minlength=task.n_actions)
        return bool((counts >= task.n_dims + 2).all())

    def __call__(
        self, states: Array, actions: NDArray[np.int64] | Sequence[int]
    ) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Next states, rewards and whether the task ends there, as of a task's `step`."""
        after, reward = np.empty_like(states), np.empty(len(states))
        ended, chosen = np.empty(len(states), bool), np.asarray(actions)
        for number, model in enumerate(self._actions):
            which = np.flatnonzero(chosen == number)
            if len(which):
                here = states[which]
                nearest = model.tree.query(self._places(here))[1]
                offsets = self._between(model.points[nearest], here)
                fits = model.fits[nearest]
                found = fits[:, 0] + np.einsum("nd,ndt->nt", offsets, fits[:, 1:])
                after[which] = self._wrapped(here + found[:, :-2] * self._scales)
                reward[which] = np.clip(found[:, -2], *self._rewards)
                ended[which] = found[:, -1] > 0.5
        return after, reward, ended

    def _fit(self, rows: Transitions) -> _Action:
        """Regressions around the samples of an action, or every so many of them."""
        places = self._places(rows.state)
        around = np.arange(0, len(rows), -(-len(rows) // MOST))
        k = min(NEIGHBOURS, len(rows))
        distances, near = KDTree(places).query(places[around], k)
        steps = self._between(rows.state, rows.next_state)
        targets = np.column_stack([steps, rows.reward, rows.terminated])
        offsets = self._between(np.repeat(rows.state[around, None], k, 1), rows.state[near])
        fits = regress(offsets, targets[near], weights(distances, TAU))
        return _Action(rows.state[around], KDTree(places[around]), fits)

    def _places(self, states: Array) -> Array:
        return flat(states, 1.0 / self._scales, self._periods)

    def _between(self, first: Array, second: Array) -> Array:
        """From one state to another, in ranges, the short way round."""
        apart = second - first
        turns = self._periods[self._wraps]
        apart[..., self._wraps] -= turns * np.round(apart[..., self._wraps] / turns)
        found: Array = apart / self._scales
        return found

    def _wrapped(self, states: Array) -> Array:
        turns, wraps = self._periods[self._wraps], self._wraps
        inside = np.clip(states, *self._limits)
        inside[:, wraps] = (states[:, wraps] - self._lowest) % turns + self._lowest
        return inside
