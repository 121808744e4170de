"""What every learner offers. Nodes, commands, checkpoints and reports know only this.

A learner is a class `Learner(task, settings, rng)` registered in the entry-point group
`iolspi_ros.learners`, or named as `module:Class`. It keeps no thread and no clock; nothing here
knows of ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import registry
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]
Proceed = Callable[[float], bool]
"""Told what share of a computation is done, 0 to 1; a false answer ends it early."""

GROUP = "iolspi_ros.learners"
DEFAULT = "iolspi"


class Source(IntEnum):
    """Who chose an action."""

    EXPLOIT = 0
    EXPLORE = 1
    HUMAN = 2
    CORRUPTED = 3
    SCRIPTED = 4
    HOLD = 5
    SHIELD = 6


PERSON = (Source.HUMAN, Source.CORRUPTED)
"""Sources of a person's actions: what they did counts as demonstrated, whenever they did it."""


def always(share: float) -> bool:
    """Go on."""
    return True


@dataclass(frozen=True)
class Update:
    """One update of the policy.

    Attributes
    ----------
    number : int
        Counting from 1; 0 for what was learned from demonstrations.
    step : int
        Online steps so far.
    accepted : bool
        Whether the policy is a new one; otherwise that before stays.
    healthy : bool
        Whether the computation can be believed.
    change : float
        Norm of the change of its numbers that it asked for; NaN where they cannot be compared.
    text : str
        One line for a person.
    facts : mapping of str to float
        The learner's own numbers, for reports; the same names at every update.
    """

    number: int
    step: int
    accepted: bool
    healthy: bool
    change: float
    text: str
    facts: Mapping[str, float]


@runtime_checkable
class Learner(Protocol):
    """Acts, observes, is informed by demonstrations, updates in the background, and is saved.

    Parameters
    ----------
    task : TaskDescription
    settings : instance of `Settings`
    rng : numpy.random.Generator
        Every random draw comes from it.

    Attributes
    ----------
    Settings : type
        Dataclass of everything that it takes, its fields made by `settings.setting`.
    changeable : tuple of str
        Settings that may change while it runs, by assigning `settings`.
    shaping : tuple of str
        Settings that must be the same for its `state` to fit another of its kind.
    State : type
        Dataclass of `state`: arrays, numbers, texts, and dataclasses of such.
    step, n_samples, dropped : int
        Online steps; samples learned from, demonstrations among them; transitions refused.
    """

    Settings: ClassVar[type[Any]]
    State: ClassVar[type[Any]]
    changeable: ClassVar[tuple[str, ...]]
    shaping: ClassVar[tuple[str, ...]]
    task: TaskDescription
    settings: Any
    step: int
    n_samples: int
    updates: int
    dropped: int

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None: ...

    @property
    def epsilon(self) -> float:
        """Exploration rate now."""
        ...

    @property
    def snapshot(self) -> Array:
        """The numbers that make its policy, shape (n_rows, n_columns).

        They are published, kept in reports, and given back to `values`, so they never change;
        what they mean is the learner's.
        """
        ...

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """How good each action is; the greedy policy takes the largest.

        Parameters
        ----------
        states : ndarray of shape (n_states, n_dims)
        snapshot : ndarray, optional
            Of an earlier policy of this learner; that in use by default.

        Returns
        -------
        ndarray of shape (n_states, n_actions)
        """
        ...

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Choose an action in a state, shape (n_dims,); greedily without `explore`."""
        ...

    def observe(self, transition: Transition) -> bool:
        """Take one transition; whether an update is due."""
        ...

    def pretrain(self, demonstrations: Transitions, proceed: Proceed = always) -> Update:
        """Learn from demonstrations, then go on online from there.

        Raises
        ------
        InputError
            When no transition is usable, or it cannot learn from demonstrations.
        """
        ...

    def begin_update(self) -> Callable[[], Any]:
        """Take what was observed; the returned computation may run in another thread."""
        ...

    def finish_update(self, found: Any) -> Update:
        """Take the result of `begin_update`'s computation."""
        ...

    def health(self) -> Mapping[str, object]:
        """What a person may want to know of it besides, by name, for /diagnostics."""
        ...

    def state(self) -> Any:
        """An instance of `State`: all that a later `restore` needs to go on bit by bit the same."""
        ...

    def restore(self, state: Any) -> None:
        """Go on from what `state` gave.

        Raises
        ------
        InputError
            When it does not fit this learner.
        """
        ...


class Kernel(NamedTuple):
    """A learner's choice as compiled code.

    Attributes
    ----------
    choose : callable
        A numba dispatcher `choose(memory, rng, step, state)`: action and source as `act` has them
        at an online step, drawing the same from the same generator.
    memory : tuple
        What `choose` reads; it may write into arrays that are there as room to work in.
    rng : numpy.random.Generator
    step : int
        Online steps so far.
    rows : Transitions
        Where to write what happens next, as many as may be observed before an update is due.
    """

    choose: Callable[..., tuple[int, int]]
    memory: Any
    rng: np.random.Generator
    step: int
    rows: Transitions


@runtime_checkable
class CompiledLearner(Protocol):
    """A learner that can also fly in a compiled loop; optional, and a hundred times faster."""

    def kernel(self, most: int) -> Kernel:
        """Its choice, and room for at most so many transitions."""
        ...

    def flown(self, steps: int, vetoes: int, *, ended: bool, last: bool) -> bool:
        """Take so many rows of `kernel` as observed; whether an update is due.

        Parameters
        ----------
        steps : int
        vetoes : int
            Choices among them whose source was SHIELD.
        ended, last : bool
            Whether the task ended with the last one; whether the episode did.
        """
        ...


def update(learner: Learner) -> Update:
    """Learn from what was observed, at once."""
    return learner.finish_update(learner.begin_update()())


def greedy_policy(
    learner: Learner, snapshot: Array | None = None
) -> Callable[[Array], NDArray[np.int64]]:
    """A greedy policy of a learner: states, shape (n, n_dims), to actions."""
    return lambda states: learner.values(states, snapshot).argmax(axis=1)


def learner_class(name: str) -> type[Learner]:
    """The class of a registered learner, or of `module:Class`.

    Raises
    ------
    InputError
        When there is none; lists those that there are.
    """
    found = registry.find(GROUP, "learner", name)
    lacking = [
        member
        for member in ("Settings", "State", "changeable", "shaping", "act", "observe", "restore")
        if not hasattr(found, member)
    ]
    if lacking:
        raise InputError(
            f"learner {name} has no {', '.join(lacking)}; allowed: a class as described in "
            "iolspi_ros.core.learner.Learner"
        )
    return cast("type[Learner]", found)
