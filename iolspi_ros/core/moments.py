"""Γ, Λ and z: what the samples say, in a size that does not depend on their number."""

from __future__ import annotations

from dataclasses import dataclass

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
        return cls(gram, np.zeros((n_actions, size, n_actions, size)), np.zeros((n_actions, size)))

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
    gram, vector = _gram(moments, phi, action, reward, forget_factor)
    cross = accumulate_cross(moments.cross, phi, action, next_phi, next_action, forget_factor)
    n, eta = len(phi), forget_factor
    added = float(n) if eta == 1.0 else eta * (1.0 - eta**n) / (1.0 - eta)
    return Moments(gram, cross, vector, moments.n_samples + n, eta**n * moments.weight + added)


def accumulate_cross(
    cross: Array,
    phi: Array,
    action: NDArray[np.int64],
    next_phi: Array,
    next_action: NDArray[np.int64],
    forget_factor: float = 1.0,
) -> Array:
    """Add a batch to Λ alone, the one part that depends on the policy.

    Returns
    -------
    ndarray of shape (n_actions, size, n_actions, size)
    """
    weighted = phi * _weights(len(phi), forget_factor)[:, None]
    cross = cross * forget_factor ** len(phi)
    for a in np.unique(action):
        for b in np.unique(next_action[action == a]):
            rows = (action == a) & (next_action == b)
            cross[a, :, b, :] += weighted[rows].T @ next_phi[rows]
    return cross


def forget_factor_for(samples: float, left: float = 0.01) -> float:
    """η that leaves a sample the share `left` of its weight after `samples` more.

    T Eqs. 17 and 9-13 take 1 %. The numbers of T Table 9-1 are those for 10 %.
    """
    check_range("samples", samples, 0.0, np.inf, low_open=True)
    check_range("left", left, 0.0, 1.0, low_open=True)
    return float(left ** (1.0 / samples))


def _weights(n: int, forget_factor: float) -> Array:
    return forget_factor ** np.arange(n - 1, -1, -1, dtype=np.float64)


def _gram(
    moments: Moments,
    phi: Array,
    action: NDArray[np.int64],
    reward: Array,
    forget_factor: float,
) -> tuple[Array, Array]:
    weighted = phi * _weights(len(phi), forget_factor)[:, None]
    kept = forget_factor ** len(phi)
    gram, vector = moments.gram * kept, moments.reward * kept
    for a in np.unique(action):
        rows = action == a
        gram[a] += weighted[rows].T @ phi[rows]
        vector[a] += weighted[rows].T @ reward[rows]
    return gram, vector
