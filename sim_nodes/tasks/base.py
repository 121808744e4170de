"""What every task offers: a Markov decision process as pure functions on arrays."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Task(Protocol):
    """A Markov decision process with a list of actions.

    A state is the position and velocity of each joint in turn: [q_1, q̇_1, q_2, q̇_2, …], in SI
    units and radians. Nothing here draws a random number or keeps a state; every function
    takes one state, shape (n_dims,), or many, shape (n, n_dims).
    """

    name: str
    joints: tuple[str, ...]
    """Names of the joints, in the order of the state."""
    actions: tuple[float, ...]
    """Physical value of each action, in `action_unit`."""
    action_unit: str
    neutral: int
    """Index of the action that does nothing."""
    dt: float
    """Sampling time T_s [s]."""
    episode_steps: int
    """Steps after which the clock cuts an episode."""
    gamma: float
    """Discount factor of the return that is reported."""
    low: tuple[float, ...]
    high: tuple[float, ...]
    """Limits of the states that occur, per dimension."""
    periodic: tuple[bool, ...]
    """Dimensions that wrap around from `high` to `low`."""

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | int,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Any, Any]:
        """Next state, reward and whether the task ended there.

        Parameters
        ----------
        state : ndarray of shape (n_dims,) or (n, n_dims)
        action : int or ndarray of int, shape (n,)
            Index into `actions`.
        time : float
            Vehicle time [s], for what changes with time.
        noise : float or ndarray of shape (n,)
            Added to the physical action (T Eq. 10-1), in `action_unit`.

        Returns
        -------
        next_state : ndarray like `state`
        reward : float or ndarray of shape (n,)
        terminated : bool or ndarray of bool, shape (n,)
        """
        ...

    def initial_states(self) -> Array:
        """Every initial condition, shape (n, n_dims)."""
        ...

    def succeeded(self, states: Array) -> NDArray[np.bool_]:
        """Whether an episode reached its goal.

        Parameters
        ----------
        states : ndarray of shape (n_steps + 1, n, n_dims)
            States of n episodes over time.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        ...
