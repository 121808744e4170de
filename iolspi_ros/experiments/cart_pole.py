"""Episodes of the cart-pole, compiled: at random to learn from, greedy to judge by (T ch. 8)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.basis import Basis, Table, weigh
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.lspi import Iteration, offline_lspi
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition, Transitions, transition_between
from sim_nodes.pilots import PilotSettings, ScriptedPilot
from sim_nodes.tasks.cart_pole import FORCE_NOISE, CartPole
from sim_nodes.world import World, WorldSettings

Array = NDArray[np.float64]

WIDE = LSPISettings(
    low=(-np.pi / 2, -6.0), high=(np.pi / 2, 6.0), centers=(7, 7), periodic=(False,),
)  # fmt: skip
"""As in config/cart_pole.yaml."""
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
    task: CartPole,
    features: Basis,
    weights: Array,
    episodes: int,
    rng: np.random.Generator,
    most: int = CartPole.description.episode_steps,
) -> Array:
    """Steps that a greedy policy balances the pole for, at most so many.

    Parameters
    ----------
    task : CartPole
    features : Basis
    weights : ndarray of shape (n_actions, size)
    episodes : int
    rng : numpy.random.Generator
    most : int

    Returns
    -------
    ndarray of shape (episodes,)
    """
    steps = np.empty(episodes)
    _greedy(
        task.compiled, task.parameters(0.0), task.deviation, rng, features.table, weights,
        most, steps,
    )  # fmt: skip
    return steps


def demonstration(count: int, skilled: bool, rng: np.random.Generator) -> Transitions:
    """Samples of the scripted pilot, who begins again whenever the pole falls.

    Parameters
    ----------
    count : int
        Samples.
    skilled : bool
        Reacts within one sampling time; otherwise within three.
    rng : numpy.random.Generator
    """
    task: Any = CartPole()
    delay = task.description.sampling_time if skilled else 3.0 * task.description.sampling_time
    settings = PilotSettings(
        reaction_delay=delay, hold_time=task.description.sampling_time, prediction_error=0.3
    )
    pilot = ScriptedPilot(task, settings, rng)
    world = World(task, WorldSettings(uniform_noise=FORCE_NOISE), rng)
    rows: list[Transition] = []
    while len(rows) < count:
        pilot.begin()
        seen = world.begin(0)
        while not seen.last and len(rows) < count:
            action = pilot.act(seen.state)
            after = world.move(0, action)
            rows.append(transition_between(seen, after)._replace(truncated=False))
            seen = after
    return Transitions.of(rows, 2)


@dataclass(frozen=True)
class Balancing:
    """Offline LSPI on samples of the cart-pole, and what its policy is worth (T 8-2, 8-3).

    Attributes
    ----------
    episodes : int
        Random episodes to learn from; 0 when `samples` says how many.
    samples : int
        Random samples to learn from.
    demonstrated : tuple of int
        Sizes of demonstrations to learn from instead, merged; a negative one is of a pilot who
        reacts late.
    deviation : float
        Of the starts of random episodes. Policies are judged from `CartPole`'s own.
    steps, evaluations : int
        Most steps of an episode that judges, and how many there are.
    gamma, chi, max_iterations
        As of `lspi.offline_lspi`.
    centers : int
        Gaussians in each direction.
    draw : int
        Which draw of w₀: two that differ in this alone share their samples.
    ends : bool
        Nothing follows a fall, as Lagoudakis and Parr have it; otherwise the state after it
        counts as any other.
    wide : bool
        With the functions of config/cart_pole.yaml, instead of theirs.
    refreshed : bool
        By the refreshed learner, with those functions.
    """

    episodes: int = 0
    samples: int = 0
    demonstrated: tuple[int, ...] = ()
    deviation: float = 0.01
    steps: int = 3000
    evaluations: int = 20
    gamma: float = CartPole.description.gamma
    chi: float = 1e-5
    max_iterations: int = 20
    centers: int = 3
    draw: int = 0
    ends: bool = True
    wide: bool = False
    refreshed: bool = False


def balancing(setting: Balancing, seed: int) -> Mapping[str, Any]:
    """One set of samples and the policy learned from it, w₀ drawn at random.

    Returns
    -------
    steps : float
        Mean balancing steps.
    length : float
        Mean steps of an episode among the samples before the one that falls.
    samples : int
    converged, singular : float
        0 or 1: the weights settled; the last solve was singular.
    spread : ndarray of shape (2,)
        Standard deviations of angle and rate among the samples.
    """
    taken = _samples(setting, np.random.default_rng([seed, 1]))
    rng = np.random.default_rng([seed, 2, setting.draw])
    features, weights, found = _learned(setting, taken, rng)
    flown = balancing_steps(CartPole(), features, weights, setting.evaluations, rng, setting.steps)
    falls = np.count_nonzero(taken.terminated)
    return {
        "steps": flown.mean(),
        "length": len(taken) / falls - 1.0 if falls else np.nan,
        "samples": len(taken),
        "converged": float(found.stop == "converged"),
        "singular": float(found.solve.status == "singular"),
        "spread": taken.state.std(axis=0),
    }


def _learned(
    setting: Balancing, taken: Transitions, rng: np.random.Generator
) -> tuple[Basis, Array, Iteration]:
    """Functions, weights, and how they were found."""
    if setting.refreshed:
        learner = OnlineLSPI(CartPole.description, WIDE, rng)
        iteration = learner.pretrain(taken).iteration
        assert iteration is not None
        return learner.features, learner.weights, iteration
    features = WIDE.features() if setting.wide else basis((setting.centers, setting.centers))
    weights = rng.standard_normal((CartPole.description.n_actions, features.size))
    ends = taken.terminated & setting.ends
    found = learn(
        replace(taken, terminated=ends), features, weights, gamma=setting.gamma, chi=setting.chi,
        max_iterations=setting.max_iterations,
    )  # fmt: skip
    return features, found.solve.weights, found


def gathered(setting: Balancing, seed: int) -> Mapping[str, Any]:
    """The samples that `balancing` learns from, to look at.

    Returns
    -------
    state : ndarray of shape (n_samples, 2)
    action : ndarray of int, shape (n_samples,)
    """
    taken = _samples(setting, np.random.default_rng([seed, 1]))
    return {"state": taken.state, "action": taken.action}


def _samples(setting: Balancing, rng: np.random.Generator) -> Transitions:
    if setting.demonstrated:
        sets = [demonstration(abs(n), n > 0, rng) for n in setting.demonstrated]
        return Transitions.of([row for one in sets for row in one], 2)
    task = CartPole(deviation=setting.deviation)
    taken, _ = random_episodes(task, setting.episodes or setting.samples, rng)
    return taken[: setting.samples or len(taken)]


def learn(
    transitions: Transitions,
    features: Basis,
    weights: Array,
    *,
    gamma: float = CartPole.description.gamma,
    chi: float = 1e-5,
    max_iterations: int = 20,
) -> Iteration:
    """Offline LSPI with the settings of T 8-2; Γ begins at zero, as Lagoudakis and Parr's does."""
    found, _ = offline_lspi(
        transitions, features, CartPole.description.n_actions, gamma=gamma, delta=0.0, chi=chi,
        max_iterations=max_iterations, weights=weights,
    )  # fmt: skip
    return found


@cached_njit()
def _perturbed(deviation: float, rng: np.random.Generator, state: Array) -> None:
    for d in range(len(state)):
        state[d] = deviation * rng.standard_normal()


@cached_njit()
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
    state, next_state = np.empty(2), np.empty(2)
    q, phi = np.empty(len(weights)), np.empty(weights.shape[1])
    factors = np.empty(table.counts.sum())
    for episode in range(len(steps)):
        _perturbed(deviation, rng, state)
        stood = 0
        while stood < most:
            weigh(table, weights, state, factors, phi, q)
            _, fell = dynamics(state, np.argmax(q), _noise(rng), parameters, next_state)
            if fell:
                break
            state[:] = next_state
            stood += 1
        steps[episode] = stood
