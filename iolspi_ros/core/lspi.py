"""LSTD-Q and offline least-squares policy iteration (T Algorithm 1)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import lapack

from iolspi_ros.core.moments import Moments, add_cross, add_gram
from iolspi_ros.core.samples import Transitions

Array = NDArray[np.float64]
Actions = NDArray[np.int64]

STATUSES = ("ok", "singular", "ill-conditioned", "inaccurate", "non-finite", "diverging")
"""What a solve can be; all but the first are unhealthy."""
CONDITION_LIMIT = 1e12
"""Condition number above which too few digits are left to believe a solve."""
RESIDUAL_LIMIT = 1e-6
"""Relative residual above which a solve is not believed."""


class Features(Protocol):
    """What policy iteration asks of φ."""

    @property
    def size(self) -> int:
        """Number of functions."""
        ...

    def __call__(self, states: Array, terminated: NDArray[np.bool_] | None = None) -> Array:
        """φ of some states, zero where nothing follows."""
        ...


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
        "diverging" is found by whoever knows the rewards: see `judge.plausible`.
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
    found = solve_system(*system_matrix(moments, gamma, scaling))
    return replace(found, weights=found.weights.reshape(moments.n_actions, moments.size))


@njit(cache=True)
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


def greedy(weights: Array, phi: Array, rng: np.random.Generator | None = None) -> Actions:
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


class System(Protocol):
    """LSTD-Q on one fixed set of samples, for one policy after the other."""

    def policy(self, weights: Array) -> Actions:
        """Greedy actions in the samples' next states, shape (n_samples,)."""
        ...

    def evaluate(self, policy: Actions) -> Solve:
        """Weights of a policy given by its actions in the next states."""
        ...


class BlockSystem:
    """Γ, Λ and z in blocks by action, solved densely: for more samples than functions.

    Only Λ depends on the policy, and from one policy to the next few actions change: only
    their samples are moved between its blocks.

    Parameters
    ----------
    transitions : Transitions
    features : Features
    n_actions : int
    gamma : float
    weight : ndarray of shape (n_samples,)
        How much each sample counts.
    delta : float
        δ of Γ₀ = δI; may be changed between policies.
    scaling : {"samples", "weights"}
    """

    def __init__(
        self,
        transitions: Transitions,
        features: Features,
        n_actions: int,
        gamma: float,
        weight: Array,
        delta: float,
        scaling: str = "samples",
    ) -> None:
        self.gamma, self.delta, self.scaling = gamma, delta, scaling
        self.phi = features(transitions.state)
        self.next_phi = features(transitions.next_state, transitions.terminated)
        self.action = transitions.action
        self.weight = weight
        empty = Moments.empty(n_actions, features.size)
        add_gram(empty, self.phi, self.action, transitions.reward, weight)
        self.gram, self.vector, self._cross = empty.gram, empty.reward, empty.cross
        self._last: Actions | None = None

    def policy(self, weights: Array) -> Actions:
        """Greedy actions in the next states, shape (n_samples,)."""
        return greedy(weights, self.next_phi)

    def values(self, weights: Array) -> Array:
        """Q̂ in the next states, shape (n_samples, n_actions)."""
        return self.next_phi @ weights.T

    def scale(self) -> float:
        """Scale of Γ: its trace over its effective rank (tr Γ)² / tr Γ², so tr Γ² / tr Γ."""
        trace = float(np.trace(self.gram, axis1=1, axis2=2).sum())
        return float((self.gram * self.gram).sum()) / trace if trace > 0.0 else 1.0

    def regress(self, target: Array, ridge: float) -> Array:
        """Weights that predict targets from φ(s, a), by ridge regression.

        Parameters
        ----------
        target : ndarray of shape (n_samples, n_targets)
        ridge : float

        Returns
        -------
        ndarray of shape (n_actions, n_targets, size)
        """
        n_actions, size = self.vector.shape
        weights = np.zeros((n_actions, target.shape[1], size))
        for a in range(n_actions):
            rows = self.action == a
            moment = (self.weight[rows, None] * self.phi[rows]).T @ target[rows]
            weights[a] = np.linalg.solve(self.gram[a] + ridge * np.eye(size), moment).T
        return weights

    def moments(self, policy: Actions) -> Moments:
        """Γ, Λ and z of a policy."""
        size = self.vector.shape[1]
        last = self._last
        moved = np.flatnonzero(policy != last) if last is not None else np.arange(len(policy))
        if last is None or 2 * len(moved) > len(policy):
            self._cross = np.zeros_like(self._cross)
            self._add(slice(None), policy, self.weight)
        elif len(moved):
            self._cross = self._cross.copy()  # the one before is somebody's
            self._add(moved, policy, self.weight)
            self._add(moved, last, -self.weight)
        self._last = policy
        gram = self.gram.copy()
        gram[:, np.arange(size), np.arange(size)] += self.delta
        mass = float(self.weight.sum())
        return Moments(gram, self._cross, self.vector, len(policy), mass, self.delta)

    def _add(self, rows: NDArray[np.int64] | slice, policy: Actions, weight: Array) -> None:
        add_cross(
            self._cross, self.phi[rows], self.action[rows], self.next_phi[rows], policy[rows],
            weight[rows],
        )  # fmt: skip

    def evaluate(self, policy: Actions) -> Solve:
        """Weights of a policy."""
        return solve(self.moments(policy), self.gamma, self.scaling)


