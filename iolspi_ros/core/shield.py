"""A shield: no action after which, as far as the samples tell, the vehicle must leave its envelope.

What an action leads to is predicted by a cubic polynomial of the state for each action, fitted
to the samples seen; no model is asked. Vehicles seldom are far from cubic in 0.1 s, and such a
fit is good after a few hundred samples, long before any value function is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.moments import fading
from iolspi_ros.core.samples import Transitions

Array = NDArray[np.float64]

DEGREE = 3
LARGE, LARGE_DEGREE = 6, 2
"""Variables beyond which the polynomial has this degree, and all actions share one: they differ
by a push that is linear in their values. A cubic of ten variables has 286 coefficients."""
SAMPLES_PER_TERM = 3
"""Every action must be seen so often for each coefficient before the fit is believed; where they
share one, all together."""
RIDGE = 1e-9
"""Of the regression, in weights of a sample."""
HORIZON = 9
"""Steps after which a vehicle that is still inside is taken to stay there."""
SEARCH, LARGE_SEARCH = 10_000, 1_000
"""Predictions that a search for a way takes at most: four actions never need so many."""


class Guard(NamedTuple):
    """A shield as plain numbers, for compiled code.

    Attributes
    ----------
    active : bool
        Whether there is a fit to believe.
    low, high : ndarray of shape (n_dims,)
        The envelope.
    round : ndarray of bool, shape (n_dims,)
        Variables whose limits are one ellipse: the squares of their distances from its middle, in
        shares of its half axes, sum up to 1 at most.
    middle, half : ndarray of shape (n_dims,)
        What turns a state into numbers around 0, mostly within 1.
    period : ndarray of shape (n_dims,)
        After which a variable repeats; 0 for never.
    parent, factor : ndarray of int, shape (n_terms,)
        Term k > 0 is term parent[k] times variable factor[k]; term 0 is 1.
    weights : ndarray of shape (n_actions, n_dims, n_terms)
        Of the change of the state in one step.
    ends : ndarray of bool, shape (n_actions,)
        Actions that have ended the task whenever they were taken.
    """

    active: bool
    low: Array
    high: Array
    round: NDArray[np.bool_]
    middle: Array
    half: Array
    period: Array
    parent: NDArray[np.int64]
    factor: NDArray[np.int64]
    weights: Array
    ends: NDArray[np.bool_]


@dataclass(frozen=True)
class Shield:
    """What the samples say about one step, in sums that do not grow, and the envelope.

    Parameters
    ----------
    raised : bool
        Whether it vetoes; otherwise it only learns.
    low, high : ndarray of shape (n_dims,)
        Envelope, in SI units and radians; infinite where there is no limit. Nothing is ever
        vetoed when all are.
    round : ndarray of bool, shape (n_dims,)
    middle, half, period : ndarray of shape (n_dims,)
        As of `Guard`.
    gram : ndarray of shape (n_actions, n_terms, n_terms)
    cross : ndarray of shape (n_actions, n_terms, n_dims)
    seen, ended : ndarray of shape (n_actions,)
        Weight of the samples of each action, and of those that ended the task.
    values : ndarray of shape (n_actions, n_values), optional
        What the actions mean; without it they share nothing.
    """

    raised: bool
    low: Array
    high: Array
    round: NDArray[np.bool_]
    middle: Array
    half: Array
    period: Array
    gram: Array
    cross: Array
    seen: Array
    ended: Array
    values: Array | None = None

    @classmethod
    def empty(
        cls,
        raised: bool,
        low: Array,
        high: Array,
        round: NDArray[np.bool_],
        middle: Array,
        half: Array,
        period: Array,
        n_actions: int,
        values: Array | None = None,
    ) -> Shield:
        """Before any sample."""
        n_terms, n_dims = len(_terms(len(low))[0]), len(low)
        return cls(
            raised, low, high, round, middle, half, period,
            np.zeros((n_actions, n_terms, n_terms)), np.zeros((n_actions, n_terms, n_dims)),
            np.zeros(n_actions), np.zeros(n_actions), values,
        )  # fmt: skip

    @property
    def bounded(self) -> bool:
        """Whether there is a limit to keep."""
        return bool(np.isfinite(self.low).any() or np.isfinite(self.high).any())

    def learn(self, batch: Transitions, forget_factor: float = 1.0) -> Shield:
        """With a batch more, oldest first; sums fade as in T Eqs. 9-10 to 9-12."""
        if not self.bounded:
            return self
        kept, weight = forget_factor ** len(batch), fading(len(batch), forget_factor)
        terms = np.empty((len(batch), self.gram.shape[1]))
        _expand_all(self.guard, np.ascontiguousarray(batch.state), terms)
        change = batch.next_state - batch.state
        change -= self.period * np.round(change / np.where(self.period > 0.0, self.period, 1.0))
        grown = [part * kept for part in (self.gram, self.cross, self.seen, self.ended)]
        for a in range(len(self.seen)):
            rows = batch.action == a
            weighted = terms[rows] * weight[rows, None]
            grown[0][a] += weighted.T @ terms[rows]
            grown[1][a] += weighted.T @ change[rows]
            grown[2][a] += weight[rows].sum()
            grown[3][a] += weight[rows & batch.terminated].sum()
        gram, cross, seen, ended = grown
        learned = replace(self, gram=gram, cross=cross, seen=seen, ended=ended)
        _ = learned.guard  # fitted here, where an update computes, and not in the control loop
        return learned

    def among(self, states: Array) -> NDArray[np.bool_] | None:
        """Actions that it leaves to choose from; None for all of them in all states.

        Parameters
        ----------
        states : ndarray of shape (n_samples, n_dims)

        Returns
        -------
        ndarray of bool, shape (n_samples, n_actions), or None
        """
        if not self.guard.active:
            return None
        steps = np.empty((len(states), len(self.seen)), np.int64)
        _lasting_all(self.guard, np.ascontiguousarray(states), steps)
        most: NDArray[np.bool_] = steps == steps.max(axis=1, keepdims=True)
        return most

    @cached_property
    def guard(self) -> Guard:
        """The fit, ready to be asked."""
        n_actions, n_terms, n_dims = self.cross.shape
        parent, factor = _terms(n_dims)
        ends = (self.seen > 0.0) & (self.ended >= self.seen)
        weights, steers = np.zeros((n_actions, n_dims, n_terms)), np.flatnonzero(~ends)
        if n_dims > LARGE and self.values is not None:
            enough = self.seen[steers].sum() >= SAMPLES_PER_TERM * n_terms
            known = bool(enough and len(steers))
            if known:
                weights[steers] = self._shared(steers, self.values[steers])
        else:
            enough = (self.seen[steers] >= SAMPLES_PER_TERM * n_terms).all()
            known = bool(enough and len(steers))
            ridge = RIDGE * np.eye(n_terms)
            for a in steers if known else ():
                weights[a] = np.linalg.solve(self.gram[a] + ridge, self.cross[a]).T
        return Guard(
            known and self.raised, self.low, self.high, self.round, self.middle, self.half,
            self.period, parent, factor, weights, ends,
        )  # fmt: skip

    def _shared(self, steers: NDArray[np.int64], values: Array) -> Array:
        """One fit of the terms and of the actions' values; these shift the first term, 1."""
        gram, cross = self.gram[steers], self.cross[steers]
        beside = np.einsum("at,av->tv", gram[:, :, 0], values)
        among = np.einsum("a,av,aw->vw", gram[:, 0, 0], values, values)
        whole = np.block([[gram.sum(axis=0), beside], [beside.T, among]])
        wanted = np.concatenate([cross.sum(axis=0), values.T @ cross[:, 0]])
        fit = np.linalg.solve(whole + RIDGE * np.eye(len(whole)), wanted)
        n_terms = gram.shape[1]
        shared: Array = np.repeat(fit[:n_terms].T[None], len(steers), axis=0)
        shared[:, :, 0] += values @ fit[n_terms:]
        return shared


