"""Episodes of the cart-pole, compiled: at random to learn from, greedy to judge by (T ch. 8)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import njit
from numpy.typing import NDArray

from iolspi_ros.core.features import Basis, RBFGrid, Table, weigh
from iolspi_ros.core.lspi import Iteration, offline_lspi
from iolspi_ros.core.samples import Transitions
from sim_nodes.tasks.cart_pole import FORCE_NOISE, CartPole

Array = NDArray[np.float64]

ROOM = 64
"""Steps after which a random episode is cut; one in a million lasts so long."""


def basis(counts: tuple[int, int] = (3, 3)) -> RBFGrid:
    """Lagoudakis and Parr's functions (T Eq. 8-2): 1 and Gaussians with σ = 1."""
    corner = (np.pi / 4, 1.0)
    low = (-corner[0], -corner[1])
    return RBFGrid(low, corner, counts, normalisation="none", width=1.0, constant=True)


def random_episodes(
    task: CartPole, count: int, rng: np.random.Generator
) -> tuple[Transitions, NDArray[np.int64]]:
    """Samples of episodes that act at random until the pole falls.

    Parameters
    ----------
    task : CartPole
    count : int
        Episodes.
    rng : numpy.random.Generator

    Returns
    -------
    transitions : Transitions
    lengths : ndarray of int, shape (count,)
        Samples of each episode; the last of them falls.
    """
    columns = Transitions(
        np.empty((count * ROOM, 2)),
        np.empty(count * ROOM, np.int64),
        np.empty(count * ROOM),
        np.empty((count * ROOM, 2)),
        np.zeros(count * ROOM, bool),
        np.zeros(count * ROOM, bool),
    )
    lengths = np.empty(count, np.int64)
    used = _at_random(
        task.compiled, task.parameters(0.0), task.deviation, rng, columns.state, columns.action,
        columns.reward, columns.next_state, columns.terminated, columns.truncated, lengths,
    )  # fmt: skip
    return columns[np.arange(used)], lengths


def balancing_steps(
    task: CartPole, features: Basis, weights: Array, episodes: int, rng: np.random.Generator
) -> Array:
    """Steps that a greedy policy balances the pole for, at most `task.episode_steps`.

    Parameters
    ----------
    task : CartPole
    features : Basis
    weights : ndarray of shape (n_actions, size)
    episodes : int
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of shape (episodes,)
    """
    steps = np.empty(episodes)
    _greedy(
        task.compiled, task.parameters(0.0), task.deviation, rng, features.table, weights,
        task.episode_steps, steps,
    )  # fmt: skip
    return steps


def learn(
    transitions: Transitions,
    features: Basis,
    weights: Array,
    *,
    gamma: float = CartPole.gamma,
    chi: float = 1e-5,
    max_iterations: int = 20,
) -> Iteration:
    """Offline LSPI with the settings of T 8-2; Γ begins at zero, as Lagoudakis and Parr's does."""
    found, _ = offline_lspi(
        transitions, features, len(CartPole.actions), gamma=gamma, delta=0.0, chi=chi,
        max_iterations=max_iterations, weights=weights,
    )  # fmt: skip
    return found


@njit(cache=True)
def _perturbed(deviation: float, rng: np.random.Generator, state: Array) -> None:
    for d in range(len(state)):
        state[d] = deviation * rng.standard_normal()


@njit(cache=True)
def _noise(rng: np.random.Generator) -> float:
    return FORCE_NOISE * (2.0 * rng.random() - 1.0)


@njit
def _at_random(
    dynamics: Callable[..., tuple[float, bool]],
    parameters: Array,
    deviation: float,
    rng: np.random.Generator,
    states: Array,
    actions: NDArray[np.int64],
    rewards: Array,
    next_states: Array,
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    lengths: NDArray[np.int64],
) -> int:
    """Fill the rows; returns how many."""
    row, state = 0, np.empty(2)
    for episode in range(len(lengths)):
        _perturbed(deviation, rng, state)
        for step in range(ROOM):
            action = int(rng.integers(0, 3))
            states[row] = state
            actions[row] = action
            rewards[row], terminated[row] = dynamics(
                state, action, _noise(rng), parameters, next_states[row]
            )
            state[:] = next_states[row]
            truncated[row] = step == ROOM - 1 and not terminated[row]
            row += 1
            lengths[episode] = step + 1
            if terminated[row - 1]:
                break
    return row


@njit
def _greedy(
    dynamics: Callable[..., tuple[float, bool]],
    parameters: Array,
    deviation: float,
    rng: np.random.Generator,
    table: Table,
    weights: Array,
    most: int,
    steps: Array,
) -> None:
    """Fill `steps`."""
    state, following = np.empty(2), np.empty(2)
    q, phi = np.empty(len(weights)), np.empty(weights.shape[1])
    factors = np.empty(table.counts.sum())
    for episode in range(len(steps)):
        _perturbed(deviation, rng, state)
        stood = 0
        while stood < most:
            weigh(table, weights, state, factors, phi, q)
            _, fell = dynamics(state, np.argmax(q), _noise(rng), parameters, following)
            if fell:
                break
            state[:] = following
            stood += 1
        steps[episode] = stood
