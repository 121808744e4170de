"""What every vehicle offers: a Markov decision process as pure functions on arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

G = 9.81
"""Gravitational acceleration [m/s²]."""
USUAL_EPISODES = 200


class Task(Protocol):
    """A Markov decision process with a list of actions.

    A state has the variables of the description, in its order, in SI units and radians. Nothing
    here keeps a state or a random generator; every function takes one state, shape (n_dims,), or
    many, shape (n, n_dims). A class registered in the entry-point group `iolspi_ros.tasks`, or
    named as `module:Class`, is made without arguments; when it is a settings dataclass, its fields
    are parameters of the simulator.

    What a task may have besides, and what goes without it:

    - `compiled`, `parameters(time)`: see `Compiled`; else training goes step by step.
    - `succeeded(states, rewards)`: see `Judging`; else the endings say who succeeded.
    - `reference_points`, `reference_lookahead`: see `Reference`; else reports have no baseline.
    - `as_flown()`: the `Stateful` vehicle that its settings make, None for the task itself.
    - `usual_episodes`: episodes in which it can be learned; else `USUAL_EPISODES`.
    - `pilot(mode, rng)`: the law of a scripted pilot (`law.Law`), None for a mode it does not have.
    - `picture(state)`: shapes for RViz, the animation of a report and the cockpit.
    - `image()`: pixels of shape (height, width, 3), uint8, or None for nothing yet; for those who
      draw themselves, as environments of Gymnasium do. Shown where there is no `picture`.
    - `released(before, reward, times)` with `picture(state, released)`, and
      `trail(states, reward)`: what falls after an episode's last step, and what to draw of it.
    """

    description: TaskDescription

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


@runtime_checkable
class Stateful(Protocol):
    """A vehicle that keeps its state to itself, as an environment of Gymnasium does.

    It has these members in place of `step`, `initial_states` and `draw_initial` of a `Task`, and
    may have what a task may have besides. All that happens in an episode follows from its seed
    and the actions.

    Attributes
    ----------
    description : TaskDescription
    starts : int
        Policies are judged from the seeds 0, 1, … below it.
    """

    description: TaskDescription
    starts: int

    def fresh(self) -> Stateful:
        """Another of the kind, which lives a life of its own."""
        ...

    def begin(self, seed: int) -> Array:
        """The first state, shape (n_dims,), of the episode that a seed makes."""
        ...

    def advance(self, action: int, noise: float = 0.0) -> tuple[Array, float, bool, bool]:
        """Hold an action, with noise added to it, for one sampling time.

        Returns
        -------
        next_state : ndarray of shape (n_dims,)
        reward : float
        terminated, truncated : bool
            Whether the task ended there; whether something else cut the episode.
        """
        ...

    def close(self) -> None:
        """Let go of what it holds."""
        ...


@runtime_checkable
class Compiled(Protocol):
    """A task with compiled dynamics.

    `compiled(state, action, noise, parameters(time), next_state)` is a numba dispatcher: it takes
    one state, shape (n_dims,), writes the next into `next_state` and returns (reward, terminated).
    `action` is not checked.
    """

    compiled: Callable[[Array, int, float, Array, Array], tuple[float, bool]]

    def parameters(self, time: float) -> Array:
        """What `compiled` needs to know of the vehicle at a vehicle time [s], shape (p,)."""
        ...


@runtime_checkable
class Reference(Protocol):
    """A task of which a near-optimal policy can be computed by dynamic programming.

    Attributes
    ----------
    reference_points : tuple of int
        Grid points per dimension.
    reference_lookahead : int
        Steps that the policy looks ahead on the model before it trusts these points.
    """

    reference_points: tuple[int, ...]
    reference_lookahead: int


@runtime_checkable
class Judging(Protocol):
    """A task that tells from the states whether the goal was reached, not from the ending."""

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether episodes reached their goal.

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


def n_starts(vehicle: Any) -> int:
    """From how many starts policies of a `Task` or a `Stateful` vehicle are judged."""
    if isinstance(vehicle, Stateful):
        return vehicle.starts
    return len(vehicle.initial_states())


def advance(
    one: Callable[..., tuple[float, bool]],
    many: Callable[..., None],
    state: Array,
    action: NDArray[np.int64] | int,
    noise: Array | float,
    parameters: Array,
) -> tuple[Array, Any, Any]:
    """Step one state or many with a task's compiled dynamics.

    `one` is `Task.compiled`, `many` the loop around it. (A generalised ufunc would do for both,
    but numba keeps it in two files, and processes that start together mix them up and crash:
    numba/numba, issue 10128.)
    """
    next_state = np.empty(state.shape)
    if state.ndim == 1:
        reward, terminated = one(state, int(action), float(noise), parameters, next_state)
        return next_state, reward, terminated
    n = len(state)
    actions, noises = np.empty(n, np.int64), np.empty(n)
    actions[:], noises[:] = action, noise
    rewards, ended = np.empty(n), np.empty(n, np.bool_)
    many(np.ascontiguousarray(state), actions, noises, parameters, next_state, rewards, ended)
    return next_state, rewards, ended
