"""What the literature's learners share: settings, features, exploration, counters, being saved."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.choice import epsilon_at
from iolspi_ros.core.learner import PERSON, Proceed, Source, Update, always
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.lspi_state import BufferState, shallow
from iolspi_ros.core.samples import Batch, Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.methods.traits import TRAITS, Traits, informed
from iolspi_ros.settings import Settings, replaced
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]
_COUNTERS = ("step", "n_samples", "updates", "dropped", "since")
_NOT_COMPARED: Array = np.zeros(0)


@dataclass(frozen=True)
class MethodSettings(Settings):
    """The features and the exploration, as IOLSPI takes them; a grid where nothing is given."""

    low: tuple[float, ...] = replaced(LSPISettings, "low", ())
    high: tuple[float, ...] = replaced(LSPISettings, "high", ())
    centers: tuple[int, ...] = replaced(LSPISettings, "centers", ())
    periodic: tuple[bool, ...] = replaced(LSPISettings, "periodic", ())
    width: float = replaced(LSPISettings, "width", 1.0)
    epsilon: float = replaced(LSPISettings, "epsilon", 0.2)
    epsilon_decay: float = replaced(LSPISettings, "epsilon_decay", 1.0)
    epsilon_min: float = replaced(LSPISettings, "epsilon_min", 0.0)
    update_interval: int = replaced(LSPISettings, "update_interval", 1000)

    def on(self, task: TaskDescription) -> LSPISettings:
        """The same for least squares, on a grid, with the task's limits where none are given."""
        return LSPISettings(
            algorithm="literal", low=self.low, high=self.high, centers=self.centers,
            periodic=self.periodic, width=self.width,
        ).resolve(task)  # fmt: skip


@dataclass(frozen=True)
class SampledSettings(MethodSettings):
    """What those take besides that keep samples and learn from all of them again."""

    buffer_size: int = replaced(LSPISettings, "buffer_size", 6000)
    samples_per_cell: int = replaced(LSPISettings, "samples_per_cell", 8)


@dataclass(frozen=True)
class MethodState:
    """All that a learner needs to go on bit by bit the same.

    Attributes
    ----------
    weights, memory : ndarray
        Its policy; what it remembers besides.
    kept : BufferState
        Samples that it learns from again and again.
    waiting, waiting_source
        Transitions that nothing was made of yet, and who chose the actions.
    """

    weights: Array
    memory: Array
    kept: BufferState
    waiting: Transitions
    waiting_source: NDArray[np.int64]
    step: int
    n_samples: int
    updates: int
    dropped: int
    since: int
    rng: dict[str, Any]


