"""Policy iteration on the samples kept: the refreshed form of IOLSPI.

The Λ of T Algorithm 2 mixes the policies of every update before. Here it is rebuilt for each
policy from the samples of a `Buffer`, where no crowd counts more than a few, and policies are
iterated from the one in use until one repeats. What has converged is flown; what does not
converge is tried again with more δ.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.buffer import Buffer
from iolspi_ros.core.dual import DualSystem
from iolspi_ros.core.learner import Proceed, always
from iolspi_ros.core.lspi import Iteration, greedy, policy_iteration
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.outliers import doubts
from iolspi_ros.core.reduced import ReducedSystem
from iolspi_ros.core.solve import Solve, plausible
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

DELTAS = (2e-4, 2e-3, 2e-2)
"""δ in units of Γ's own scale, each for when the one before does not converge."""
STOPS = ("converged", "cap", "oscillating", "diverging", "interrupted", "unhealthy")
"""How an update can end: as an `Iteration`, or with a solve that is not to be believed."""


@dataclass(frozen=True)
class Refresh:
    """How an update came to its weights.

    Attributes
    ----------
    iterations : int
        Policies solved for, with all δ.
    stop : str
        One of `STOPS`, of the last δ.
    delta : float
        The last δ.
    rungs : int
        How many δ were tried.
    used : bool
        Whether its weights are used: they are when they have converged, or when they can be
        believed and nothing was learned before. Otherwise those before stay.
    doubted : int
        Samples kept that are not learned from, since they cannot be true.
    reasons : tuple of str
        Why not.
    """

    iterations: int
    stop: str
    delta: float
    rungs: int
    used: bool
    doubted: int = 0
    reasons: tuple[str, ...] = ()

    def describe(self) -> str:
        """One line for a person."""
        text = f"{self.stop}, delta {self.delta:.2g}"
        text += f" after {self.rungs - 1} smaller" if self.rungs > 1 else ""
        if not self.used:
            text += ", the weights before stay"
        elif self.stop != STOPS[0]:
            text += ", used all the same: nothing was learned before"
        if not self.doubted:
            return text
        return f"{text}; {self.doubted} samples not believed: {', '.join(self.reasons) or '-'}"


class Refreshed(NamedTuple):
    """What came of the samples kept.

    Attributes
    ----------
    weights : ndarray of shape (n_actions, size)
        To be flown; those given when nothing converged.
    solve : Solve
        The last one.
    iteration : Iteration, optional
        That with the last δ; none where no sample is believed.
    record : Refresh
    """

    weights: Array
    solve: Solve
    iteration: Iteration | None
    record: Refresh


def refresh(
    buffer: Buffer,
    step: int,
    basis: Basis,
    task: TaskDescription,
    settings: LSPISettings,
    weights: Array,
    proceed: Proceed = always,
    among: NDArray[np.bool_] | None = None,
    limits: tuple[Array | float, Array | float] = (-np.inf, np.inf),
    old: Basis | None = None,
    *,
    anything: bool = False,
) -> Refreshed:
    """Find the policy that the samples kept converge to.

    Parameters
    ----------
    buffer : Buffer
        With at least one sample.
    step : int
        Online step k, from which the age of samples counts.
    basis : Basis
    task : TaskDescription
    settings : LSPISettings
    weights : ndarray of shape (n_actions, size)
        In use; every iteration starts there.
    proceed : callable
        As in `policy_iteration`; a false answer ends the search.
    among : ndarray of bool, shape (n_samples, n_actions), optional
        Actions to choose from in the next states; see `lspi.BlockSystem`.
    limits : tuple of two ndarray of shape (n_dims,), or float
        Of the states; see `outliers.doubts`.
    old : Basis, optional
        Functions of `weights`, when these are others.
    anything : bool
        Nothing was learned before: what can be believed is used without having converged.

    Returns
    -------
    Refreshed
    """
    rows = buffer.transitions
    doubt = doubts(rows, *limits)
    weight = buffer.weight(step, settings.forget_factor, ~doubt.rows)
    if doubt.rows.any():
        rows, weight = rows[~doubt.rows], weight[~doubt.rows]
        among = None if among is None else among[~doubt.rows]
    if not len(rows):
        nothing = Solve(weights, np.inf, 0, np.inf, "singular")
        record = Refresh(0, STOPS[-1], 0.0, 0, False, len(doubt.rows), doubt.reasons)
        return Refreshed(weights, nothing, None, record)
    # Whichever is smaller: one unknown for each function and action, or one for each sample.
    kind = DualSystem if 0 < len(rows) < task.n_actions * basis.size else ReducedSystem
    system = kind(rows, basis, task.n_actions, task.gamma, weight, DELTAS[0], among=among)
    first = None
    if old is not None and old is not basis:
        first = greedy(weights, old(rows.next_state, rows.terminated), among=among)
        start = np.zeros((task.n_actions, basis.size))
    else:
        start = weights
    climbed = _climb(system, start, first, rows.reward, task.gamma, settings, proceed)
    found, stop = climbed.found, climbed.stop
    used = stop == STOPS[0] or (anything and climbed.solve.healthy)
    record = Refresh(
        climbed.policies, stop, system.delta, climbed.rungs, used, int(doubt.rows.sum()),
        doubt.reasons,
    )  # fmt: skip
    return Refreshed(climbed.solve.weights if used else weights, climbed.solve, found, record)


class _Climbed(NamedTuple):
    """Policy iterations with one δ after the other."""

    found: Iteration
    solve: Solve
    stop: str
    policies: int
    rungs: int


def _climb(
    system: DualSystem | ReducedSystem,
    start: Array,
    first: NDArray[np.int64] | None,
    reward: Array,
    gamma: float,
    settings: LSPISettings,
    proceed: Proceed,
) -> _Climbed:
    """Iterate with the first δ, and with the next as long as it does not converge."""
    budget = settings.refresh_budget
    deadline = time.monotonic() + budget if budget else np.inf
    # Weights are as large as rewards: of small ones, what changes little is no less.
    chi = settings.chi * min(1.0, float(np.abs(reward).max()))
    done = 0
    for rung, share in enumerate(DELTAS):

        def go_on(part: float, rung: int = rung) -> bool:
            return time.monotonic() < deadline and proceed((rung + part) / len(DELTAS))

        system.delta = share * system.scale
        found = policy_iteration(
            system, start, chi=chi, max_iterations=settings.refresh_iterations, proceed=go_on,
            first=first,
        )  # fmt: skip
        done, solve = done + found.iterations, found.solve
        if solve.healthy and not plausible(system.values(solve.weights), reward, gamma):
            solve = replace(solve, status="diverging")
        stop = found.stop if solve.healthy else STOPS[-1]
        if stop in ("converged", "interrupted"):
            break
    return _Climbed(found, solve, stop, done, rung + 1)
