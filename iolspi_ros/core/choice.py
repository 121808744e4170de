"""Choosing an action by Q̂, compiled: one function for single steps and for whole flights."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.basis import Table, weigh
from iolspi_ros.core.learner import Source
from iolspi_ros.core.shield import Guard, allowed, safest

Array = NDArray[np.float64]

_EXPLOIT, _EXPLORE, _SHIELD = int(Source.EXPLOIT), int(Source.EXPLORE), int(Source.SHIELD)


class Choice(NamedTuple):
    """What it takes to choose an action, for compiled code.

    Attributes
    ----------
    table : Table
    weights : ndarray of shape (n_actions, size)
    guard : Guard
    exploring : tuple of float
        Where epsilon starts, its factor per second, T_s [s], and what it never decays below.
    factors, phi, q : ndarray
        Room to work in.
    """

    table: Table
    weights: Array
    guard: Guard
    exploring: tuple[float, float, float, float]
    factors: Array
    phi: Array
    q: Array


@cached_njit(nogil=True)
def epsilon_at(exploring: tuple[float, float, float, float], step: int) -> float:
    """Exploration rate at an online step (T Eq. 14)."""
    start, decay, sampling_time, floor = exploring
    return max(start * decay ** (step * sampling_time), floor)


@cached_njit(nogil=True)
def choose(memory: Choice, rng: np.random.Generator, step: int, state: Array) -> tuple[int, int]:
    """Action and its source (T Algorithm 2, line 5); one of several of the same value at random.

    `OnlineLSPI.act` draws the same in Python: taking a generator over into compiled code costs
    more than all the rest of a single choice.
    """
    if rng.random() < epsilon_at(memory.exploring, step):
        return guarded(memory, state, int(rng.integers(0, len(memory.weights))), _EXPLORE)
    action, count = greedy_action(memory, state, 0)
    if count > 1:
        action, _ = greedy_action(memory, state, int(rng.integers(0, count)))
    return guarded(memory, state, action, _EXPLOIT)


@cached_njit(nogil=True)
def greedy_action(memory: Choice, state: Array, which: int) -> tuple[int, int]:
    """One of the actions of the largest value, counted from 0, and how many there are.

    Values that are no numbers are all as good as another.
    """
    q = memory.q
    weigh(memory.table, memory.weights, state, memory.factors, memory.phi, q)
    most, count, action = q[0], 0, 0
    for a in range(len(q)):
        if q[a] > most:
            most = q[a]
    none = not (q == most).any()
    for a in range(len(q)):
        if none or q[a] == most:
            if count == which:
                action = a
            count += 1
    return action, count


@cached_njit(nogil=True)
def guarded(memory: Choice, state: Array, action: int, source: int) -> tuple[int, int]:
    """The action, or another where the shield vetoes it."""
    guard = memory.guard
    if guard.active and not allowed(guard, state, action):
        weigh(memory.table, memory.weights, state, memory.factors, memory.phi, memory.q)
        return safest(guard, state, memory.q), _SHIELD
    return action, source
