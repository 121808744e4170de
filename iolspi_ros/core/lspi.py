"""Least-squares policy iteration on one set of samples (T Algorithm 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Proceed, always
from iolspi_ros.core.moments import Moments, add_cross, add_gram, move_cross
from iolspi_ros.core.samples import Transitions
from iolspi_ros.core.solve import Solve, solve

Array = NDArray[np.float64]
Actions = NDArray[np.int64]


class Features(Protocol):
    """What policy iteration asks of φ."""

    @property
    def size(self) -> int:
        """Number of functions."""
        ...

    def __call__(self, states: Array, terminated: NDArray[np.bool_] | None = None) -> Array:
        """φ of some states, zero where nothing follows."""
        ...


def greedy(
    weights: Array,
    phi: Array,
    rng: np.random.Generator | None = None,
    among: NDArray[np.bool_] | None = None,
) -> Actions:
    """Action with the largest Q̂(s, a) = φᵀ(s) w_a (T Eqs. 6, 7).

    Parameters
    ----------
    weights : ndarray of shape (n_actions, size)
    phi : ndarray of shape (n_samples, size)
    rng : numpy.random.Generator, optional
        Breaks exact ties at random; without it the first action wins.
    among : ndarray of bool, shape (n_samples, n_actions), optional
        Actions to choose from; all by default.

    Returns
    -------
    ndarray of int, shape (n_samples,)
    """
    q = phi @ weights.T
    if among is not None:
        q = np.where(among, q, -np.inf)
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
    among : ndarray of bool, shape (n_samples, n_actions), optional
        Actions that a policy may choose from in the next states; all by default.
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
        among: NDArray[np.bool_] | None = None,
    ) -> None:
        self.gamma, self.delta, self.scaling, self.among = gamma, delta, scaling, among
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
        return greedy(weights, self.next_phi, among=self.among)

    def values(self, weights: Array) -> Array:
        """Q̂ in the next states, shape (n_samples, n_actions)."""
        return self.next_phi @ weights.T

    def moments(self, policy: Actions) -> Moments:
        """Γ, Λ and z of a policy."""
        size = self.vector.shape[1]
        last = self._last
        if last is None:
            self._cross = np.zeros_like(self._cross)
            add_cross(self._cross, self.phi, self.action, self.next_phi, policy, self.weight)
        elif (policy != last).any():
            self._cross = self._cross.copy()  # the one before is somebody's
            move_cross(self._cross, self.phi, self.action, self.next_phi, last, policy, self.weight)
        self._last = policy
        gram = self.gram.copy()
        gram[:, np.arange(size), np.arange(size)] += self.delta
        mass = float(self.weight.sum())
        return Moments(gram, self._cross, self.vector, len(policy), mass)

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


def policy_iteration(
    system: System,
    weights: Array,
    *,
    chi: float,
    max_iterations: int,
    proceed: Proceed = always,
    first: Actions | None = None,
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
        Told after each iteration what share of l_max is done; a false answer ends the loop.
    first : ndarray of int, shape (n_samples,), optional
        The first policy, when it is of weights of other functions.

    Returns
    -------
    Iteration
    """
    seen: dict[bytes, int] = {}
    solves: list[Solve] = []
    last: bytes | None = None
    changes: list[float] = []
    stop, period = "cap", 0
    for iteration in range(1, max_iterations + 1):
        policy = first if first is not None else system.policy(weights)
        first = None
        key = policy.tobytes()
        solves.append(solves[-1] if key == last else system.evaluate(policy))
        changes.append(float(np.linalg.norm(solves[-1].weights - weights)))
        weights = solves[-1].weights
        if solves[-1].status == "non-finite":
            stop = "diverging"
        elif changes[-1] <= chi:
            stop = "converged"
        elif key in seen and seen[key] < iteration - 1:
            stop, period = "oscillating", iteration - seen[key]
        elif not proceed(iteration / max_iterations):
            stop = "interrupted"
        if stop != "cap":
            break
        seen[key], last = iteration, key
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
    among: NDArray[np.bool_] | None = None,
    proceed: Proceed = always,
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
    among
        As of `BlockSystem`.

    Returns
    -------
    iteration : Iteration
    moments : Moments
        Γ, z, and the Λ that the last weights were solved from.
    """
    weight = np.ones(len(transitions))  # T forgets nothing here
    system = BlockSystem(transitions, features, n_actions, gamma, weight, delta, scaling, among)
    found = policy_iteration(
        system, weights, chi=chi, max_iterations=max_iterations, proceed=proceed
    )
    return found, system.moments(found.policy)
