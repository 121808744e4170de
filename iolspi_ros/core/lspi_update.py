"""What an update of least-squares policy iteration computes, and what is said of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.buffer import Buffer
from iolspi_ros.core.learner import Update
from iolspi_ros.core.lspi import Iteration
from iolspi_ros.core.moments import Moments
from iolspi_ros.core.refresh import STOPS, Refresh
from iolspi_ros.core.shield import Shield
from iolspi_ros.core.solve import STATUSES, Solve

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Computed:
    """What an update's computation gives, to be taken by `finish_update`."""

    weights: Array
    solve: Solve
    moments: Moments
    buffer: Buffer
    shield: Shield
    features: Basis
    refresh: Refresh | None = None
    iteration: Iteration | None = None


@dataclass(frozen=True)
class LSPIUpdate(Update):
    """One policy update, with what it came from.

    Attributes
    ----------
    solve : Solve
        Its weights are those that the update found.
    refresh : Refresh, optional
        What came of the samples kept, of a refreshed update.
    iteration : Iteration, optional
        The policy iteration that the weights come from, when there was one.
    """

    solve: Solve
    refresh: Refresh | None
    iteration: Iteration | None


def described(number: int, accepted: bool, found: Computed) -> str:
    """One line for a person."""
    parts = [f"update {number}" if number else "offline LSPI"]
    if found.iteration:
        parts[0] += f": {found.iteration.describe()}"
    if found.refresh:
        parts.append(found.refresh.describe())
    if not (found.iteration or found.refresh):
        kept = "" if accepted else ", the weights before stay"
        parts.append(f"solve {found.solve.status}{kept}")
    return "; ".join(parts)


def facts(found: Computed) -> dict[str, float]:
    """Numbers of an update, for reports."""
    solve, kept = found.solve, found.refresh
    return {
        "condition": solve.condition,
        "rank": solve.rank,
        "residual": solve.residual,
        "status": STATUSES.index(solve.status),
        "iterations": kept.iterations if kept else 0,
        "stop": STOPS.index(kept.stop) if kept else 0,
        "delta": kept.delta if kept else 0.0,
        "rungs": kept.rungs if kept else 0,
        "doubted": kept.doubted if kept else 0,
    }
