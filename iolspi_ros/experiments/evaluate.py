"""How good a policy is: its return from every initial condition, learning turned off."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import __version__
from iolspi_ros.core.basis import Basis
from iolspi_ros.core.lspi import greedy
from iolspi_ros.core.shield import Shield
from iolspi_ros.errors import InputError
from iolspi_ros.experiments import cache
from iolspi_ros.experiments.compiled import CompiledTask, fly_greedily
from iolspi_ros.experiments.history import EpisodeRecord
from iolspi_ros.experiments.together import fly_together
from iolspi_ros.methods.near_optimal import Grid, NearOptimal, Progress, near_optimal
from iolspi_ros.task import TaskDescription
from sim_nodes.tasks.base import Compiled, Judging, Reference, Stateful, Task

Array = NDArray[np.float64]
Policy = Callable[[Array], NDArray[np.int64]]


@dataclass(frozen=True)
class Evaluation:
    """Episodes flown by one policy, one from each initial condition.

    Attributes
    ----------
    states : ndarray of shape (n_steps + 1, n, n_dims)
    actions : ndarray of int, shape (n_steps, n)
        -1 after the end.
    discounted : ndarray of shape (n,)
        Discounted return of each (T Eq. 4).
    score : ndarray of shape (n,)
        Sum of the rewards of each, not discounted.
    succeeded : ndarray of bool, shape (n,)
    ending : ndarray of int, shape (n,)
        Which of the task's endings each came to.
    """

    states: Array
    actions: NDArray[np.int64]
    discounted: Array
    score: Array
    succeeded: NDArray[np.bool_]
    ending: NDArray[np.int64]

    @property
    def discounted_return(self) -> float:
        """Mean discounted return over the initial conditions (T IV)."""
        return float(self.discounted.mean())

    @property
    def success_fraction(self) -> float:
        """Share of the episodes that reached the goal."""
        return float(self.succeeded.mean())


def policy_of(weights: Array, features: Basis, shield: Shield | None = None) -> Policy:
    """The greedy policy of some weights, shape (n_actions, size), behind a shield if any."""

    def policy(states: Array) -> NDArray[np.int64]:
        among = shield.among(states) if shield else None
        return greedy(weights, features(states), among=among)

    return policy


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
    if isinstance(task, Stateful):
        return _graded(task, *fly_together(task, policy))
    about, state = task.description, task.initial_states()
    alive = np.ones(len(state), bool)
    states, actions, rewards = [state], [], []
    for _ in range(about.episode_steps):
        action = policy(state)
        next_state, reward, terminated = task.step(state, action, time)
        rewards.append(np.where(alive, reward, 0.0))
        state = np.where(alive[:, None], next_state, state)
        actions.append(np.where(alive, action, -1))
        alive &= ~terminated
        states.append(state)
    return _graded(task, np.stack(states), np.stack(actions), np.stack(rewards), ~alive)


def evaluate_weights(
    task: CompiledTask, weights: Array, features: Basis, time: float = 0.0
) -> Evaluation:
    """The same for the greedy policy of some weights, shape (n_actions, size), compiled.

    The sums behind Q̂ are taken in another order than `evaluate` takes them, so the last bits of
    an episode may differ, and with them an action where two are as good.
    """
    return _graded(task, *fly_greedily(task, weights, features, time))


def _graded(
    task: Task,
    states: Array,
    actions: NDArray[np.int64],
    rewards: Array,
    terminated: NDArray[np.bool_],
) -> Evaluation:
    """What episodes come to."""
    about = task.description
    discounted = about.gamma ** np.arange(len(rewards)) @ rewards
    lengths = np.count_nonzero(actions >= 0, axis=0)
    last = rewards[lengths - 1, np.arange(len(lengths))]
    ending = about.ending(last, terminated)
    reached = _reached(task, states, rewards, ending)
    return Evaluation(states, actions, discounted, rewards.sum(axis=0), reached, ending)


def _reached(
    task: Task, states: Array, rewards: Array, ending: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Whether episodes reached their goal: by the task, or else by how they ended."""
    if isinstance(task, Judging):
        return task.succeeded(states, rewards)
    return np.array([end.success for end in task.description.endings])[ending]


def succeeded(task: Task, episodes: Sequence[EpisodeRecord]) -> NDArray[np.bool_]:
    """Whether each of some whole episodes reached the goal; one that ended early stays there.

    Returns
    -------
    ndarray of bool, shape (n_episodes,)
    """
    about = task.description
    # On an autopilot a load that is let go at the very end comes down after it, and a state
    # that comes late has the number that its time says.
    length = max(about.episode_steps + 1, *(len(episode.states) for episode in episodes))
    states = np.empty((length, len(episodes), about.n_dims))
    rewards = np.zeros((length, len(episodes)))
    for number, episode in enumerate(episodes):
        count = len(episode.states)
        states[:count, number] = episode.states
        states[count:, number] = episode.states[-1]
        rewards[:count, number] = episode.rewards
    return _reached(task, states, rewards[1:], endings(about, episodes))


def endings(about: TaskDescription, episodes: Sequence[EpisodeRecord]) -> NDArray[np.int64]:
    """Which of the task's endings each of some whole episodes came to, shape (n_episodes,)."""
    rewards = np.array([episode.rewards[-1] for episode in episodes])
    return about.ending(rewards, np.array([episode.terminated for episode in episodes], bool))


def has_reference(task: Task) -> bool:
    """Whether a near-optimal policy of this task can be computed."""
    return isinstance(task, Reference)


def near_optimal_policy(
    task: Task,
    points: tuple[int, ...] | None = None,
    time: float = 0.0,
    progress: Progress | None = None,
) -> NearOptimal:
    """The baseline: dynamic programming on the task's model (T has none).

    Its values are kept in the user's cache folder and found there the next time.

    Parameters
    ----------
    task : Task
    points : tuple of int, optional
        Grid points per dimension; the task's own by default.
    time : float
        Vehicle time at which conditions are taken [s].
    progress : callable, optional
        Is told now and then what share of the work is done, 0 to 1.
    """

    def model(states: Array, actions: NDArray[np.int64]) -> tuple[Array, Array, NDArray[np.bool_]]:
        return task.step(states, actions, time)

    if not isinstance(task, Reference):
        raise InputError(
            f"task {task.description.name} has no near-optimal policy; allowed: a task with the "
            "members reference_points and reference_lookahead"
        )
    about = task.description
    grid = Grid(about.low, about.high, points or task.reference_points)
    name = _fingerprint(task, grid, time)
    values = cache.read(name, (grid.size,))
    if values is None:
        found = near_optimal(model, grid, about.n_actions, about.gamma, progress=progress)
        values = found.values
        cache.write(name, values)
    return NearOptimal(grid, values, model, about.n_actions, about.gamma, task.reference_lookahead)


def _fingerprint(task: Task, grid: Grid, time: float) -> str:
    """Name of whatever makes the values: the settings, and how the model answers here and there."""
    about = task.description
    facts = (__version__, about.name, grid.low, grid.high, tuple(grid.counts), about.gamma)
    digest = hashlib.sha256(repr(facts).encode())
    if isinstance(task, Compiled):
        digest.update(task.parameters(time).tobytes())
    probes = np.random.default_rng(0).uniform(grid.low, grid.high, (1000, about.n_dims))
    for action in range(about.n_actions):
        for answer in task.step(probes, np.full(len(probes), action), time):
            digest.update(np.ascontiguousarray(answer).tobytes())
    return f"{about.name}-{digest.hexdigest()[:16]}"
