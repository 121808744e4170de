"""What every task offers: a Markov decision process as pure functions on arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Task(Protocol):
    """A Markov decision process with a list of actions.

    A state is the position and velocity of each joint in turn: [q_1, q̇_1, q_2, q̇_2, …], in SI
    units and radians. Nothing here keeps a state or a random generator; every function takes
    one state, shape (n_dims,), or many, shape (n, n_dims).
    """

    name: str
    joints: tuple[str, ...]
    """Names of the joints, in the order of the state."""
    actions: tuple[float, ...]
    """Physical value of each action, in `action_unit`."""
    action_unit: str
    action_names: tuple[str, ...]
    """The same for people."""
    neutral: int
    """Index of the action that does nothing."""
    dt: float
    """Sampling time T_s [s]."""
    episode_steps: int
    """Steps after which the clock cuts an episode."""
    study: int
    """Episodes in which the task can be learned: what a demo flies by default."""
    gamma: float
    """Discount factor of the return that is reported."""
    low: tuple[float, ...]
    high: tuple[float, ...]
    """Limits of the states that occur, per dimension."""
    periodic: tuple[bool, ...]
    """Dimensions that wrap around from `high` to `low`."""
    axes: tuple[str, ...]
    """What each dimension of the state is, with its unit."""
    pictured: tuple[int, int]
    """The two dimensions over which maps are drawn; the others are zero there."""
    success: str
    """What an episode that reached its goal did, as in: all of them end upright."""
    endings: tuple[str, ...]
    """Ways in which an episode ends; the first is that the clock cut it."""
    reference_points: tuple[int, ...]
    """Grid points per dimension that the near-optimal policy takes."""
    reference_lookahead: int
    """Steps that it looks ahead on the model before it trusts these points."""
    compiled: Callable[[Array, int, float, Array, Array], tuple[float, bool]]
    """The dynamics, once and for all: a numba dispatcher to build compiled loops around.

    `compiled(state, action, noise, parameters(time), following)` takes one state, shape
    (n_dims,), writes the next into `following` and returns (reward, terminated). `action` is
    not checked.
    """

    def parameters(self, time: float) -> Array:
        """What `compiled` needs to know of the vehicle at a vehicle time [s], shape (p,)."""
        ...

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
        """Initial conditions that policies are judged from, always the same: (n, n_dims)."""
        ...

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """One initial condition at random, shape (n_dims,)."""
        ...

    def ending(self, reward: Array, terminated: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Which of `endings` the last steps of episodes were, by what they gave; shape (n,)."""
        ...

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether an episode reached its goal.

        Parameters
        ----------
        states : ndarray of shape (n_steps + 1, n, n_dims)
            States of n episodes over time; the last one of an episode that ended early stays.
        rewards : ndarray of shape (n_steps, n)
            Rewards of their steps; zero after the end.

        Returns
        -------
        ndarray of bool, shape (n,)
        """
        ...


def advance(
    one: Callable[..., tuple[float, bool]],
    many: Callable[..., tuple[Array, Array, NDArray[np.bool_]]],
    state: Array,
    action: NDArray[np.int64] | int,
    noise: Array | float,
    parameters: Array,
) -> tuple[Array, Any, Any]:
    """Step one state or many with a task's compiled dynamics.

    `one` is `Task.compiled`; `many` the generalised ufunc around it, which is several times
    slower for a single state.
    """
    if state.ndim > 1:
        return many(state, action, noise, parameters)
    following = np.empty(state.shape)
    reward, terminated = one(state, int(action), float(noise), parameters, following)
    return following, reward, terminated
