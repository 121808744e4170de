"""LSTD-Q in the directions that the samples tell apart: many times smaller than the functions.

Γ of an action has few eigenvalues that are not tiny beside δ. In the eigenvectors v of the
others, w = Σ u v, the part of a solution left out is less than `CUT` of itself, and Γ is a
diagonal. Products and solves are then of the eigenvectors' number, and with a large grid an
update takes a fraction of its time.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.lspi import Actions, Features, greedy
from iolspi_ros.core.moments import groups
from iolspi_ros.core.samples import Transitions
from iolspi_ros.core.solve import Solve, solve_system

Array = NDArray[np.float64]

CUT = 1e-3
"""Eigenvalues of Γ below so much of δ are left out."""


class ReducedSystem:
    """The same answers as `lspi.BlockSystem`, to about `CUT`.

    Parameters
    ----------
    transitions, features, n_actions, gamma, weight, among
        As of `lspi.BlockSystem`.
    share : float
        The smallest δ that will be solved with, in units of `scale`.

    Attributes
    ----------
    scale : float
        Of Γ: its trace over its effective rank (tr Γ)² / tr Γ², so tr Γ² / tr Γ.
    delta : float
        δ of Γ₀ = δI; may be changed between policies.
    """

    def __init__(
        self,
        transitions: Transitions,
        features: Features,
        n_actions: int,
        gamma: float,
        weight: Array,
        share: float,
        among: NDArray[np.bool_] | None = None,
    ) -> None:
        self.gamma, self.among, self.action = gamma, among, transitions.action
        phi = features(transitions.state)
        self.next_phi = features(transitions.next_state, transitions.terminated)
        rows = [np.flatnonzero(self.action == a) for a in range(n_actions)]
        found = [np.linalg.eigh((phi[r] * weight[r, None]).T @ phi[r]) for r in rows]
        trace = float(sum(values.sum() for values, _ in found))
        square = float(sum((values * values).sum() for values, _ in found))
        self.scale = square / trace if trace > 0.0 else 1.0
        self.delta = share * self.scale
        kept = [values > CUT * self.delta for values, _ in found]
        self.directions = [v[:, k] for (_, v), k in zip(found, kept, strict=True)]
        # Each sample's own features in its action's directions, times its weight.
        self.own = [
            (phi[r] * weight[r, None]) @ v for r, v in zip(rows, self.directions, strict=True)
        ]
        self.place = np.empty(len(self.action), np.int64)
        for r in rows:
            self.place[r] = np.arange(len(r))
        self.target = np.concatenate(
            [own.T @ transitions.reward[r] for own, r in zip(self.own, rows, strict=True)]
        )
        # The next states' features in each action's directions, filled in as they are asked for.
        self.next_own = [np.empty((len(self.action), v.shape[1])) for v in self.directions]
        self._known = np.zeros((n_actions, len(self.action)), bool)
        edges = [0, *accumulate(v.shape[1] for v in self.directions)]
        self._spans = [slice(*pair) for pair in pairwise(edges)]
        self._gram = np.concatenate([v[k] for (v, _), k in zip(found, kept, strict=True)])
        self._cross = np.zeros((edges[-1], edges[-1]))
        self._last: Actions | None = None

    def policy(self, weights: Array) -> Actions:
        """Greedy actions in the next states, shape (n_samples,)."""
        return greedy(weights, self.next_phi, among=self.among)

    def values(self, weights: Array) -> Array:
        """Q̂ in the next states, shape (n_samples, n_actions)."""
        return self.next_phi @ weights.T

    def evaluate(self, policy: Actions) -> Solve:
        """Weights of a policy; only samples whose next action changed are moved."""
        last, every = self._last, np.arange(len(policy))
        moved = every if last is None else np.flatnonzero(policy != last)
        if last is None or 2 * len(moved) > len(policy):
            self._cross[:] = 0.0
            moved = every
        else:
            self._add(moved, last, -1.0)
        self._add(moved, policy, 1.0)
        self._last = policy
        matrix = np.diag(self._gram + self.delta) - self.gamma * self._cross
        found = solve_system(matrix, self.target)
        pairs = zip(self.directions, self._spans, strict=True)
        weights = np.stack([v @ found.weights[s] for v, s in pairs])
        # Along directions left out, δI alone stands in for Γ - γΛ.
        return replace(found, weights=weights, rank=found.rank + weights.size - len(self.target))

    def _add(self, rows: NDArray[np.int64], policy: Actions, sign: float) -> None:
        """Add Σ w φφ'ᵀ to Λ, in the directions of each action on either side."""
        pair = self.action[rows] * len(self.directions) + policy[rows]
        order = np.argsort(pair, kind="stable")
        for ab, span in groups(pair[order]):
            a, b = divmod(ab, len(self.directions))
            chosen = rows[order[span]]
            new = chosen[~self._known[b, chosen]]
            self.next_own[b][new] = self.next_phi[new] @ self.directions[b]
            self._known[b, new] = True
            left = self.own[a][self.place[chosen]]
            self._cross[self._spans[a], self._spans[b]] += sign * (
                left.T @ self.next_own[b][chosen]
            )
