"""Flying and acting in one compiled loop: the same steps as one by one, a hundred times faster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis, Table, weigh
from iolspi_ros.core.learner import CompiledLearner, Learner, Source, Update, update
from iolspi_ros.core.samples import Transitions
from sim_nodes.tasks.base import Compiled, Task
from sim_nodes.world import Noise, World, action_noise, blur

Array = NDArray[np.float64]
_SHIELD = int(Source.SHIELD)


class CompiledTask(Compiled, Task, Protocol):
    """A task with compiled dynamics."""


class Training(CompiledLearner, Learner, Protocol):
    """A learner that flies in a compiled loop."""


def fly(
    world: World,
    task: CompiledTask,
    learner: Training,
    episodes: int,
    on_update: Callable[[Update], None],
    on_episode: Callable[[float, float, bool], None],
) -> None:
    """Act and learn for some episodes.

    Every random draw, action and transition is that of `headless.train` step by step.

    Parameters
    ----------
    world : World
    task : CompiledTask
        The world's.
    learner : Learner
    episodes : int
    on_update, on_episode : callable
        As in `headless.Listener`.
    """
    flight = _Flight(world, task, learner)
    for episode in range(episodes):
        flight.begin(episode)
        score, last, due = 0.0, False, False
        while not last:
            ended, last, due = flight.stretch()
            score += flight.score
            if due:
                on_update(update(learner))
        on_episode(score, flight.reward, ended)


class _Flight:
    """A world, a learner, and the room that the compiled loop works in."""

    def __init__(self, world: World, task: CompiledTask, learner: Training) -> None:
        self.world, self.task, self.learner = world, task, learner
        self.state, self.seen, self.next_state = np.empty((3, task.description.n_dims))
        self.left = 0
        self.score, self.reward = 0.0, 0.0  # of the latest stretch: their sum, and the last one

    def begin(self, episode: int) -> None:
        """Put the vehicle at the start of an episode."""
        self.seen[:] = self.world.begin(episode).state
        self.state[:] = self.world.state
        self.left = self.task.description.episode_steps

    def stretch(self) -> tuple[bool, bool, bool]:
        """Fly until an update is due, the clock cuts the episode, or the task ends.

        Returns
        -------
        terminated, last, due : bool
            Whether the task ended, whether the episode did, and whether an update is due.
        """
        world, kernel = self.world, self.learner.kernel(self.left)
        steps, terminated, vetoes = _fly(
            self.task.compiled, self._parameters(len(kernel.rows)), kernel.choose, kernel.memory,
            kernel.rng, kernel.step, world.noise, world.rng, self.state, self.seen,
            self.next_state, _columns(kernel.rows),
        )  # fmt: skip
        self.score = float(kernel.rows.reward[:steps].sum())
        self.reward = float(kernel.rows.reward[steps - 1])
        self.left -= steps
        last = terminated or self.left == 0
        due = self.learner.flown(steps, vetoes, ended=terminated, last=last)
        world.flown(self.state.copy(), steps)
        return terminated, last, due

    def _parameters(self, count: int) -> Array:
        """The vehicle's numbers at each of the next steps, or once when they stay."""
        dt = self.task.description.sampling_time
        begin = self.world.vehicle_steps
        now = self.task.parameters(begin * dt)
        if np.array_equal(now, self.task.parameters((begin + count) * dt)):
            return now[None, :]
        return np.stack([self.task.parameters(k * dt) for k in range(begin, begin + count)])


def _columns(rows: Transitions) -> tuple[Array, NDArray[np.int64], Array, Array]:
    return rows.state, rows.action, rows.reward, rows.next_state


@njit
def _fly(
    dynamics: Callable[..., tuple[float, bool]],
    parameters: Array,
    choose: Callable[..., tuple[int, int]],
    memory: tuple[object, ...],
    rng: np.random.Generator,
    step: int,
    noise: Noise,
    vehicle_rng: np.random.Generator,
    state: Array,
    seen: Array,
    next_state: Array,
    columns: tuple[Array, NDArray[np.int64], Array, Array],
) -> tuple[int, bool, int]:
    """Fill the columns; returns how many rows, whether the task ended, and vetoes."""
    states, actions, rewards, next_states = columns
    vetoes = 0
    for row in range(len(states)):
        action, source = choose(memory, rng, step + row, seen)
        vetoes += source == _SHIELD
        added = action_noise(noise, vehicle_rng)
        now = parameters[min(row, len(parameters) - 1)]
        reward, ended = dynamics(state, action, added, now, next_state)
        states[row] = seen
        actions[row] = action
        rewards[row] = reward
        state[:] = next_state
        seen[:] = next_state
        if noise.blurred:
            blur(noise, vehicle_rng, seen)
        next_states[row] = seen
        if ended:
            return row + 1, True, vetoes
    return len(states), False, vetoes


def fly_greedily(
    task: CompiledTask, weights: Array, basis: Basis, time: float
) -> tuple[Array, NDArray[np.int64], Array, NDArray[np.bool_]]:
    """One episode from every initial condition by the greedy policy, without noise.

    Returns
    -------
    states : ndarray of shape (n_steps + 1, n, n_dims)
        Those of an episode that ended stay.
    actions : ndarray of int, shape (n_steps, n)
        -1 after the end.
    rewards : ndarray of shape (n_steps, n)
        Zero after the end.
    terminated : ndarray of bool, shape (n,)
    """
    starts, n_steps = task.initial_states(), task.description.episode_steps
    states = np.empty((n_steps + 1, *starts.shape))
    states[:] = starts
    actions = np.full((n_steps, len(starts)), -1)
    rewards = np.zeros(actions.shape)
    terminated = np.zeros(len(starts), bool)
    room = (np.empty(int(basis.table.counts.sum())), np.empty(basis.size), np.empty(len(weights)))
    _fly_greedily(
        task.compiled, task.parameters(time), basis.table, weights, states, actions, rewards,
        terminated, *room,
    )  # fmt: skip
    return states, actions, rewards, terminated


@njit
def _fly_greedily(
    dynamics: Callable[..., tuple[float, bool]],
    parameters: Array,
    table: Table,
    weights: Array,
    states: Array,
    actions: NDArray[np.int64],
    rewards: Array,
    terminated: NDArray[np.bool_],
    factors: Array,
    phi: Array,
    q: Array,
) -> None:
    """Fill the arrays."""
    for start in range(states.shape[1]):
        for step in range(len(actions)):
            weigh(table, weights, states[step, start], factors, phi, q)
            action = int(np.argmax(q))
            next_state = states[step + 1, start]
            reward, ended = dynamics(states[step, start], action, 0.0, parameters, next_state)
            actions[step, start] = action
            rewards[step, start] = reward
            if ended:
                terminated[start] = True
                states[step + 1 :, start] = states[step + 1, start].copy()
                break
