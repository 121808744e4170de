"""Which of several policies is best, told from samples alone.

A policy is tried out on a one-step prediction that is fitted to the samples, from where
episodes began. Where nothing was seen the prediction stands still and costs nothing, so that
with rewards that are costs an unknown region looks good until somebody has been there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from iolspi_ros.core.features import Basis, Table, evaluate
from iolspi_ros.core.lspi import System
from iolspi_ros.core.samples import Transitions

Array = NDArray[np.float64]

RIDGE = 1e-3
"""Of the prediction's regression, in weights of a sample."""
HORIZON_SHARE = 0.0025
"""A return is followed until γ^k is this small."""
FEW_STARTS = 6
"""Starts from which every policy is tried; the best `FINALISTS` are tried from all."""
FINALISTS = 8
MARGIN = 0.002
"""Policies whose predicted returns differ by less are told apart by their later part."""
FAR_OFF = 10.0
"""|Q̂| beyond so many times the largest possible return is not believed."""


@dataclass(frozen=True)
class Prediction:
    """What an action leads to, by least squares on the samples' features.

    Attributes
    ----------
    basis : Basis
    weights : ndarray of shape (n_actions, n_dims + 2, size)
        Of the change of the state, the reward, and the end of the task.
    low, high : ndarray of shape (n_dims,)
        Limits of the states seen and of the basis.
    period : ndarray of shape (n_dims,)
        After which a variable repeats; 0 for never.
    """

    basis: Basis
    weights: Array
    low: Array
    high: Array
    period: Array

    def returns(self, policy: Array, starts: Array, gamma: float) -> Array:
        """Predicted discounted returns of a greedy policy.

        Parameters
        ----------
        policy : ndarray of shape (n_actions, size)
            Its weights.
        starts : ndarray of shape (n_starts, n_dims)
        gamma : float

        Returns
        -------
        ndarray of shape (2,)
            Means of the return from each start, and of that from its last third on.
        """
        starts, times = np.unique(starts, axis=0, return_counts=True)
        horizon = max(int(np.log(HORIZON_SHARE) / np.log(gamma)), 1) if gamma > 0.0 else 1
        found: Array = _returns(
            self.basis.table, policy, self.weights, self.low, self.high, self.period,
            starts, times / times.sum(), gamma, horizon,
        )  # fmt: skip
        return np.where(np.isfinite(found), found, -np.inf)


class SampleSystem(System, Protocol):
    """A system that can also predict."""

    def regress(self, target: Array, ridge: float) -> Array:
        """Weights that predict targets from φ(s, a)."""
        ...


def fit(system: SampleSystem, transitions: Transitions, basis: Basis) -> Prediction:
    """Fit a prediction to the samples of a system, weighted as they are there.

    Parameters
    ----------
    system : SampleSystem
    transitions : Transitions
        The same samples.
    basis : Basis

    Returns
    -------
    Prediction
    """
    period = basis.table.periods
    change = transitions.next_state - transitions.state
    change -= period * np.round(change / np.where(period > 0.0, period, 1.0))
    target = np.column_stack([change, transitions.reward, transitions.terminated])
    weights = system.regress(target, RIDGE)
    seen = np.concatenate([transitions.state, transitions.next_state, [basis.low, basis.high]])
    return Prediction(basis, weights, seen.min(axis=0), seen.max(axis=0), period)


def plausible(q: Array, reward: Array, gamma: float) -> bool:
    """Whether values are not far beyond what such rewards can add up to.

    Parameters
    ----------
    q : ndarray
        Q̂ of some samples.
    reward : ndarray
        Rewards of those samples.
    gamma : float in [0, 1)
    """
    most = float(np.abs(reward).max(initial=0.0)) / (1.0 - gamma)
    if not np.isfinite(most):
        return False
    return bool(np.abs(q).max(initial=0.0) <= FAR_OFF * most or most == 0.0)


def compare(
    prediction: Prediction, policies: Sequence[Array], starts: Array, gamma: float
) -> Array:
    """Predicted returns of several policies.

    All are followed from a few of the starts; from all of them only the first, which is in
    use, and those that did best. The others cannot win.

    Parameters
    ----------
    prediction : Prediction
    policies : sequence of ndarray of shape (n_actions, size)
    starts : ndarray of shape (n_starts, n_dims)
    gamma : float

    Returns
    -------
    ndarray of shape (n_policies, 2)
        As from `Prediction.returns`, and -inf for those that cannot win.
    """
    few = np.unique(starts, axis=0)
    few = few[:: max(len(few) // FEW_STARTS, 1)]
    first = np.array([prediction.returns(policy, few, gamma) for policy in policies])
    finalists = {0, *np.argsort(-first[:, 0], kind="stable")[:FINALISTS].tolist()}
    returns = np.full((len(policies), 2), -np.inf)
    for number in finalists:
        returns[number] = prediction.returns(policies[number], starts, gamma)
    return returns


def best(returns: Array) -> int:
    """Number of the best policy; ties by a margin are decided by the later part.

    Parameters
    ----------
    returns : ndarray of shape (n_policies, 2)
        As from `compare`.
    """
    early, late = returns.T
    top = early.max()
    close = early >= top - MARGIN * abs(top)
    return int(np.argmax(np.where(close, late, -np.inf)))


@njit(cache=True, fastmath={"reassoc", "contract"})  # sums in any order: several times faster
def _returns(
    table: Table, policy: Array, prediction: Array, low: Array, high: Array, period: Array,
    starts: Array, share: Array, gamma: float, horizon: int,
) -> Array:  # fmt: skip
    n_dims = starts.shape[1]
    factors, phi = np.empty(table.counts.sum()), np.empty(policy.shape[1])
    state, following = np.empty(n_dims), np.empty(n_dims + 2)
    total = np.zeros(2)
    for start in range(len(starts)):
        state[:] = starts[start]
        early, late = share[start], 0.0
        for step in range(horizon):
            if 3 * step >= 2 * horizon and late == 0.0:
                late = share[start]
            evaluate(table, state, factors, phi)
            chosen, most = 0, -np.inf
            for a in range(len(policy)):
                q = 0.0
                for k in range(len(phi)):
                    q += policy[a, k] * phi[k]
                if q > most:
                    chosen, most = a, q
            for i in range(n_dims + 2):
                value = 0.0
                for k in range(len(phi)):
                    value += prediction[chosen, i, k] * phi[k]
                following[i] = value
            total[0] += early * following[n_dims]
            total[1] += late * following[n_dims]
            left = gamma * (1.0 - min(max(following[n_dims + 1], 0.0), 1.0))
            early *= left
            late *= left
            if early <= HORIZON_SHARE * share[start]:
                break
            for d in range(n_dims):
                moved = state[d] + following[d]
                if period[d] > 0.0:
                    moved -= period[d] * np.floor((moved - low[d]) / period[d])
                else:
                    moved = min(max(moved, low[d]), high[d])
                state[d] = moved
    return total
