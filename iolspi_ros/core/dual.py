"""LSTD-Q with one unknown for each sample: for more functions than samples.

The weights that solve (Φᵀ W (Φ - γΦ') + δI) w = Φᵀ W r are a sum of the samples' own features,
w = Φᵀα, so that α solves (K - γK' + δ W⁻¹) α = r with K = ΦΦᵀ and K' = Φ'Φᵀ: as many unknowns
as samples, whatever the number of functions. Γ and Λ are never built.
Nothing is approximated.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.lspi import Actions
from iolspi_ros.core.samples import Transitions
from iolspi_ros.core.solve import Solve, solve_system

Array = NDArray[np.float64]

CHUNK = 512
"""Samples whose features are evaluated at a time."""


class DualSystem:
    """The same answers as `lspi.BlockSystem`, from matrices of samples by samples.

    Parameters
    ----------
    transitions, n_actions, gamma, weight, delta, among
        As of `lspi.BlockSystem`; δ must be positive when it is solved.
    basis : Basis
    """

    def __init__(
        self,
        transitions: Transitions,
        basis: Basis,
        n_actions: int,
        gamma: float,
        weight: Array,
        delta: float,
        among: NDArray[np.bool_] | None = None,
    ) -> None:
        self.among = among
        self.basis, self.n_actions, self.gamma, self.delta = basis, n_actions, gamma, delta
        self.transitions, self.weight = transitions, np.maximum(weight, 1e-12)
        self.action = transitions.action
        self._kernel = basis.inner(transitions.state, transitions.state)
        self._next_kernel = basis.inner(transitions.next_state, transitions.state)
        self._next_kernel[transitions.terminated] = 0.0

    def _chunks(self, states: Array) -> Iterator[tuple[slice, Array]]:
        for first in range(0, len(states), CHUNK):
            rows = slice(first, first + CHUNK)
            yield rows, self.basis(states[rows])

    def policy(self, weights: Array) -> Actions:
        """Greedy actions in the next states, shape (n_samples,)."""
        q = self.values(weights)
        if self.among is not None:
            q = np.where(self.among, q, -np.inf)
        return q.argmax(axis=1)

    def values(self, weights: Array) -> Array:
        """Q̂ in the next states, zero where nothing follows, shape (n_samples, n_actions)."""
        q = np.empty((len(self.action), self.n_actions))
        for rows, phi in self._chunks(self.transitions.next_state):
            q[rows] = phi @ weights.T
        q[self.transitions.terminated] = 0.0
        return q

    def _combine(self, coefficients: Array) -> Array:
        """Σ_i α_i φ(s_i) of each action, shape (n_actions, size)."""
        weights = np.zeros((self.n_actions, self.basis.size))
        for rows, phi in self._chunks(self.transitions.state):
            for a in range(self.n_actions):
                chosen = self.action[rows] == a
                weights[a] += coefficients[rows][chosen] @ phi[chosen]
        return weights

    def evaluate(self, policy: Actions) -> Solve:
        """Weights of a policy given by its actions in the next states."""
        matrix = np.where(policy[:, None] == self.action, -self.gamma * self._next_kernel, 0.0)
        np.add(matrix, self._kernel, out=matrix, where=self.action[:, None] == self.action)
        matrix[np.diag_indices_from(matrix)] += self.delta / self.weight
        found = solve_system(matrix, self.transitions.reward)
        # Along functions that no sample has a part in, δI alone is left of Γ - γΛ.
        rank = found.rank + self.n_actions * self.basis.size - len(policy)
        weights = self._combine(found.weights)
        return replace(found, weights=weights, rank=rank)

    @cached_property
    def scale(self) -> float:
        """Scale of Γ: tr Γ² / tr Γ, as of `BlockSystem`."""
        trace = float(self.weight @ np.diag(self._kernel))
        square = 0.0
        for a in range(self.n_actions):
            rows = np.flatnonzero(self.action == a)
            part = self._kernel[np.ix_(rows, rows)]
            square += float(self.weight[rows] @ (part * part) @ self.weight[rows])
        return square / trace if trace > 0.0 else 1.0
