"""LSTD-Q: one linear system for the weights of a policy, and how far to believe its solution."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.moments import Moments

Array = NDArray[np.float64]

STATUSES = ("ok", "singular", "ill-conditioned", "inaccurate", "non-finite", "diverging")
"""What a solve can be; all but the first are unhealthy."""
CONDITION_LIMIT = 1e12
"""Condition number above which too few digits are left to believe a solve."""
RESIDUAL_LIMIT = 1e-6
"""Relative residual above which a solve is not believed."""
FAR_OFF = 10.0
"""|Q̂| beyond so many times the largest possible return is not believed."""


@dataclass(frozen=True)
class Solve:
    """Weights of one LSTD-Q solve, and how far to believe them.

    Attributes
    ----------
    weights : ndarray of shape (n_actions, size)
    condition : float
        Estimated condition number of (Γ - γΛ)/n_s in the 1-norm; inf when singular.
    rank : int
        Numerical rank, at most n_actions * size.
    residual : float
        ‖Mw - b‖ / ‖b‖ (or ‖Mw‖ when b is zero).
    status : str
        One of `STATUSES`. "singular" weights are the least-squares solution of least norm.
        "diverging" is found by whoever knows the rewards: see `plausible`.
    """

    weights: Array
    condition: float
    rank: int
    residual: float
    status: str

    @property
    def healthy(self) -> bool:
        """Whether the weights may replace those in use."""
        return self.status == "ok"


def system_matrix(moments: Moments, gamma: float, scaling: str = "samples") -> tuple[Array, Array]:
    """(Γ - γΛ) and z over the scale (T Eqs. 9, 13), shapes (order, order) and (order,)."""
    order = moments.n_actions * moments.size
    scale = moments.scale(scaling)
    matrix = (-gamma / scale) * moments.cross
    for a in range(moments.n_actions):
        matrix[a, :, a, :] += moments.gram[a] / scale
    return matrix.reshape(order, order), moments.reward.ravel() / scale


def solve(moments: Moments, gamma: float, scaling: str = "samples") -> Solve:
    """Weights w of the policy whose actions are in Λ: Γw = z + γΛw (T Eqs. 9, 13).

    Parameters
    ----------
    moments : Moments
    gamma : float in [0, 1)
        Discount factor.
    scaling : {"samples", "weights"}
        Divisor of both sides (T Eqs. 9-14, 9-15).

    Returns
    -------
    Solve
    """
    last = np.array([not block.any() for block in moments.cross])
    if last.any() and not last.all():
        found = _in_turn(moments, last, gamma, scaling)
        if found.healthy:
            return found
    found = solve_system(*system_matrix(moments, gamma, scaling))
    return replace(found, weights=found.weights.reshape(moments.reward.shape))


def _in_turn(moments: Moments, last: NDArray[np.bool_], gamma: float, scaling: str) -> Solve:
    """Weights of the `last` actions, after which nothing follows, and then of the others.

    Rows of Λ of an action that always ends the task are zero, so that its weights need nothing
    of the others'; and order cubed is what a solve costs.
    """
    scale, rest, size = moments.scale(scaling), ~last, moments.size
    parts = [
        solve_system(moments.gram[a] / scale, moments.reward[a] / scale)
        for a in np.flatnonzero(last)
    ]
    weights = np.empty_like(moments.reward)
    weights[last] = [part.weights for part in parts]
    into = moments.cross[rest]
    known = into[:, :, last].reshape(rest.sum() * size, -1) @ weights[last].ravel()
    reward = moments.reward[rest] + gamma * known.reshape(-1, size)
    left = replace(moments, gram=moments.gram[rest], cross=into[:, :, rest], reward=reward)
    parts.append(solve_system(*system_matrix(left, gamma, scaling)))
    weights[rest] = parts[-1].weights.reshape(-1, size)
    worst = max(parts, key=lambda part: STATUSES.index(part.status))
    return Solve(
        weights,
        max(part.condition for part in parts),
        sum(part.rank for part in parts),
        max(part.residual for part in parts),
        worst.status,
    )


@cached_njit(nogil=True)
def _norm(matrix: Array) -> float:
    """Largest sum of a row's magnitudes: the 1-norm of the transpose."""
    most = 0.0
    for row in matrix:
        total = 0.0
        for value in row:
            total += abs(value)
        if not total <= most:  # keeps a NaN
            most = total
    return most


def solve_system(matrix: Array, target: Array) -> Solve:
    """Solve Mw = b and say how far to believe it.

    Parameters
    ----------
    matrix : ndarray of shape (order, order)
    target : ndarray of shape (order,)

    Returns
    -------
    Solve
        Whose weights have shape (order,).
    """
    order = len(target)
    norm = _norm(matrix)
    if not (np.isfinite(norm) and np.isfinite(target).all()):
        return Solve(np.full(order, np.nan), np.inf, 0, np.inf, "non-finite")
    factors, pivots, failed = lapack.dgetrf(matrix.T, overwrite_a=False)
    reciprocal = float(lapack.dgecon(factors, norm, norm="1")[0]) if failed == 0 else 0.0
    rank, status = order, "ok"
    if reciprocal > order * np.finfo(float).eps:
        weights = lapack.dgetrs(factors, pivots, target, trans=1)[0]
    else:
        weights, _, found, _ = np.linalg.lstsq(matrix, target, rcond=None)
        rank = int(found)
        status = "singular"
    residual = float(np.linalg.norm(matrix @ weights - target))
    residual /= float(np.linalg.norm(target)) or 1.0
    if not np.isfinite(weights).all():
        status = "non-finite"
    elif status == "ok" and reciprocal * CONDITION_LIMIT < 1.0:
        status = "ill-conditioned"
    elif status == "ok" and not residual <= RESIDUAL_LIMIT:
        status = "inaccurate"
    condition = 1.0 / reciprocal if reciprocal > 0.0 else np.inf
    return Solve(weights, condition, rank, residual, status)


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