class Method(ABC):
    """A learner as of `core.learner.Learner`, without what makes it one of the literature's.

    Attributes
    ----------
    name : str
        Under which it is registered.
    weights : ndarray of shape (n_actions, size)
        Of Q̂, or whatever the largest of says the action.
    memory : ndarray
        What it remembers besides, always of the same shape.
    waiting : Batch
        Transitions that nothing was made of yet.
    """

    name: ClassVar[str]
    Settings: ClassVar[type[Any]] = MethodSettings
    State: ClassVar[type[Any]] = MethodState
    changeable: ClassVar[tuple[str, ...]] = (
        "epsilon", "epsilon_decay", "epsilon_min", "update_interval",
    )  # fmt: skip
    shaping: ClassVar[tuple[str, ...]] = ("low", "high", "centers", "periodic", "width")

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        self.task, self.settings, self.rng = task, settings, rng
        self.features = self.basis()
        self.weights: Array = np.zeros((task.n_actions, self.features.size))
        self.memory: Array = np.zeros((0, 0))
        self.step = self.n_samples = self.updates = self.dropped = self.since = 0
        self.buffer = LSPISettings(
            algorithm="literal", low=(0.0,) * task.n_dims, high=(1.0,) * task.n_dims
        ).resolve(task).buffer()  # fmt: skip
        self.waiting = Batch(max(settings.update_interval, 1), task.n_dims)

    def basis(self) -> Basis:
        """The functions of a state."""
        return self.settings.on(self.task).features()

    @property
    def traits(self) -> Traits:
        """What it is."""
        return TRAITS[self.name]

    @property
    def epsilon(self) -> float:
        """Exploration rate now (T Eq. 14)."""
        s, task = self.settings, self.task
        exploring = (s.epsilon, s.epsilon_decay, task.sampling_time, min(s.epsilon_min, s.epsilon))
        return float(epsilon_at.py_func(exploring, self.step))

    @property
    def snapshot(self) -> Array:
        """The weights."""
        return self.weights.copy()

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """How good each action is, shape (n_states, n_actions)."""
        return self.features(states) @ (self.weights if snapshot is None else snapshot).T

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Choose ε-greedily; of equal values one at random."""
        if explore and self.rng.random() < self.epsilon:
            return int(self.rng.integers(self.task.n_actions)), Source.EXPLORE
        q = self.values(state[None])[0]
        best = np.flatnonzero(q == q.max())
        if len(best) == 1:
            return int(best[0]), Source.EXPLOIT
        choices = best if len(best) else np.arange(len(q))  # of no numbers none is the best
        return int(self.rng.choice(choices)), Source.EXPLOIT

    def observe(self, transition: Transition) -> bool:
        """Learn from one transition, or keep it; whether an update is due."""
        t = transition
        numbers = (t.reward, *t.state.tolist(), *t.next_state.tolist())
        if all(map(math.isfinite, numbers)) and 0 <= t.action < self.task.n_actions:
            self.step += 1
            self.n_samples += 1
            self.since += 1
            self.take(t)
        else:
            self.dropped += 1
        return self.since >= self.settings.update_interval

    def pretrain(self, demonstrations: Transitions, proceed: Proceed = always) -> Update:
        """Learn from demonstrations, where it can.

        Raises
        ------
        InputError
            When it cannot, or none is usable.
        """
        if not self.traits.demonstrations:
            raise InputError(
                f"learner {self.name} cannot learn from demonstrations; allowed: none, or one of "
                f"{', '.join(informed())}"
            )
        usable = demonstrations.usable(self.task.n_actions)
        self.dropped += int((~usable).sum())
        if not usable.any():
            raise InputError(
                f"none of {len(demonstrations)} demonstrated transitions is usable; allowed: "
                f"finite numbers and actions 0 to {self.task.n_actions - 1}"
            )
        self.n_samples += int(usable.sum())
        return self.inform(demonstrations[usable], proceed)

    def report(self, number: int, before: Array, healthy: bool, text: str) -> Update:
        """An update in words and numbers, after policy `before`."""
        same = before.shape == self.weights.shape
        change = float(np.linalg.norm(self.weights - before)) if same else math.nan
        words = f"update {number}: {text}" if number else f"from demonstrations: {text}"
        return Update(number, self.step, healthy, healthy, change, words, {})

    def health(self) -> Mapping[str, object]:
        """What it is, for a person."""
        return {"method": f"{self.traits.title} ({self.traits.source})"}

    @abstractmethod
    def take(self, transition: Transition) -> None:
        """Learn from a usable transition, or keep it until an update."""

    def inform(self, rows: Transitions, proceed: Proceed) -> Update:
        """Learn from usable demonstrations; asked only of those whose traits say so."""
        raise NotImplementedError(self.name)

    @abstractmethod
    def begin_update(self) -> Callable[[], Any]:
        """Take what was observed; the computation touches nothing here."""

    @abstractmethod
    def finish_update(self, found: Any) -> Update:
        """Take the computation's result."""

    def state(self) -> MethodState:
        """All that a later `restore` needs to go on bit by bit the same."""
        kept = self.buffer
        return MethodState(
            self.weights.copy(), self.memory.copy(),
            BufferState(kept.transitions, kept.born, kept.demonstrated),
            self.waiting.rows(), self.waiting.source,
            **{name: getattr(self, name) for name in _COUNTERS},
            rng=dict(self.rng.bit_generator.state),
        )  # fmt: skip

    def restore(self, state: MethodState) -> None:
        """Go on from what `state` gave.

        Raises
        ------
        InputError
            When it is of other features or actions, or holds what cannot be.
        """
        n, shapes = self.task.n_dims, (state.weights.shape, state.memory.shape)
        if not self.fits(state.weights) or state.memory.shape != self.memory.shape:
            raise InputError(
                f"weights and memory have shapes {shapes}; allowed: "
                f"{(self.weights.shape, self.memory.shape)}, this learner's"
            )
        rows = len(state.kept.transitions)
        widths = {state.waiting.state.shape[1], state.kept.transitions.state.shape[1]}
        finite = np.isfinite(state.weights).all() and np.isfinite(state.memory).all()
        whole = {len(state.kept.born), len(state.kept.demonstrated)} == {rows}
        whole &= len(state.waiting_source) == len(state.waiting)
        if not (finite and whole and widths == {n}):
            raise InputError(
                "its numbers or samples cannot be; allowed: finite weights, samples of "
                f"{n} variables, each with its time and source"
            )
        for name in _COUNTERS:
            if getattr(state, name) < 0:
                raise InputError(f"{name} is {getattr(state, name)}; allowed: 0 or more")
        try:
            self.rng.bit_generator.state = state.rng
        except (TypeError, ValueError, KeyError) as error:
            raise InputError(f"rng is no state of its random generator: {error}") from None
        self.weights, self.memory = state.weights.copy(), state.memory.copy()
        self.buffer = replace(self.buffer, **shallow(state.kept))
        for name in _COUNTERS:
            setattr(self, name, getattr(state, name))
        self.waiting.take()
        for row, chosen in zip(state.waiting, state.waiting_source.tolist(), strict=True):
            self.waiting.append(row._replace(source=chosen))

    def fits(self, weights: Array) -> bool:
        """Whether some weights can be this learner's."""
        return weights.shape == self.weights.shape


