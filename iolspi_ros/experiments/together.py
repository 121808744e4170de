"""Flying a policy on vehicles that keep their state to themselves: one of each seed, in step."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import Stateful

Array = NDArray[np.float64]


def fly_together(
    vehicle: Stateful, policy: Callable[[Array], NDArray[np.int64]]
) -> tuple[Array, NDArray[np.int64], Array, NDArray[np.bool_]]:
    """Fly one episode from each of a vehicle's starts, without noise.

    Parameters
    ----------
    vehicle : Stateful
        Stays as it is: others of its kind fly.
    policy : callable
        States, shape (n, n_dims), to actions, shape (n,).

    Returns
    -------
    states : ndarray of shape (n_steps + 1, n, n_dims)
        The last one of an episode that ended stays.
    actions : ndarray of int, shape (n_steps, n)
        -1 after the end.
    rewards : ndarray of shape (n_steps, n)
        Zero after the end.
    terminated : ndarray of bool, shape (n,)
    """
    count, about = vehicle.starts, vehicle.description
    terminated, alive = np.zeros(count, bool), np.ones(count, bool)
    actions: list[NDArray[np.int64]] = []
    rewards: list[Array] = []
    with ExitStack() as held:
        flying = [vehicle.fresh() for _ in range(count)]
        for one in flying:
            held.callback(one.close)
        state = np.array([one.begin(seed) for seed, one in enumerate(flying)])
        states = [state]
        while alive.any() and len(actions) < about.episode_steps:
            state, reward, action = state.copy(), np.zeros(count), np.full(count, -1)
            up = np.flatnonzero(alive)
            action[up] = policy(state[up])
            for n in up.tolist():
                state[n], reward[n], terminated[n], cut = flying[n].advance(int(action[n]))
                alive[n] = not (terminated[n] or cut)
            states.append(state)
            actions.append(action)
            rewards.append(reward)
    return np.stack(states), np.stack(actions), np.stack(rewards), terminated