@dataclass(frozen=True)
class Iteration:
    """What policy iteration found, and how it stopped.

    Attributes
    ----------
    solves : tuple of Solve
        One for each policy; the weights of the last are the policy found.
    policy : ndarray of int, shape (n_samples,)
        Actions in the next states that the last weights were solved for.
    stop : {"converged", "cap", "oscillating", "diverging", "interrupted"}
        "oscillating": the policy on the samples is one that was there before, and not the
        last one, so the iterations would repeat for ever.
    period : int
        Length of that cycle, 0 when there is none.
    changes : tuple of float
        ‖w_l - w_{l+1}‖ of each iteration.
    """

    solves: tuple[Solve, ...]
    policy: Actions
    stop: str
    period: int
    changes: tuple[float, ...]

    @property
    def solve(self) -> Solve:
        """The last solve."""
        return self.solves[-1]

    @property
    def iterations(self) -> int:
        """Number of solves."""
        return len(self.solves)

    def describe(self) -> str:
        """One line for a person."""
        text = f"{self.stop} after {self.iterations} iterations"
        if self.period:
            text += f" (a cycle of {self.period} policies)"
        text += f", last change of the weights {self.changes[-1]:.3g}"
        return f"{text}; solve {self.solve.status}, condition {self.solve.condition:.1e}"


def always(iteration: int, change: float) -> bool:
    """Go on."""
    return True


def policy_iteration(
    system: System,
    weights: Array,
    *,
    chi: float,
    max_iterations: int,
    proceed: Callable[[int, float], bool] = always,
) -> Iteration:
    """Solve for a policy, become greedy, and so on (T Algorithm 1, lines 5 to 12).

    Parameters
    ----------
    system : System
    weights : ndarray of shape (n_actions, size)
        w₀, the first policy.
    chi : float
        χ: stop when ‖w_l - w_{l+1}‖ is below it.
    max_iterations : int
        l_max.
    proceed : callable
        Called after each iteration with its number and ‖Δw‖; a false answer ends the loop.

    Returns
    -------
    Iteration
    """
    seen: dict[bytes, int] = {}
    solves: list[Solve] = []
    changes: list[float] = []
    stop, period = "cap", 0
    for iteration in range(1, max_iterations + 1):
        policy = system.policy(weights)
        key = policy.tobytes()
        solves.append(system.evaluate(policy))
        changes.append(float(np.linalg.norm(solves[-1].weights - weights)))
        weights = solves[-1].weights
        if solves[-1].status == "non-finite":
            stop = "diverging"
        elif changes[-1] <= chi:
            stop = "converged"
        elif key in seen and seen[key] < iteration - 1:
            stop, period = "oscillating", iteration - seen[key]
        elif not proceed(iteration, changes[-1]):
            stop = "interrupted"
        if stop != "cap":
            break
        seen[key] = iteration
    return Iteration(tuple(solves), policy, stop, period, tuple(changes))


def offline_lspi(
    transitions: Transitions,
    features: Features,
    n_actions: int,
    *,
    gamma: float,
    delta: float,
    chi: float,
    max_iterations: int,
    weights: Array,
    scaling: str = "samples",
    proceed: Callable[[int, float], bool] = always,
) -> tuple[Iteration, Moments]:
    """Iterate policies on one fixed set of samples (T Algorithm 1).

    Parameters
    ----------
    transitions : Transitions
        D, with finite numbers and known actions.
    features : Features
        φ.
    n_actions : int
    gamma : float in [0, 1)
    delta : float
        δ of Γ₀ = δI.
    chi, max_iterations, weights, proceed
        As in `policy_iteration`.
    scaling
        As in `solve`.

    Returns
    -------
    iteration : Iteration
    moments : Moments
        Γ, z, and the Λ that the last weights were solved from.
    """
    weight = np.ones(len(transitions))  # T forgets nothing here
    system = BlockSystem(transitions, features, n_actions, gamma, weight, delta, scaling)
    found = policy_iteration(
        system, weights, chi=chi, max_iterations=max_iterations, proceed=proceed
    )
    return found, system.moments(found.policy)
