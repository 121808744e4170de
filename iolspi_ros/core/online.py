"""Online LSPI (T Algorithm 2), its informed form, IOLSPI (T III-C), and both refreshed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.buffer import Buffer
from iolspi_ros.core.features import Basis
from iolspi_ros.core.kernels import Crowds, Kernels
from iolspi_ros.core.learner_settings import LearnerSettings
from iolspi_ros.core.lspi import Iteration, always, greedy, offline_lspi
from iolspi_ros.core.moments import Moments, accumulate
from iolspi_ros.core.outliers import doubts
from iolspi_ros.core.refresh import Refresh, refresh
from iolspi_ros.core.samples import Batch, Transition, Transitions
from iolspi_ros.core.shield import Shield, allowed, safest
from iolspi_ros.core.solve import Solve, plausible, solve
from iolspi_ros.errors import InputError

Array = NDArray[np.float64]

STARTS_KEPT = 32
"""Latest states in which episodes began, from which policies are judged."""


class Source(IntEnum):
    """Who chose an action."""

    EXPLOIT = 0
    EXPLORE = 1
    HUMAN = 2
    CORRUPTED = 3
    SCRIPTED = 4
    HOLD = 5
    SHIELD = 6


@dataclass(frozen=True)
class Update:
    """One policy update.

    Attributes
    ----------
    number : int
        l, counting from 1; 0 for what was learned from demonstrations.
    step : int
        k, online steps so far.
    solve : Solve
        Its weights are those that the update found.
    accepted : bool
        Whether they are now in use.
    change : float
        ‖w_l - w_{l+1}‖ that the solve asked for.
    refresh : Refresh, optional
        What came of the samples kept, of a refreshed update.
    iteration : Iteration, optional
        The policy iteration that the weights come from, when there was one.
    """

    number: int
    step: int
    solve: Solve
    accepted: bool
    change: float
    refresh: Refresh | None = None
    iteration: Iteration | None = None

    def describe(self) -> str:
        """One line for a person."""
        parts = [f"update {self.number}" if self.number else "offline LSPI"]
        if self.iteration:
            parts[0] += f": {self.iteration.describe()}"
        if self.refresh:
            parts.append(self.refresh.describe())
        if not (self.iteration or self.refresh):
            kept = "" if self.accepted else ", the weights before stay"
            parts.append(f"solve {self.solve.status}{kept}")
        return "; ".join(parts)


@dataclass(frozen=True)
class Outcome:
    """What an update's computation gives, to be taken by `finish_update`."""

    weights: Array
    solve: Solve
    moments: Moments
    buffer: Buffer
    shield: Shield
    refresh: Refresh | None = None
    iteration: Iteration | None = None
    features: Basis | None = None


