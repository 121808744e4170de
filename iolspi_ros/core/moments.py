"""Γ, Λ and z: what the samples say, in a size that does not depend on their number."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import check_choice, check_range

Array = NDArray[np.float64]

SCALINGS = ("samples", "weights")


@dataclass(frozen=True)
class Moments:
    """The matrices of T Eq. 9, in blocks by action.

    Attributes
    ----------
    gram : ndarray of shape (n_actions, size, size)
        Γ. Block-diagonal: samples of different actions share no function.
    cross : ndarray of shape (n_actions, size, n_actions, size)
        Λ. Indexed by the action taken and the action that the policy takes next.
    reward : ndarray of shape (n_actions, size)
        z.
    n_samples : int
        Number of samples that went in, n_s.
    weight : float
        Sum of η^i for i = 1 … n_s, the scale of T Eq. 9-15.
    """

    gram: Array
    cross: Array
    reward: Array
    n_samples: int = 0
    weight: float = 0.0

    @classmethod
    def empty(cls, n_actions: int, size: int, delta: float = 0.0) -> Moments:
        """Before any sample: Γ = δI, Λ = 0, z = 0 (T Algorithm 1, line 2)."""
        gram = np.zeros((n_actions, size, size))
        gram[:, np.arange(size), np.arange(size)] = delta
        cross = np.zeros((n_actions, size, n_actions, size))
        return cls(gram, cross, np.zeros((n_actions, size)))

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return self.reward.shape[0]

    @property
    def size(self) -> int:
        """Number of functions of a state."""
        return self.reward.shape[1]

    def scale(self, scaling: str) -> float:
        """Factor that divides Γ, Λ and z before a solve.

        "samples" is n_s (T Eqs. 13 and 9-14), "weights" the sum of η^i (T Eq. 9-15; the n_s
        beside its Λ is taken as a misprint, since it would change the solution).
        """
        check_choice("scaling", scaling, SCALINGS)
        return max(float(self.n_samples) if scaling == "samples" else self.weight, 1e-300)


def accumulate(
    moments: Moments,
    phi: Array,
    action: NDArray[np.int64],
    reward: Array,
    next_phi: Array,
    next_action: NDArray[np.int64],
    forget_factor: float = 1.0,
) -> Moments:
    """Add a batch of samples, oldest first, as if one after the other.

    Γ ← ηΓ + φφᵀ, Λ ← ηΛ + φφ'ᵀ, z ← ηz + φr (T Eqs. 9-10 to 9-12; Eqs. 10 to 12 for η = 1),
    unrolled over the batch: sample k of n keeps η^(n-1-k).

    Parameters
    ----------
    moments : Moments
        Left unchanged.
    phi, next_phi : ndarray of shape (n_samples, size)
        φ(s_k), and φ(s_{k+1}) with zero rows where the task ended.
    action, next_action : ndarray of int, shape (n_samples,)
        a_k, and the policy's action in s_{k+1}.
    reward : ndarray of shape (n_samples,)
    forget_factor : float in (0, 1]
        η.

    Returns
    -------
    Moments
    """
    n, eta = len(phi), forget_factor
    weight, kept = fading(n, eta), eta**n
    grown = Moments(
        moments.gram * kept,
        moments.cross * kept,
        moments.reward * kept,
        moments.n_samples + n,
        kept * moments.weight + (float(n) if eta == 1.0 else eta * (1.0 - kept) / (1.0 - eta)),
    )
    add_gram(grown, phi, action, reward, weight)
    add_cross(grown.cross, phi, action, next_phi, next_action, weight)
    return grown


def fading(n: int, forget_factor: float) -> Array:
    """Weight of each of n samples, oldest first: the last one counts 1 (T Eqs. 9-10 to 9-12)."""
    return forget_factor ** np.arange(n - 1, -1, -1, dtype=np.float64)


def add_gram(
    moments: Moments, phi: Array, action: NDArray[np.int64], reward: Array, weight: Array
) -> None:
    """Add Σ w φφᵀ to Γ and Σ w φr to z, in place."""
    order = np.argsort(action, kind="stable")
    phi, weighted = _sorted(phi, weight, order)
    reward = reward[order]
    for a, rows in groups(action[order]):
        moments.gram[a] += weighted[rows].T @ phi[rows]
        moments.reward[a] += weighted[rows].T @ reward[rows]


def add_cross(
    cross: Array,
    phi: Array,
    action: NDArray[np.int64],
    next_phi: Array,
    next_action: NDArray[np.int64],
    weight: Array,
) -> None:
    """Add Σ w φφ'ᵀ to Λ, in place: the one part that depends on the policy."""
    pair = action * len(cross) + next_action
    order = np.argsort(pair, kind="stable")
    _, weighted = _sorted(phi, weight, order)
    next_phi = next_phi[order]
    for ab, rows in groups(pair[order]):
        a, b = divmod(ab, len(cross))
        cross[a, :, b, :] += weighted[rows].T @ next_phi[rows]


def move_cross(
    cross: Array,
    phi: Array,
    action: NDArray[np.int64],
    next_phi: Array,
    before: NDArray[np.int64],
    after: NDArray[np.int64],
    weight: Array,
) -> None:
    """Take samples whose next action changed from its block of Λ to that after, in place."""
    n_actions, moved = len(cross), np.flatnonzero(before != after)
    way = (action[moved] * n_actions + before[moved]) * n_actions + after[moved]
    by_way = np.argsort(way, kind="stable")
    order = moved[by_way]
    _, weighted = _sorted(phi, weight, order)
    next_phi = next_phi[order]
    for key, rows in groups(way[by_way]):
        ab, c = divmod(key, n_actions)
        a, b = divmod(ab, n_actions)
        product = weighted[rows].T @ next_phi[rows]
        cross[a, :, b, :] -= product
        cross[a, :, c, :] += product


def _sorted(phi: Array, weight: Array, order: NDArray[np.int64]) -> tuple[Array, Array]:
    """φ in an order, as it is and weighted; one array when no weight differs from 1."""
    phi, weight = phi[order], weight[order]
    return phi, phi if (weight == 1.0).all() else phi * weight[:, None]


def groups(key: NDArray[np.int64]) -> Iterator[tuple[int, slice]]:
    """Where each value of a sorted key stands."""
    cuts = np.flatnonzero(np.diff(key)) + 1
    for first, last in pairwise([0, *cuts.tolist(), len(key)]):
        if last > first:
            yield int(key[first]), slice(first, last)


def forget_factor_for(samples: float, left: float = 0.01) -> float:
    """η that leaves a sample the share `left` of its weight after `samples` more.

    T Eqs. 17 and 9-13 take 1 %. The numbers of T Table 9-1 are those for 10 %.
    """
    check_range("samples", samples, 0.0, np.inf, low_open=True)
    check_range("left", left, 0.0, 1.0, low_open=True)
    return float(left ** (1.0 / samples))
