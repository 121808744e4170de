"""Online LSPI (T Algorithm 2), its informed form, IOLSPI (T III-C), and both refreshed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.choice import Choice, choose, epsilon_at, greedy_action, guarded
from iolspi_ros.core.kernels import Crowds, Kernels
from iolspi_ros.core.learner import PERSON, Kernel, Proceed, Source, always
from iolspi_ros.core.lspi import greedy, offline_lspi
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.lspi_state import (
    COUNTERS,
    BufferState,
    KernelState,
    LSPIState,
    ShieldState,
    check,
    shallow,
)
from iolspi_ros.core.lspi_update import Computed, LSPIUpdate, described, facts
from iolspi_ros.core.moments import Moments, accumulate
from iolspi_ros.core.outliers import doubts, generous
from iolspi_ros.core.refresh import refresh
from iolspi_ros.core.samples import Batch, Transition, Transitions
from iolspi_ros.core.solve import Solve, plausible, solve
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

_SOURCES = tuple(Source)
_EXPLOIT, _EXPLORE, _SHIELD = int(Source.EXPLOIT), int(Source.EXPLORE), int(Source.SHIELD)


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
    task : TaskDescription
    settings : LSPISettings
    rng : numpy.random.Generator
        Draws w₀, exploration and ties.
    """

    Settings: ClassVar[type[Any]] = LSPISettings
    State: ClassVar[type[Any]] = LSPIState
    changeable: ClassVar[tuple[str, ...]] = (
        "epsilon", "epsilon_decay", "epsilon_min", "update_interval", "forget_factor", "delta",
        "chi", "max_iterations", "scaling", "refresh_iterations", "refresh_budget",
    )  # fmt: skip
    shaping: ClassVar[tuple[str, ...]] = (
        "algorithm", "basis", "kernels", "low", "high", "centers", "periodic", "normalisation",
        "width", "constant",
    )  # fmt: skip

    def __init__(
        self, task: TaskDescription, settings: LSPISettings, rng: np.random.Generator
    ) -> None:
        self.task, self.rng = task, rng
        self.settings = settings
        self.features: Basis = self.settings.features()
        shape = (task.n_actions, self.features.size)
        self.weights: Array = rng.standard_normal(shape)
        self.literal = settings.algorithm == "literal"
        # The refreshed learner has no use for matrices of the functions' number squared.
        self.moments = Moments.empty(*(shape if self.literal else (1, 0)), settings.delta)
        self.buffer = self.settings.buffer()
        self.shield = self.settings.guarded(task)
        self.step = 0
        self.n_samples = 0  # learned from, demonstrations among them
        self.updates = 0
        self.dropped = 0
        self.vetoes = 0
        self.batch = Batch(settings.update_interval, task.n_dims)
        self._room: tuple[Array, Array, Array] = (np.empty(0), np.empty(0), np.empty(0))

    @property
    def settings(self) -> LSPISettings:
        """What it takes now; where nothing was given, what the task says."""
        return self._settings

    @settings.setter
    def settings(self, settings: LSPISettings) -> None:
        self._settings = settings.resolve(self.task)

    @property
    def _exploring(self) -> tuple[float, float, float, float]:
        s = self._settings
        floor = min(s.epsilon_min, s.epsilon)
        return (s.epsilon, s.epsilon_decay, self.task.sampling_time, floor)

    @property
    def epsilon(self) -> float:
        """Exploration rate now (T Eq. 14)."""
        return float(epsilon_at(self._exploring, self.step))

    @property
    def snapshot(self) -> Array:
        """The weights, shape (n_actions, size); with `basis: auto` their functions besides."""
        if isinstance(self.features, Kernels):
            return self.features.packed(self.weights)
        return self.weights

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """Q̂ of every action, shape (n_states, n_actions)."""
        features, weights = self.features, self.weights if snapshot is None else snapshot
        if snapshot is not None and isinstance(features, Kernels):
            features, weights = Kernels.unpacked(snapshot, self.task.n_actions)
        return features(states) @ weights.T

    @property
    def _choice(self) -> Choice:
        if len(self._room[1]) != self.features.size:  # made once for the same functions
            self._room = (
                np.empty(int(self.features.table.counts.sum())), np.empty(self.features.size),
                np.empty(self.task.n_actions),
            )  # fmt: skip
        return Choice(
            self.features.table, self.weights, self.shield.guard, self._exploring, *self._room
        )

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
        memory, rng = self._choice, self.rng
        if explore and rng.random() < epsilon_at.py_func(memory.exploring, self.step):
            action, source = int(rng.integers(0, self.task.n_actions)), _EXPLORE
        else:
            (action, count), source = greedy_action(memory, state, 0), _EXPLOIT
            if count > 1:
                action, _ = greedy_action(memory, state, int(rng.integers(0, count)))
        if memory.guard.active:
            action, source = guarded(memory, state, action, source)
            self.vetoes += source == _SHIELD
        return action, _SOURCES[source]

    def kernel(self, most: int) -> Kernel:
        """The same choice for a compiled loop, and room for what happens there."""
        count = min(most, max(self.settings.update_interval - len(self.batch), 1))
        return Kernel(choose, self._choice, self.rng, self.step, self.batch.reserve(count))

    def flown(self, steps: int, vetoes: int, *, ended: bool, last: bool) -> bool:
        """Take what was written into the rows of `kernel`."""
        self.batch.written(steps)
        self.step += steps
        self.vetoes += vetoes
        if last:
            self.batch.end(ended)
        return len(self.batch) >= self.settings.update_interval

    def observe(self, transition: Transition) -> bool:
        """Keep one transition; one that is not this task's, or not finite, is dropped and counted.

        Returns
        -------
        bool
            Whether an update is due.
        """
        t = transition
        numbers = (t.reward, *t.state.tolist(), *t.next_state.tolist())
        n = self.task.n_dims
        fits = len(t.state) == len(t.next_state) == n and 0 <= t.action < self.task.n_actions
        if fits and all(map(math.isfinite, numbers)):
            self.batch.append(transition)
            self.step += 1
        else:
            self.dropped += 1
        return len(self.batch) >= self.settings.update_interval

    def pretrain(self, demonstrations: Transitions, proceed: Proceed = always) -> LSPIUpdate:
        """Learn from demonstrations, then go on online from there (T III-C).

        The literal learner runs offline LSPI from random weights; its weights and its Γ, Λ, z
        become this learner's, unless its last solve is not finite. The refreshed one adds
        them to its buffer; its weights stay when policy iteration does not converge, unless
        nothing was learned before.

        Parameters
        ----------
        demonstrations : Transitions
        proceed : callable

        Returns
        -------
        LSPIUpdate

        Raises
        ------
        InputError
            When no transition is usable.
        """
        usable = demonstrations.usable(self.task.n_actions)
        self.dropped += int((~usable).sum())
        if not usable.any():
            raise InputError(
                f"none of {len(demonstrations)} demonstrated transitions is usable; allowed: "
                f"finite numbers and actions 0 to {self.task.n_actions - 1}"
            )
        rows = demonstrations[usable]
        if self.literal:
            found = self._offline(rows, proceed)
        else:
            start = np.zeros_like(self.weights)  # costs nothing anywhere, so everything is tried
            shown = np.ones(len(rows), bool)
            found = self._refreshed(rows, shown, start, proceed, pretraining=True)()
        refreshed = found.refresh
        accepted = refreshed.used if refreshed else found.solve.status != "non-finite"
        report = self._report(0, accepted, found)
        if refreshed and not accepted:
            found = replace(found, weights=self.weights, features=self.features)
        if refreshed or accepted:
            self._take(found)
            self.n_samples += len(rows)
        return report

    def _report(self, number: int, accepted: bool, found: Computed) -> LSPIUpdate:
        return LSPIUpdate(
            number, self.step, accepted, found.solve.healthy,
            self._change(found.solve), described(number, accepted, found), facts(found),
            found.solve, found.refresh, found.iteration,
        )  # fmt: skip

    def _change(self, found: Solve) -> float:
        """‖Δw‖ that a solve asks for; NaN when it has other functions."""
        if found.weights.shape != self.weights.shape:
            return math.nan
        return float(np.linalg.norm(found.weights - self.weights))

    def _offline(self, rows: Transitions, proceed: Proceed) -> Computed:
        """Offline LSPI on demonstrations (T Algorithm 1)."""
        s, shield = self.settings, self.shield.learn(rows)
        iteration, moments = offline_lspi(
            rows,
            self.features,
            self.task.n_actions,
            gamma=self.task.gamma,
            delta=s.delta,
            among=shield.among(rows.next_state),
            chi=s.chi,
            max_iterations=s.max_iterations,
            weights=self.rng.standard_normal(self.weights.shape),
            scaling=s.scaling,
            proceed=proceed,
        )
        found = iteration.solve
        return Computed(
            found.weights, found, moments, self.buffer, shield, self.features, iteration=iteration
        )

    def begin_update(self) -> Callable[[], Computed]:
        """Take the batch; the returned computation may run anywhere."""
        shown = np.isin(self.batch.source, PERSON)
        batch = self.batch.take()
        self.n_samples += len(batch)
        if not self.literal:
            return self._refreshed(batch, shown, self.weights, always)
        # Drawn here, so that the generator is touched by one thread only.
        tie_breaker = np.random.default_rng(self.rng.integers(2**63))
        moments, weights, buffer = self.moments, self.weights, self.buffer
        features, s, shield = self.features, self.settings, self.shield
        gamma = self.task.gamma

        def compute() -> Computed:
            phi, next_phi = features.along(batch)
            among = shield.among(batch.next_state)
            next_action = greedy(weights, next_phi, tie_breaker, among)
            grown = accumulate(
                moments, phi, batch.action, batch.reward, next_phi, next_action, s.forget_factor
            )
            found = solve(grown, gamma, s.scaling)
            q = next_phi @ found.weights.T
            if found.healthy and not plausible(q, batch.reward, gamma):
                found = replace(found, status="diverging")
            chosen = found.weights if found.healthy else weights
            finite = found.status != "non-finite"
            return Computed(
                chosen, found, grown if finite else moments, buffer,
                shield.learn(batch, s.forget_factor), features,
            )  # fmt: skip

        return compute

    def finish_update(self, found: Computed) -> LSPIUpdate:
        """Take the result of `begin_update`'s computation.

        Weights of an unhealthy solve, or that did not converge, are not used; those before stay.
        """
        self.updates += 1
        accepted = found.solve.healthy and found.weights is not self.weights
        report = self._report(self.updates, accepted, found)
        self._take(found)
        return report

    def _refreshed(
        self,
        batch: Transitions,
        demonstrated: NDArray[np.bool_],
        weights: Array,
        proceed: Proceed,
        *,
        pretraining: bool = False,
    ) -> Callable[[], Computed]:
        """The refreshed update of a batch, started from some weights."""
        task, step, s = self.task, self.step, self.settings
        features, moments, kept, shield = self.features, self.moments, self.buffer, self.shield
        limits = generous(task)

        def compute() -> Computed:
            seen = kept.transitions + batch
            believed, basis, cells = ~doubts(seen, *limits).rows, features, kept.cells
            if isinstance(features, Kernels) and believed.any():
                basis, cells = features.around(seen.state[believed], s.kernels, s.metric)
            buffer = replace(kept, cells=cells).add(batch, step, demonstrated, at_once=pretraining)
            new = batch[believed[len(kept) :]]
            grown = shield.learn(new, 1.0 if pretraining else s.forget_factor)
            among = grown.among(buffer.transitions.next_state)
            found = refresh(
                buffer, step, basis, task, s, weights, proceed, among, limits, features,
                anything=pretraining and not len(kept),
            )  # fmt: skip
            return Computed(
                found.weights, found.solve, moments, buffer, grown,
                basis if found.record.used else features, found.record, found.iteration,
            )  # fmt: skip

        return compute

    def _take(self, found: Computed) -> None:
        self.weights, self.moments, self.buffer = found.weights, found.moments, found.buffer
        self.shield, self.features = found.shield, found.features

    def health(self) -> Mapping[str, object]:
        """The shield's vetoes."""
        if not self.shield.raised:
            return {"shield": "off"}
        waiting = "" if self.shield.guard.active else ", not enough samples yet"
        return {"shield": f"{self.vetoes} vetoes{waiting}"}

    def state(self) -> LSPIState:
        """Everything that a later `restore` needs to go on bit by bit the same."""
        kept = self.buffer
        shield = {field.name: getattr(self.shield, field.name) for field in fields(ShieldState)}
        counters = {name: getattr(self, name) for name in COUNTERS}
        return LSPIState(
            self.weights, KernelState.of(self.features, self.task.n_dims), self.moments,
            BufferState(kept.transitions, kept.born, kept.demonstrated), ShieldState(**shield),
            self.batch.rows(), **counters, rng=dict(self.rng.bit_generator.state),
            batch_source=self.batch.source,
        )  # fmt: skip

    def restore(self, state: LSPIState) -> None:
        """Go on from what `state` gave; this learner's own settings stay.

        Raises
        ------
        InputError
            When it was made with other actions or features, or holds what cannot be.
        """
        features, cells = self.features, self.buffer.cells
        if isinstance(features, Kernels):
            features = state.kernels.kernels(self.task.n_dims)
            cells = Crowds(features.points, features.scales, features.periods)
        check(state, self.state(), self.task, features.size)
        try:
            self.rng.bit_generator.state = state.rng
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(f"rng is no state of its random generator: {error}") from None
        self.weights, self.moments, self.features = state.weights, state.moments, features
        self.buffer = replace(self.buffer, cells=cells, **shallow(state.buffer))
        self.shield = replace(self.shield, **shallow(state.shield))
        for name in COUNTERS:
            setattr(self, name, getattr(state, name))
        self.batch.take()
        source = state.batch_source if len(state.batch_source) else np.full(len(state.batch), -1)
        for transition, chosen in zip(state.batch, source.tolist(), strict=True):
            self.batch.append(transition._replace(source=chosen))