class OnlineLSPI:
    """Learns from a stream of transitions; acts ε-greedily on what it knows.

    Between updates the policy is fixed, so `observe` only keeps the transition; every
    `update_interval` of them become one batch and one update (T Algorithm 2, lines 7 to 12).
    The literal algorithm adds the batch to Γ, Λ and z and solves; the refreshed one adds it to
    a buffer and looks for the best policy there. `update` does that at once. `begin_update`
    and `finish_update` are its two halves for whoever computes in another thread: what runs
    between them touches nothing here.

    Parameters
    ----------
    settings : LearnerSettings
    rng : numpy.random.Generator
        Draws w₀, exploration and ties.
    """

    def __init__(self, settings: LearnerSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self.rng = rng
        self.features: Basis = settings.features()
        shape = (settings.n_actions, self.features.size)
        self.weights: Array = rng.standard_normal(shape)
        self.literal = settings.algorithm == "literal"
        # The refreshed learner has no use for matrices of the functions' number squared.
        self.moments = Moments.empty(*(shape if self.literal else (1, 0)), settings.delta)
        self.buffer = settings.buffer()
        self.shield = settings.guarded()
        self.starts = np.empty((0, self.features.n_dims))
        self.step = 0
        self.n_samples = 0  # learned from, demonstrations among them
        self.updates = 0
        self.dropped = 0
        self.vetoes = 0
        self.batch = Batch(settings.update_interval, self.features.n_dims)
        self._q = np.empty(settings.n_actions)

    @property
    def epsilon(self) -> float:
        """Exploration rate now (T Eq. 14)."""
        s = self.settings
        decayed = s.epsilon * s.epsilon_decay ** (self.step * s.sampling_time)
        return max(decayed, min(s.epsilon_min, s.epsilon))

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Choose an action (T Algorithm 2, line 5).

        Parameters
        ----------
        state : ndarray of shape (n_dims,)
        explore : bool
            False for the greedy policy alone.

        Returns
        -------
        action : int
        source : Source
        """
        if explore and self.rng.random() < self.epsilon:
            action, source = int(self.rng.integers(self.settings.n_actions)), Source.EXPLORE
        else:
            q = self.features.weigh(self.weights, state, self._q).tolist()
            action, source = self.choose(q), Source.EXPLOIT
        guard = self.shield.guard
        if guard.active and not allowed(guard, state, action):
            self.vetoes += 1
            q = self.features.weigh(self.weights, state, self._q)
            return int(safest(guard, state, q)), Source.SHIELD
        return action, source

    def choose(self, q: Sequence[float]) -> int:
        """Action of the largest value; one of several at random."""
        most = max(q)
        best = [a for a, value in enumerate(q) if value == most]
        return best[0] if len(best) == 1 else int(self.rng.choice(best or len(q)))

    def observe(self, transition: Transition) -> bool:
        """Keep one transition; one with a number that is not finite is dropped and counted.

        Returns
        -------
        bool
            Whether an update is due.
        """
        t = transition
        numbers = (t.reward, *t.state.tolist(), *t.next_state.tolist())
        if all(map(math.isfinite, numbers)) and 0 <= t.action < self.settings.n_actions:
            self.batch.append(transition)
            self.step += 1
        else:
            self.dropped += 1
        return len(self.batch) >= self.settings.update_interval

    def inform(
        self,
        transitions: Transitions,
        proceed: Callable[[int, float], bool] = always,
    ) -> Update:
        """Learn from demonstrations, then go on online from there (T III-C).

        The literal learner runs offline LSPI from random weights; its weights and its Γ, Λ, z
        become this learner's, unless its last solve is not finite. The refreshed one adds
        them to its buffer; its weights stay when policy iteration does not converge.

        Parameters
        ----------
        transitions : Transitions
        proceed : callable
            As in `policy_iteration`.

        Returns
        -------
        Update

        Raises
        ------
        InputError
            When no transition is usable.
        """
        s = self.settings
        usable = transitions.usable(s.n_actions)
        self.dropped += int((~usable).sum())
        if not usable.any():
            raise InputError(
                f"none of {len(transitions)} demonstrated transitions is usable; allowed: finite "
                f"numbers and actions 0 to {s.n_actions - 1}"
            )
        rows = transitions[usable]
        if self.literal:
            found = self._offline(rows, proceed)
        else:
            start = np.zeros_like(self.weights)  # costs nothing anywhere, so everything is tried
            found = self._refreshed(rows, start, True, proceed)()
        accepted = found.refresh.converged if found.refresh else found.solve.status != "non-finite"
        change = self._change(found.solve)
        if found.refresh and not accepted:
            found = replace(found, weights=self.weights, features=self.features)
        if found.refresh or accepted:
            self._take(found)
            self.n_samples += len(rows)
        return Update(0, self.step, found.solve, accepted, change, found.refresh, found.iteration)

    def _offline(self, rows: Transitions, proceed: Callable[[int, float], bool]) -> Outcome:
        """Offline LSPI on demonstrations (T Algorithm 1)."""
        s, shield = self.settings, self.shield.learn(rows)
        iteration, moments = offline_lspi(
            rows,
            self.features,
            s.n_actions,
            gamma=s.gamma,
            delta=s.delta,
            among=shield.among(rows.next_state),
            chi=s.chi,
            max_iterations=s.max_iterations,
            weights=self.rng.standard_normal(self.weights.shape),
            scaling=s.scaling,
            proceed=proceed,
        )
        found = iteration.solve
        return Outcome(found.weights, found, moments, self.buffer, shield, iteration=iteration)

    def update(self) -> Update:
        """Learn from what was observed (T Algorithm 2, lines 7 to 11)."""
        return self.finish_update(self.begin_update()())

    def begin_update(self) -> Callable[[], Outcome]:
        """Take the batch; the returned computation may run anywhere."""
        batch = self.batch.take()
        self.n_samples += len(batch)
        if not self.literal:
            return self._refreshed(batch, self.weights, False, always)
        # Drawn here, so that the generator is touched by one thread only.
        tie_breaker = np.random.default_rng(self.rng.integers(2**63))
        moments, weights, buffer = self.moments, self.weights, self.buffer
        features, s, shield = self.features, self.settings, self.shield

        def compute() -> Outcome:
            phi, next_phi = features.along(batch)
            among = shield.among(batch.next_state)
            next_action = greedy(weights, next_phi, tie_breaker, among)
            grown = accumulate(
                moments, phi, batch.action, batch.reward, next_phi, next_action, s.forget_factor
            )
            found = solve(grown, s.gamma, s.scaling)
            q = next_phi @ found.weights.T
            if found.healthy and not plausible(q, batch.reward, s.gamma):
                found = replace(found, status="diverging")
            chosen = found.weights if found.healthy else weights
            finite = found.status != "non-finite"
            return Outcome(
                chosen, found, grown if finite else moments, buffer,
                shield.learn(batch, s.forget_factor),
            )  # fmt: skip

        return compute

    def finish_update(self, found: Outcome) -> Update:
        """Take the result of `begin_update`'s computation.

        Weights of an unhealthy solve, or of one judged worse, are not used; those before stay.
        """
        change = self._change(found.solve)
        accepted = found.solve.healthy and found.weights is not self.weights
        self._take(found)
        self.updates += 1
        return Update(
            self.updates, self.step, found.solve, accepted, change, found.refresh, found.iteration
        )

    def _refreshed(
        self,
        batch: Transitions,
        weights: Array,
        demonstrated: bool,
        proceed: Callable[[int, float], bool],
    ) -> Callable[[], Outcome]:
        """The refreshed update of a batch, started from some weights."""
        ends = batch.terminated | batch.truncated
        last = self.buffer.transitions[-1:]
        after_an_end = demonstrated or not len(last) or bool(last.terminated | last.truncated)
        begins = np.concatenate([[after_an_end], ends[:-1]])
        self.starts = np.concatenate([self.starts, batch.state[begins]])[-STARTS_KEPT:]
        step, s = self.step, self.settings
        features, moments, kept, shield = self.features, self.moments, self.buffer, self.shield

        def compute() -> Outcome:
            seen = kept.transitions + batch
            believed, basis, cells = ~doubts(seen).rows, features, kept.cells
            if isinstance(features, Kernels):
                basis = features.around(seen.state[believed], s.kernels)
                cells = Crowds(basis)
            buffer = replace(kept, cells=cells).add(batch, step, demonstrated)
            grown = shield.learn(
                batch[believed[len(kept) :]], 1.0 if demonstrated else s.forget_factor
            )
            among = grown.among(buffer.transitions.next_state)
            found = refresh(buffer, step, basis, s, weights, proceed, among, old=features)
            flown = basis if found.record.converged else features
            return Outcome(
                found.weights,
                found.solve,
                moments,
                buffer,
                grown,
                found.record,
                found.iteration,
                flown,
            )

        return compute

    def _change(self, found: Solve) -> float:
        """‖Δw‖ that a solve asks for; NaN when it has other functions."""
        if found.weights.shape != self.weights.shape:
            return math.nan
        return float(np.linalg.norm(found.weights - self.weights))

    def _take(self, found: Outcome) -> None:
        self.weights, self.moments, self.buffer = found.weights, found.moments, found.buffer
        self.shield, self.features = found.shield, found.features or self.features

    def state(self) -> dict[str, Any]:
        """Everything that a later `restore` needs to go on bit by bit the same."""
        return {
            "weights": self.weights,
            "moments": self.moments,
            "buffer": self.buffer,
            "shield": self.shield,
            "starts": self.starts,
            "step": self.step,
            "n_samples": self.n_samples,
            "updates": self.updates,
            "dropped": self.dropped,
            "vetoes": self.vetoes,
            "batch": self.batch.rows(),
            "rng": self.rng.bit_generator.state,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` gave.

        Raises
        ------
        InputError
            When it was made with other actions or features.
        """
        if state["weights"].shape != self.weights.shape:
            raise InputError(
                f"weights have shape {state['weights'].shape}; allowed: {self.weights.shape} "
                "(actions, features) of this learner"
            )
        self.weights, self.moments = state["weights"], state["moments"]
        self.buffer, self.shield = state["buffer"], state["shield"]
        self.starts = state["starts"]
        for name in ("step", "n_samples", "updates", "dropped", "vetoes"):
            setattr(self, name, state[name])
        self.batch.take()
        for transition in state["batch"]:
            self.batch.append(transition)
        self.rng.bit_generator.state = state["rng"]
