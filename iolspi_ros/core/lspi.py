"""LSTD-Q and offline least-squares policy iteration (T Algorithm 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.moments import Moments, accumulate, accumulate_cross
from iolspi_ros.core.samples import Transitions

Array = NDArray[np.float64]

RESIDUAL_LIMIT = 1e-6
"""Relative residual above which a solve is not believed."""


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
    status : {"ok", "singular", "inaccurate", "non-finite"}
        "singular" weights are the least-squares solution of least norm.
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
    order = moments.n_actions * moments.size
    scale = moments.scale(scaling)
    matrix = (-gamma / scale) * moments.cross
    for a in range(moments.n_actions):
        matrix[a, :, a, :] += moments.gram[a] / scale
    matrix = matrix.reshape(order, order)
    target = moments.reward.ravel() / scale
    if not (np.isfinite(matrix).all() and np.isfinite(target).all()):
        weights = np.full((moments.n_actions, moments.size), np.nan)
        return Solve(weights, np.inf, 0, np.inf, "non-finite")

    factors, pivots, failed = lapack.dgetrf(matrix.T, overwrite_a=False)
    reciprocal = 0.0
    if failed == 0:
        norm = float(np.abs(matrix).sum(axis=1).max())  # 1-norm of the transpose
        reciprocal = float(lapack.dgecon(factors, norm, norm="1")[0])
    rank, status = order, "ok"
    if reciprocal > order * np.finfo(float).eps:
        weights = lapack.dgetrs(factors, pivots, target, trans=1)[0]
    else:
        weights, _, found, _ = np.linalg.lstsq(matrix, target, rcond=None)
        rank = int(found)
        status = "singular" if rank < order else "ok"
    residual = float(np.linalg.norm(matrix @ weights - target))
    residual /= float(np.linalg.norm(target)) or 1.0
    if not np.isfinite(weights).all():
        status = "non-finite"
    elif status == "ok" and not residual <= RESIDUAL_LIMIT:
        status = "inaccurate"
    condition = 1.0 / reciprocal if reciprocal > 0.0 else np.inf
    shaped: Array = np.reshape(weights, (moments.n_actions, moments.size))
    return Solve(shaped, condition, rank, residual, status)


def greedy(weights: Array, phi: Array, rng: np.random.Generator | None = None) -> NDArray[np.int64]:
    """Action with the largest Q̂(s, a) = φᵀ(s) w_a (T Eqs. 6, 7).

    Parameters
    ----------
    weights : ndarray of shape (n_actions, size)
    phi : ndarray of shape (n_samples, size)
    rng : numpy.random.Generator, optional
        Breaks exact ties at random; without it the first action wins.

    Returns
    -------
    ndarray of int, shape (n_samples,)
    """
    q = phi @ weights.T
    chosen = q.argmax(axis=1)
    if rng is not None:
        best = q == q[np.arange(len(q)), chosen][:, None]
        if np.count_nonzero(best) > len(q):
            for row in np.flatnonzero(best.sum(axis=1) > 1):
                chosen[row] = rng.choice(np.flatnonzero(best[row]))
    return chosen


@dataclass(frozen=True)
class OfflineResult:
    """What offline LSPI found, and how it stopped.

    Attributes
    ----------
    solve : Solve
        The last solve; its weights are the policy.
    moments : Moments
        Γ, z, and the Λ that the last weights were solved from.
    iterations : int
    stop : {"converged", "cap", "oscillating", "diverging", "interrupted"}
        "oscillating": the policy on the samples is one that was there before, and not the
        last one, so the iterations would repeat for ever.
    period : int
        Length of that cycle, 0 when there is none.
    changes : tuple of float
        ‖w_l - w_{l+1}‖ of each iteration.
    """

    solve: Solve
    moments: Moments
    iterations: int
    stop: str
    period: int
    changes: tuple[float, ...]

    def describe(self) -> str:
        """One line for a person."""
        text = f"offline LSPI: {self.stop} after {self.iterations} iterations"
        if self.period:
            text += f" (a cycle of {self.period} policies)"
        if self.changes:
            text += f", last change of the weights {self.changes[-1]:.3g}"
        return f"{text}; solve {self.solve.status}, condition {self.solve.condition:.1e}"


def offline_lspi(
    transitions: Transitions,
    features: RBFGrid,
    n_actions: int,
    *,
    gamma: float,
    delta: float,
    chi: float,
    max_iterations: int,
    weights: Array,
    scaling: str = "samples",
    forget_factor: float = 1.0,
    proceed: Callable[[int, float], bool] = lambda iteration, change: True,
) -> OfflineResult:
    """Iterate policies on one fixed set of samples (T Algorithm 1).

    Parameters
    ----------
    transitions : Transitions
        D, with finite numbers and known actions.
    features : RBFGrid
        φ.
    n_actions : int
    gamma : float in [0, 1)
    delta : float
        δ of Γ₀ = δI.
    chi : float
        χ: stop when ‖w_l - w_{l+1}‖ is below it.
    max_iterations : int
        l_max.
    weights : ndarray of shape (n_actions, size)
        w₀, the first policy.
    scaling, forget_factor
        As in `solve` and `accumulate`; T forgets nothing here (η = 1).
    proceed : callable
        Called after each iteration with its number and ‖Δw‖; a false answer ends the loop.

    Returns
    -------
    OfflineResult
    """
    phi = features(transitions.state)
    next_phi = features(transitions.next_state, transitions.terminated)
    start = Moments.empty(n_actions, features.size, delta)
    action, reward = transitions.action, transitions.reward
    policy = greedy(weights, next_phi)
    moments = accumulate(start, phi, action, reward, next_phi, policy, forget_factor)
    seen: dict[bytes, int] = {}
    changes: list[float] = []
    stop, period = "cap", 0
    solution = solve(moments, gamma, scaling)
    for iteration in range(1, max_iterations + 1):
        changes.append(float(np.linalg.norm(solution.weights - weights)))
        weights = solution.weights
        key = policy.tobytes()
        if solution.status == "non-finite":
            stop = "diverging"
        elif changes[-1] <= chi:
            stop = "converged"
        elif key in seen and seen[key] < iteration - 1:
            stop, period = "oscillating", iteration - seen[key]
        elif not proceed(iteration, changes[-1]):
            stop = "interrupted"
        if stop != "cap" or iteration == max_iterations:
            break
        seen[key] = iteration
        policy = greedy(weights, next_phi)
        cross = accumulate_cross(start.cross, phi, action, next_phi, policy, forget_factor)
        moments = Moments(moments.gram, cross, moments.reward, moments.n_samples, moments.weight)
        solution = solve(moments, gamma, scaling)
    return OfflineResult(solution, moments, len(changes), stop, period, tuple(changes))
