"""All that a learner by least-squares policy iteration needs to go on bit by bit the same."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.kernels import Kernels
from iolspi_ros.core.moments import Moments
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]


@dataclass(frozen=True)
class KernelState:
    """Functions around samples, as of `kernels.Kernels`; without a point for a grid."""

    points: Array
    scales: Array
    periods: Array
    width: float

    @classmethod
    def of(cls, features: Basis, n_dims: int) -> KernelState:
        """Of some functions."""
        if isinstance(features, Kernels):
            return cls(features.points, features.scales, features.periods, features.width)
        return cls(np.empty((0, n_dims)), np.empty(0), np.empty(0), 1.0)

    def kernels(self, n_dims: int) -> Kernels:
        """The functions.

        Raises
        ------
        InputError
            When they are none of so many variables.
        """
        shapes = (self.scales.shape, self.periods.shape)
        fits = self.points.ndim == 2 and self.points.shape[1] == n_dims
        fits = fits and shapes == ((n_dims,), (n_dims,)) and len(self.points) > 0
        if not (fits and np.isfinite(self.points).all()):
            raise InputError(
                f"kernels have points of shape {self.points.shape}; allowed: finite, (n, {n_dims})"
            )
        if not (self.width > 0.0 and (self.scales > 0.0).all()):
            raise InputError("kernels have a width or scale that is not positive")
        return Kernels(self.points, self.scales, self.periods, self.width)


@dataclass(frozen=True)
class BufferState:
    """Samples kept, as of `buffer.Buffer`."""

    transitions: Transitions
    born: NDArray[np.int64]
    demonstrated: NDArray[np.bool_]


@dataclass(frozen=True)
class ShieldState:
    """What the shield has seen, as of `shield.Shield`."""

    gram: Array
    cross: Array
    seen: Array
    ended: Array


@dataclass(frozen=True)
class LSPIState:
    """Everything that goes on bit by bit the same.

    Attributes
    ----------
    weights : ndarray of shape (n_actions, size)
    kernels : KernelState
    moments : Moments
    buffer : BufferState
    shield : ShieldState
    batch : Transitions
        Observed since the last update.
    batch_source : ndarray of int, shape (n_samples,)
        Who chose their actions; empty for a state from before that was known.
    step, n_samples, updates, dropped, vetoes : int
    rng : dict
        State of the random generator.
    """

    weights: Array
    kernels: KernelState
    moments: Moments
    buffer: BufferState
    shield: ShieldState
    batch: Transitions
    step: int
    n_samples: int
    updates: int
    dropped: int
    vetoes: int
    rng: dict[str, Any]
    batch_source: NDArray[np.int64] = dataclasses.field(
        default_factory=lambda: np.zeros(0, np.int64)
    )


COUNTERS = ("step", "n_samples", "updates", "dropped", "vetoes")


def check(state: LSPIState, mine: LSPIState, task: TaskDescription, size: int) -> None:
    """Raise unless a state fits a learner.

    Parameters
    ----------
    state : LSPIState
    mine : LSPIState
        That of the learner as it is.
    task : TaskDescription
    size : int
        Number of functions of the state's features.

    Raises
    ------
    InputError
        When it was made with other actions or features, or holds what cannot be.
    """
    shape, kept = (task.n_actions, size), state.buffer
    if state.weights.shape != shape:
        raise InputError(f"weights have shape {state.weights.shape}; allowed: {shape}")
    if not np.isfinite(state.weights).all():
        raise InputError("weights are not all finite; allowed: finite numbers")
    for name in ("moments", "shield"):
        _check_like(name, getattr(state, name), getattr(mine, name))
    for name, rows in (("batch", state.batch), ("buffer", kept.transitions)):
        fits = rows.state.shape[1] == task.n_dims
        if not (fits and rows.usable(task.n_actions).all()):
            raise InputError(
                f"{name} holds transitions that are none of task {task.name}; allowed: "
                f"{task.n_dims} finite variables, actions 0 to {task.n_actions - 1}"
            )
    if not len(kept.born) == len(kept.demonstrated) == len(kept.transitions):
        raise InputError("buffer has columns of different lengths; allowed: one length")
    if len(state.batch_source) not in (0, len(state.batch)):
        raise InputError("batch has columns of different lengths; allowed: one length")


def _check_like(name: str, found: Any, mine: Any) -> None:
    """Raise unless the arrays of a part have the shapes of ours and are finite where they are."""
    for field in fields(mine):
        here, there = getattr(mine, field.name), getattr(found, field.name)
        if not isinstance(here, np.ndarray):
            continue
        if there.shape != here.shape:
            raise InputError(f"{name} {field.name} has shape {there.shape}; allowed: {here.shape}")
        if np.isfinite(here).all() and not np.isfinite(there).all():
            raise InputError(f"{name} {field.name} is not all finite; allowed: finite numbers")


def shallow(part: Any) -> dict[str, Any]:
    """Fields of a dataclass by name."""
    return {field.name: getattr(part, field.name) for field in fields(part)}
