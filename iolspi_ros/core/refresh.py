"""Policy iteration on the samples kept: the refreshed form of IOLSPI.

The Λ of T Algorithm 2 mixes the policies of every update before. Here it is rebuilt for each
policy from the samples of a `Buffer`, where no crowd counts more than a few; policies are
iterated from those in use for several δ; and `judge` tells which one to fly.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core import judge
from iolspi_ros.core.buffer import Buffer
from iolspi_ros.core.dual import DualSystem
from iolspi_ros.core.features import Basis
from iolspi_ros.core.learner import Proceed, always
from iolspi_ros.core.lspi import BlockSystem, Iteration, policy_iteration
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.solve import Solve
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

DELTAS = (2e-6, 2e-5, 2e-4, 2e-3)
"""δ that are tried, in units of Γ's own scale."""


@dataclass(frozen=True)
class Judgement:
    """Why which weights are in use.

    Attributes
    ----------
    policies : int
        How many were compared, those in use before among them.
    predicted : float
        Predicted return of the weights now in use; NaN when nothing could be predicted.
    before : float
        That of the weights in use before.
    delta : float
        δ of the weights chosen; 0 when those before stay.
    refused : int
        Solves that were not healthy.
    """

    policies: int
    predicted: float
    before: float
    delta: float
    refused: int

    def describe(self) -> str:
        """One line for a person."""
        text = f"best of {self.policies} policies, predicted return {self.predicted:.5g}"
        text += f" ({self.before:.5g} before)"
        text += f", delta {self.delta:.2g}" if self.delta else ", the weights before stay"
        return text + (f", {self.refused} solves refused" if self.refused else "")


@dataclass(frozen=True)
class Refreshed:
    """What came of the samples kept.

    Attributes
    ----------
    weights : ndarray of shape (n_actions, size)
        To be flown; those in use before when none was better.
    solve : Solve
        Best of the new ones.
    iteration : Iteration
        The policies among which it was.
    judgement : Judgement
    """

    weights: Array
    solve: Solve
    iteration: Iteration
    judgement: Judgement


def refresh(
    buffer: Buffer,
    step: int,
    basis: Basis,
    task: TaskDescription,
    settings: LSPISettings,
    weights: Array,
    starts: Array,
    proceed: Proceed = always,
    among: NDArray[np.bool_] | None = None,
) -> Refreshed:
    """Find the best policy that the samples kept can tell.

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
    starts : ndarray of shape (n_starts, n_dims)
        States in which episodes began.
    proceed : callable
        As in `policy_iteration`; a false answer ends the search.
    among : ndarray of bool, shape (n_samples, n_actions), optional
        Actions to choose from in the next states; see `lspi.BlockSystem`.

    Returns
    -------
    Refreshed
    """
    s = settings
    weight = buffer.weight(step, s.forget_factor)
    # Whichever is smaller: one unknown for each function and action, or one for each sample.
    many = task.n_actions * basis.size > len(buffer) and not len(basis.table.kept)
    kind = DualSystem if many else BlockSystem
    system = kind(buffer.transitions, basis, task.n_actions, task.gamma, weight, 0.0, among=among)
    found = _candidates(system, buffer, s, weights, task.gamma, proceed)
    healthy = [candidate for candidate in found if candidate.solve.healthy]
    if not healthy:
        judgement = Judgement(1, np.nan, np.nan, 0.0, len(found))
        return Refreshed(weights, found[-1].solve, found[-1].iteration, judgement)
    prediction = judge.fit(system, buffer.transitions, basis)
    policies = [weights, *(candidate.solve.weights for candidate in healthy)]
    returns = judge.compare(prediction, policies, starts, task.gamma)
    chosen = judge.best(returns)
    new = healthy[chosen - 1 if chosen else judge.best(returns[1:])]
    judgement = Judgement(
        len(policies), float(returns[chosen, 0]), float(returns[0, 0]),
        new.delta if chosen else 0.0, len(found) - len(healthy),
    )  # fmt: skip
    return Refreshed(policies[chosen], new.solve, new.iteration, judgement)


class _Candidate(NamedTuple):
    """Weights that may be flown, and how they were come by."""

    solve: Solve
    iteration: Iteration
    delta: float


def _candidates(
    system: BlockSystem | DualSystem,
    buffer: Buffer,
    settings: LSPISettings,
    weights: Array,
    gamma: float,
    proceed: Proceed,
) -> list[_Candidate]:
    """The policies of one iteration for each δ, within the budget of time."""
    s = settings
    deadline = time.monotonic() + s.refresh_budget if s.refresh_budget else np.inf

    scale = system.scale()
    found: list[_Candidate] = []
    for number, share in enumerate(DELTAS):

        def go_on(done: float, number: int = number) -> bool:
            return time.monotonic() < deadline and proceed((number + done) / len(DELTAS))

        system.delta = share * scale
        iteration = policy_iteration(
            system, weights, chi=s.chi, max_iterations=s.refresh_iterations, proceed=go_on
        )
        for solve in iteration.solves:
            believed = _believed(solve, system, buffer, gamma)
            found.append(_Candidate(believed, iteration, system.delta))
        if iteration.stop == "interrupted":
            break
    return found


def _believed(
    solve: Solve, system: BlockSystem | DualSystem, buffer: Buffer, gamma: float
) -> Solve:
    """The solve, unhealthy when its values are beyond what the rewards allow."""
    if not solve.healthy:
        return solve
    if judge.plausible(system.values(solve.weights), buffer.transitions.reward, gamma):
        return solve
    return replace(solve, status="diverging")
