"""Tabular Q-learning by whole episodes, alone or after demonstrations (T Algorithms 9 and 10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.errors import check_range
from iolspi_ros.task.finite import FiniteTask

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]


@dataclass(frozen=True)
class Episode:
    """One episode.

    Attributes
    ----------
    states : ndarray of int, shape (n_steps + 1,)
    actions : ndarray of int, shape (n_steps,)
    rewards : ndarray of shape (n_steps,)
    """

    states: Numbers
    actions: Numbers
    rewards: Array

    @property
    def score(self) -> float:
        """Its return: the sum of its rewards."""
        return float(self.rewards.sum())


@dataclass(frozen=True)
class Learned:
    """What Q-learning has come to.

    Attributes
    ----------
    q : ndarray of shape (n_states, n_actions)
    visits : ndarray of int32, shape (n_states, n_actions)
        Times that each action was taken in each state.
    scores : ndarray of shape (n_episodes,)
        Return of each episode, exploration and all.
    """

    q: Array
    visits: NDArray[np.int32]
    scores: Array


def fly(task: FiniteTask, start: int, actions: Sequence[int]) -> Episode:
    """An episode with given actions, until a goal is reached; the last one is held.

    Parameters
    ----------
    task : FiniteTask
    start : int
    actions : sequence of int
        One or more.
    """
    states, taken, rewards = [start], [], []
    for k in range(task.horizon):
        taken.append(actions[min(k, len(actions) - 1)])
        states.append(int(task.successor[states[-1], taken[-1]]))
        rewards.append(float(task.arrival[states[-1]]))
        if task.goal[states[-1]]:
            rewards[-1] += task.reached[k + 1]
            break
    else:
        rewards[-1] += task.missed
    return Episode(np.array(states), np.array(taken), np.array(rewards))


def initial(task: FiniteTask, value: float, demonstrations: Sequence[Episode] = ()) -> Array:
    """Q before learning: one value, and the mean return wherever a demonstration has been.

    The mean is that of every visit (T Algorithm 10, lines 6 to 11).

    Parameters
    ----------
    task : FiniteTask
    value : float
        Q_0.
    demonstrations : sequence of Episode

    Returns
    -------
    ndarray of shape (n_states, n_actions)
    """
    q = np.full(task.successor.shape, value)
    seen: dict[tuple[int, int], int] = {}
    for episode in demonstrations:
        returns = np.cumsum(episode.rewards[::-1])[::-1]
        pairs = zip(episode.states[:-1].tolist(), episode.actions.tolist(), strict=True)
        for pair, value_here in zip(pairs, returns, strict=True):
            seen[pair] = seen.get(pair, 0) + 1
            if seen[pair] == 1:
                q[pair] = value_here
            q[pair] += (value_here - q[pair]) / seen[pair]
    return q


def learn(
    task: FiniteTask,
    q: Array,
    starts: Numbers,
    episodes: int,
    *,
    epsilon: float,
    alpha: float,
    rng: np.random.Generator,
) -> Learned:
    """Q-learning with ε-greedy exploration and an update at the end of each episode.

    Every pair of state and action of an episode moves towards the return from there on, in the
    order in which it happened (T Algorithm 9; Algorithm 10 from line 12 on). Equal values are
    drawn from.

    Parameters
    ----------
    task : FiniteTask
    q : ndarray of shape (n_states, n_actions)
        Before; left unchanged.
    starts : ndarray of int, shape (n_starts,)
        Where episodes begin, all as likely.
    episodes : int
        K.
    epsilon, alpha : float in [0, 1]
        ε and α.
    rng : numpy.random.Generator

    Returns
    -------
    Learned
    """
    check_range("epsilon", epsilon, 0.0, 1.0)
    check_range("alpha", alpha, 0.0, 1.0)
    q, scores = q.copy(), np.empty(episodes)
    visits = np.zeros(q.shape, np.int32)
    _learn(task.tables, np.asarray(starts), epsilon, alpha, rng, q, visits, scores)
    return Learned(q, visits, scores)


def greedy(task: FiniteTask, q: Array, start: int) -> Episode:
    """The episode that follows the largest values; of equal ones the first."""
    actions: list[int] = []
    state = start
    for _ in range(task.horizon):
        actions.append(int(q[state].argmax()))
        state = int(task.successor[state, actions[-1]])
        if task.goal[state]:
            break
    return fly(task, start, actions)


def optimal_values(task: FiniteTask) -> Array:
    """Largest return from each state after k steps, by dynamic programming backwards in time.

    Returns
    -------
    ndarray of shape (horizon + 1, n_states)
    """
    values = np.full((task.horizon + 1, len(task.goal)), task.missed)
    for k in range(task.horizon - 1, -1, -1):
        onward = task.arrival + np.where(task.goal, task.reached[k + 1], values[k + 1])
        values[k] = onward[task.successor].max(axis=1)
    return values


def optimal(task: FiniteTask, start: int) -> Episode:
    """An episode that no other from there beats."""
    values, state = optimal_values(task), start
    actions: list[int] = []
    for k in range(task.horizon):
        following = task.successor[state]
        beyond = np.where(task.goal[following], task.reached[k + 1], values[k + 1, following])
        actions.append(int((task.arrival[following] + beyond).argmax()))
        state = int(following[actions[-1]])
        if task.goal[state]:
            break
    return fly(task, start, actions)


@cached_njit(nogil=True)
def _choose(values: Array, rng: np.random.Generator) -> int:
    """Number of the largest value, drawn among equal ones."""
    best, equal = 0, 1
    for a in range(1, len(values)):
        if values[a] > values[best]:
            best, equal = a, 1
        elif values[a] == values[best]:
            equal += 1
            if rng.random() * equal < 1.0:
                best = a
    return best


@cached_njit(nogil=True)
def _learn(
    tables: tuple[NDArray[np.int32], Array, NDArray[np.bool_], Array, float],
    starts: Numbers,
    epsilon: float,
    alpha: float,
    rng: np.random.Generator,
    q: Array,
    visits: NDArray[np.int32],
    scores: Array,
) -> None:
    """Fly and learn, in place."""
    successor, arrival, goal, reached, missed = tables
    horizon, n_actions = len(reached) - 1, q.shape[1]
    states, actions = np.empty(horizon, np.int64), np.empty(horizon, np.int64)
    rewards = np.empty(horizon)
    for episode in range(len(scores)):
        state = starts[rng.integers(0, len(starts))]
        steps = 0
        while steps < horizon:
            if rng.random() < epsilon:
                action = int(rng.integers(0, n_actions))
            else:
                action = _choose(q[state], rng)
            states[steps], actions[steps] = state, action
            visits[state, action] += 1
            state = int(successor[state, action])
            rewards[steps] = arrival[state]
            steps += 1
            if goal[state]:
                rewards[steps - 1] += reached[steps]
                break
        else:
            rewards[steps - 1] += missed
        for j in range(steps - 2, -1, -1):
            rewards[j] += rewards[j + 1]
        scores[episode] = rewards[0]
        for j in range(steps):
            q[states[j], actions[j]] += alpha * (rewards[j] - q[states[j], actions[j]])
