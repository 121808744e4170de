"""Transitions as arrays; an end of the task and a cut of the clock kept apart."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError

Array = NDArray[np.float64]


class Transition(NamedTuple):
    """One step of one episode.

    Attributes
    ----------
    state, next_state : ndarray of shape (n_dims,)
        s_k and s_{k+1}, SI units and radians.
    action : int
        Index of a_k in the task's list of actions.
    reward : float
        r_{k+1} (T Eq. 3).
    terminated : bool
        The task ended in `next_state`: nothing follows, its value is zero.
    truncated : bool
        The episode was cut there by the clock: its value goes on.
    source : int
        Who chose a_k, as numbered by `learner.Source`; -1 when nobody says.
    """

    state: Array
    action: int
    reward: float
    next_state: Array
    terminated: bool = False
    truncated: bool = False
    source: int = -1


@dataclass(frozen=True)
class Transitions:
    """A batch of transitions, in the order in which they happened.

    Parameters
    ----------
    state, next_state : ndarray of shape (n_samples, n_dims)
    action : ndarray of int, shape (n_samples,)
    reward : ndarray of shape (n_samples,)
    terminated, truncated : ndarray of bool, shape (n_samples,)
    """

    state: Array
    action: NDArray[np.int64]
    reward: Array
    next_state: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]

    def __post_init__(self) -> None:
        if self.state.ndim != 2 or self.state.shape != self.next_state.shape:
            raise InputError(
                f"state has shape {self.state.shape} and next_state {self.next_state.shape}; "
                "allowed: the same (n_samples, n_dims)"
            )
        for name in ("action", "reward", "terminated", "truncated"):
            shape = getattr(self, name).shape
            if shape != (len(self),):
                raise InputError(f"{name} has shape {shape}; allowed: ({len(self)},)")

    def __len__(self) -> int:
        return len(self.state)

    def __getitem__(self, rows: slice | NDArray[np.bool_] | NDArray[np.int64]) -> Transitions:
        return Transitions(*(getattr(self, field.name)[rows] for field in fields(self)))

    def __add__(self, other: Transitions) -> Transitions:
        pairs = ((getattr(self, f.name), getattr(other, f.name)) for f in fields(self))
        return Transitions(*(np.concatenate(pair) for pair in pairs))

    def __iter__(self) -> Iterator[Transition]:
        for k in range(len(self)):
            yield Transition(
                self.state[k],
                int(self.action[k]),
                float(self.reward[k]),
                self.next_state[k],
                bool(self.terminated[k]),
                bool(self.truncated[k]),
            )

    @classmethod
    def of(cls, transitions: Iterable[Transition], n_dims: int) -> Transitions:
        """Stack single transitions; `n_dims` gives the width when there are none."""
        rows = list(transitions)
        return cls(
            np.array([t.state for t in rows], float).reshape(-1, n_dims),
            np.array([t.action for t in rows], np.int64),
            np.array([t.reward for t in rows], float),
            np.array([t.next_state for t in rows], float).reshape(-1, n_dims),
            np.array([t.terminated for t in rows], bool),
            np.array([t.truncated for t in rows], bool),
        )

    def usable(self, n_actions: int) -> NDArray[np.bool_]:
        """Rows whose numbers are finite and whose action exists, shape (n_samples,)."""
        return (
            np.isfinite(self.state).all(axis=1)
            & np.isfinite(self.next_state).all(axis=1)
            & np.isfinite(self.reward)
            & (self.action >= 0)
            & (self.action < n_actions)
        )


class Batch:
    """Transitions written into arrays that are there already, until somebody takes them.

    Parameters
    ----------
    room : int
        Transitions expected; more double the room.
    n_dims : int
    """

    def __init__(self, room: int, n_dims: int) -> None:
        self._columns = Transitions(
            np.empty((room, n_dims)),
            np.empty(room, np.int64),
            np.empty(room),
            np.empty((room, n_dims)),
            np.empty(room, bool),
            np.empty(room, bool),
        )
        self._source = np.empty(room, np.int64)
        self._used = 0

    def __len__(self) -> int:
        return self._used

    def reserve(self, count: int) -> Transitions:
        """Rows to write the next transitions into, neither ended nor cut; see `written`."""
        while self._used + count > len(self._columns):
            doubled = np.arange(2 * len(self._columns)) % len(self._columns)
            self._columns, self._source = self._columns[doubled], self._source[doubled]
        rows = self._columns[self._used : self._used + count]
        self._source[self._used : self._used + count] = -1
        rows.terminated[:] = False
        rows.truncated[:] = False
        return rows

    def written(self, count: int) -> None:
        """So many of the reserved rows hold a transition now."""
        self._used += count

    def end(self, terminated: bool) -> None:
        """The last transition ended its episode, or the clock cut it there."""
        self._columns.terminated[self._used - 1] = terminated
        self._columns.truncated[self._used - 1] = not terminated

    def append(self, transition: Transition) -> None:
        """Write one more."""
        if self._used == len(self._columns):
            self.reserve(1)
        columns, row = self._columns, self._used
        columns.state[row] = transition.state
        columns.action[row] = transition.action
        columns.reward[row] = transition.reward
        columns.next_state[row] = transition.next_state
        columns.terminated[row] = transition.terminated
        columns.truncated[row] = transition.truncated
        self._source[row] = transition.source
        self._used += 1

    def rows(self) -> Transitions:
        """A copy of what is there."""
        return self._columns[np.arange(self._used)]

    @property
    def source(self) -> NDArray[np.int64]:
        """Who chose the action of each, shape (n_samples,); -1 where nobody says."""
        return self._source[: self._used].copy()

    def take(self) -> Transitions:
        """What is there, and begin anew."""
        rows = self.rows()
        self._used = 0
        return rows


class Observation(NamedTuple):
    """What a vehicle shows of itself after a step.

    Attributes
    ----------
    episode, step : int
        The key: which state of which episode this is.
    state : ndarray of shape (n_dims,)
        Measured: with the sensor's noise.
    reward : float
        For the step that led here; 0 at the first state of an episode.
    action : int
        Index of the action that led here; -1 at the first state of an episode.
    terminated, truncated : bool
    stamp : int
        Vehicle time [ns], on a clock that gives every observation its own; 0 without one.
    source : int
        Who chose that action, as numbered by `learner.Source`; -1 when nobody says.
    """

    episode: int
    step: int
    state: Array
    reward: float = 0.0
    action: int = -1
    terminated: bool = False
    truncated: bool = False
    stamp: int = 0
    source: int = -1

    @property
    def last(self) -> bool:
        """Whether the episode ends here."""
        return self.terminated or self.truncated


def transition_between(before: Observation, after: Observation) -> Transition:
    """The step from one observation to the next."""
    return Transition(
        before.state, after.action, after.reward, after.state, after.terminated, after.truncated,
        after.source,
    )  # fmt: skip


@dataclass(frozen=True)
class Sample:
    """A demonstrated transition with where it belongs and who flew it.

    Attributes
    ----------
    episode, step : int
        Key of the state that it left.
    stamp : int
        Vehicle time of that state [ns].
    transition : Transition
    source : int
        Who chose the action, as numbered by `online.Source`; -1 when nobody says.
    """

    episode: int
    step: int
    stamp: int
    transition: Transition
    source: int
