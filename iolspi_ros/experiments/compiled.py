"""Flying and acting in one compiled loop: the same steps as one by one, a hundred times faster."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from iolspi_ros.core.features import Basis, Table, weigh
from iolspi_ros.core.online import OnlineLSPI, Update
from iolspi_ros.core.shield import Guard, allowed, safest
from sim_nodes.tasks.base import Task
from sim_nodes.world import World

Array = NDArray[np.float64]


def fly(
    world: World,
    learner: OnlineLSPI,
    episodes: int,
    on_update: Callable[[Update], None],
    on_episode: Callable[[float, float, bool], None],
) -> None:
    """Act and learn for some episodes.

    Every random draw, action and transition is that of `headless.train` step by step.

    Parameters
    ----------
    world : World
    learner : OnlineLSPI
    episodes : int
    on_update, on_episode : callable
        As in `headless.Listener`.
    """
    flight = _Flight(world, learner)
    for episode in range(episodes):
        flight.seen[:] = world.begin(episode).state
        flight.state[:] = world.state
        left, action, score = world.task.episode_steps, -1, 0.0
        while True:
            steps, ended, tied = flight.stretch(left, action)
            left -= steps
            score += flight.score
            over = ended or left == 0
            if over:
                learner.batch.end(ended)
            if len(learner.batch) >= learner.settings.update_interval:
                on_update(learner.update())
            if over:
                on_episode(score, flight.reward, ended)
                break
            action = learner.choose(flight.q.tolist()) if tied else -1


class _Flight:
    """A world, a learner, and the room that the compiled loop works in."""

    def __init__(self, world: World, learner: OnlineLSPI) -> None:
        self.world, self.learner = world, learner
        table = learner.features.table
        self.state, self.seen, self.following = np.empty((3, learner.features.n_dims))
        self.q = np.empty(learner.settings.n_actions)
        self.factors = np.empty(int(table.counts.sum()))
        self.phi = np.empty(learner.features.size)
        self.score, self.reward = 0.0, 0.0  # of the latest stretch: their sum, and the last one

    def stretch(self, left: int, action: int) -> tuple[int, bool, bool]:
        """Fly until the batch or the episode is full, the task ends, or Q̂ leaves a choice.

        Parameters
        ----------
        left : int
            Steps until the clock cuts the episode.
        action : int
            That must be taken first; -1 for none.

        Returns
        -------
        steps : int
        terminated, tied : bool
        """
        world, learner, s = self.world, self.learner, self.learner.settings
        count = min(left, s.update_interval - len(learner.batch))
        begin, dt = world.vehicle_steps, world.task.dt
        parameters = world.task.parameters(begin * dt)[None, :]
        if not np.array_equal(parameters[0], world.task.parameters((begin + count) * dt)):
            steps = range(begin, begin + count)  # they change on the way
            parameters = np.stack([world.task.parameters(step * dt) for step in steps])
        rows = learner.batch.reserve(count)
        if len(self.phi) != learner.features.size:  # of kernels, that change with an update
            self.phi = np.empty(learner.features.size)
        noises = (world.settings.action_noise, world.settings.uniform_noise)
        exploring = (s.epsilon, s.epsilon_decay, s.sampling_time, min(s.epsilon_min, s.epsilon))
        steps, terminated, tied, vetoes = _fly(
            world.task.compiled, parameters, learner.features.table, learner.weights, learner.rng,
            exploring, learner.shield.guard, learner.step, noises, world.sensor_noise, world.rng,
            self.state, self.seen, action, rows.state, rows.action, rows.reward, rows.next_state,
            self.factors, self.phi, self.q, self.following,
        )  # fmt: skip
        learner.batch.written(steps)
        self.score = float(rows.reward[:steps].sum())
        self.reward = float(rows.reward[steps - 1]) if steps else self.reward
        learner.step += steps
        learner.vetoes += vetoes
        world.flown(self.state.copy(), steps)
        return steps, terminated, tied


@njit
def _fly(
    dynamics: Callable[..., tuple[float, bool]],
    parameters: Array,
    table: Table,
    weights: Array,
    rng: np.random.Generator,
    exploring: tuple[float, float, float, float],
    guard: Guard,
    step: int,
    action_noises: tuple[float, float],
    sensor_noise: Array,
    vehicle_rng: np.random.Generator,
    state: Array,
    seen: Array,
    first_action: int,
    states: Array,
    actions: NDArray[np.int64],
    rewards: Array,
    next_states: Array,
    factors: Array,
    phi: Array,
    q: Array,
    following: Array,
) -> tuple[int, bool, bool, int]:
    """Fill the rows; returns how many, whether it ended, whether Q̂ leaves a choice, and vetoes."""
    vetoes = 0
    start, decay, dt, floor = exploring
    normal, uniform = action_noises
    blurred = sensor_noise.any()
    for row in range(len(states)):
        if row == 0 and first_action >= 0:
            action = first_action
        elif rng.random() < max(start * decay ** ((step + row) * dt), floor):
            action = int(rng.integers(0, len(weights)))
        else:
            weigh(table, weights, seen, factors, phi, q)
            action, best = 0, 0
            for a in range(len(q)):
                if q[a] > q[action]:
                    action = a
            for a in range(len(q)):
                best += q[a] == q[action]
            if best != 1:
                return row, False, True, vetoes
        if guard.active and not allowed(guard, seen, action):
            vetoes += 1
            weigh(table, weights, seen, factors, phi, q)
            action = safest(guard, seen, q)
        noise = normal * vehicle_rng.standard_normal() if normal else 0.0
        if uniform:
            noise += uniform * (2.0 * vehicle_rng.random() - 1.0)
        now = parameters[min(row, len(parameters) - 1)]
        reward, ended = dynamics(state, action, noise, now, following)
        states[row] = seen
        actions[row] = action
        rewards[row] = reward
        state[:] = following
        seen[:] = following
        if blurred:
            for d in range(len(seen)):
                seen[d] += sensor_noise[d] * vehicle_rng.standard_normal()
        next_states[row] = seen
        if ended:
            return row + 1, True, False, vetoes
    return len(states), False, False, vetoes


def fly_greedily(
    task: Task, weights: Array, basis: Basis, time: float
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
    starts, n_steps = task.initial_states(), task.episode_steps
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
            following = states[step + 1, start]
            reward, ended = dynamics(states[step, start], action, 0.0, parameters, following)
            actions[step, start] = action
            rewards[step, start] = reward
            if ended:
                terminated[start] = True
                states[step + 1 :, start] = states[step + 1, start].copy()
                break