def _terms(n_dims: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Monomials up to the degree, each as one before it times a variable."""
    powers: list[tuple[int, ...]] = [()]
    for degree in range(1, (LARGE_DEGREE if n_dims > LARGE else DEGREE) + 1):
        powers += combinations_with_replacement(range(n_dims), degree)
    number = {power: k for k, power in enumerate(powers)}
    parent = [0, *(number[power[:-1]] for power in powers[1:])]
    factor = [0, *(power[-1] for power in powers[1:])]
    return np.array(parent), np.array(factor)


@cached_njit(nogil=True)
def _expand(guard: Guard, state: Array, terms: Array) -> None:
    terms[0] = 1.0
    for k in range(1, len(terms)):
        d = guard.factor[k]
        terms[k] = terms[guard.parent[k]] * (state[d] - guard.middle[d]) / guard.half[d]


@cached_njit(nogil=True)
def _expand_all(guard: Guard, states: Array, terms: Array) -> None:
    for row in range(len(states)):
        _expand(guard, states[row], terms[row])


@cached_njit(nogil=True)
def predict(guard: Guard, state: Array, action: int, terms: Array, out: Array) -> bool:
    """Where one step leads, into `out`; whether that is inside the envelope."""
    _expand(guard, state, terms)
    inside, outward = True, 0.0
    for d in range(len(state)):
        moved = state[d]
        for k in range(len(terms)):
            moved += guard.weights[action, d, k] * terms[k]
        if guard.period[d] > 0.0:
            low = guard.middle[d] - guard.period[d] / 2
            moved -= guard.period[d] * np.floor((moved - low) / guard.period[d])
        out[d] = moved
        low, high = guard.low[d], guard.high[d]
        if guard.round[d]:
            outward += ((2.0 * moved - low - high) / (high - low)) ** 2
        elif not low <= moved <= high:
            inside = False
    return inside and outward <= 1.0


@cached_njit(nogil=True)
def lasting(guard: Guard, state: Array, action: int) -> int:
    """Steps that the vehicle can stay inside after an action, at most `HORIZON`.

    Whatever comes after the action is searched until a way is found that stays inside: one action
    held, then depth first. An action that ends the task leaves nothing to fear.
    """
    if guard.ends[action]:
        return HORIZON
    n_actions, n_terms = guard.weights.shape[0], guard.weights.shape[2]
    terms = np.empty(n_terms)
    states = np.empty((HORIZON, len(state)))
    following = np.zeros(HORIZON, np.int64)
    if not predict(guard, state, action, terms, states[0]):
        return 0
    most, level, left = 1, 0, SEARCH
    if len(state) > LARGE:
        left = LARGE_SEARCH
        for a in range(n_actions):
            steps = 1
            while not guard.ends[a] and predict(guard, states[steps - 1], a, terms, states[steps]):
                steps += 1
                if steps == HORIZON:
                    return HORIZON
            most = max(most, steps)
    while level >= 0 and left > 0:
        left -= 1
        if level + 1 == HORIZON:
            return HORIZON
        a = following[level]
        following[level] += 1
        if a == n_actions:
            level -= 1
            continue
        if not guard.ends[a] and predict(guard, states[level], a, terms, states[level + 1]):
            level += 1
            following[level] = 0
            most = max(most, level + 1)
    return most


@cached_njit(nogil=True)
def _lasting_all(guard: Guard, states: Array, steps: NDArray[np.int64]) -> None:
    for row in range(len(states)):
        for action in range(steps.shape[1]):
            steps[row, action] = lasting(guard, states[row], action)


@cached_njit(nogil=True)
def allowed(guard: Guard, state: Array, action: int) -> bool:
    """Whether an action may be taken."""
    return not guard.active or lasting(guard, state, action) == HORIZON


@cached_njit(nogil=True)
def safest(guard: Guard, state: Array, q: Array) -> int:
    """The action after which the vehicle can stay inside longest; of several, the best.

    Parameters
    ----------
    guard : Guard
    state : ndarray of shape (n_dims,)
    q : ndarray of shape (n_actions,)
        Q̂ of the actions.
    """
    chosen, most = 0, -1
    for a in range(len(q)):
        steps = lasting(guard, state, a)
        if steps > most or (steps == most and q[a] > q[chosen]):
            chosen, most = a, steps
    return chosen
