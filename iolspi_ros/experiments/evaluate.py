"""How good a policy is: its return from every initial condition, learning turned off."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.features import Basis
from iolspi_ros.core.lspi import greedy
from iolspi_ros.core.reference import Grid, NearOptimal, near_optimal
from sim_nodes.tasks.base import Task

Array = NDArray[np.float64]
Policy = Callable[[Array], NDArray[np.int64]]


@dataclass(frozen=True)
class Evaluation:
    """Episodes flown by one policy, one from each initial condition.

    Attributes
    ----------
    states : ndarray of shape (n_steps + 1, n, n_dims)
    actions : ndarray of int, shape (n_steps, n)
    discounted : ndarray of shape (n,)
        Discounted return of each (T Eq. 4).
    succeeded : ndarray of bool, shape (n,)
    """

    states: Array
    actions: NDArray[np.int64]
    discounted: Array
    succeeded: NDArray[np.bool_]

    @property
    def discounted_return(self) -> float:
        """Mean discounted return over the initial conditions (T IV)."""
        return float(self.discounted.mean())

    @property
    def success_fraction(self) -> float:
        """Share of the episodes that reached the goal."""
        return float(self.succeeded.mean())


def policy_of(weights: Array, features: Basis) -> Policy:
    """The greedy policy of some weights, shape (n_actions, size)."""
    return lambda states: greedy(weights, features(states))


def evaluate(task: Task, policy: Policy, time: float = 0.0) -> Evaluation:
    """Fly one episode from every initial condition, all at once and without noise.

    Parameters
    ----------
    task : Task
    policy : callable
        States, shape (n, n_dims), to actions, shape (n,).
    time : float
        Vehicle time at which conditions are taken [s].

    Returns
    -------
    Evaluation
    """
    state = task.initial_states()
    alive = np.ones(len(state), bool)
    total, discount = np.zeros(len(state)), 1.0
    states, actions = [state], []
    for _ in range(task.episode_steps):
        action = policy(state)
        following, reward, terminated = task.step(state, action, time)
        total += np.where(alive, discount * reward, 0.0)
        state = np.where(alive[:, None], following, state)
        alive &= ~terminated
        discount *= task.gamma
        states.append(state)
        actions.append(action)
    history = np.stack(states)
    return Evaluation(history, np.stack(actions), total, task.succeeded(history))


def near_optimal_policy(task: Task, points: int = 301, time: float = 0.0) -> NearOptimal:
    """The yardstick: dynamic programming on the task's model (T has none).

    Parameters
    ----------
    task : Task
    points : int
        Grid points per dimension.
    time : float
        Vehicle time at which conditions are taken [s].
    """
    grid = Grid(task.low, task.high, (points,) * len(task.low), task.periodic)
    return near_optimal(
        lambda states, actions: task.step(states, actions, time),
        grid,
        len(task.actions),
        task.gamma,
    )