class Stepwise(Method):
    """A method that learns at every step; its updates only report."""

    def begin_update(self) -> Callable[[], Any]:
        """Nothing is left to compute."""
        return lambda: None

    def finish_update(self, found: Any) -> Update:
        """Say how much was learned from."""
        self.updates += 1
        self.since = 0
        return self.report(self.updates, _NOT_COMPARED, True, f"{self.n_samples} samples")


class Sampled(Method):
    """A method that keeps samples, and at each update learns from all of them again."""

    Settings: ClassVar[type[Any]] = SampledSettings

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        super().__init__(task, settings, rng)
        grid = replace(
            settings.on(task), buffer_size=settings.buffer_size,
            samples_per_cell=settings.samples_per_cell,
        )  # fmt: skip
        self.buffer = grid.buffer()

    @abstractmethod
    def improve(
        self, rows: Transitions, weights: Array, rng: np.random.Generator, proceed: Proceed
    ) -> tuple[Array | None, str]:
        """New weights, or None for those before, and a line about them; changes nothing here."""

    def take(self, transition: Transition) -> None:
        """Keep it."""
        self.waiting.append(transition)

    def begin_update(self) -> Callable[[], Any]:
        """Take what was observed; the computation learns from all that is kept."""
        shown = np.isin(self.waiting.source, [int(who) for who in PERSON])
        return self._learning(self.waiting.take(), shown, always)

    def finish_update(self, found: Any) -> Update:
        """Take what was computed."""
        self.updates += 1
        self.since = 0
        return self._taken(self.updates, found)

    def inform(self, rows: Transitions, proceed: Proceed) -> Update:
        """Learn from demonstrations as from any samples."""
        return self._taken(0, self._learning(rows, np.ones(len(rows), bool), proceed)())

    def _learning(
        self, batch: Transitions, shown: NDArray[np.bool_], proceed: Proceed
    ) -> Callable[[], Any]:
        kept, step, weights = self.buffer, self.step, self.weights
        rng = np.random.default_rng(self.rng.integers(2**63))

        def compute() -> Any:
            buffer = kept.add(batch, step, shown, at_once=bool(shown.all()))
            return buffer, self.improve(buffer.transitions, weights, rng, proceed)

        return compute

    def _taken(self, number: int, found: Any) -> Update:
        before = self.weights
        self.buffer, (weights, text) = found
        healthy = weights is not None and bool(np.isfinite(weights).all())
        if healthy:
            self.weights = weights
        return self.report(number, before, healthy, text)
