"""Online LSPI (T Algorithm 2) and its informed form, IOLSPI (T III-C)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.features import NORMALISATIONS, RBFGrid
from iolspi_ros.core.lspi import OfflineResult, Solve, greedy, offline_lspi, solve
from iolspi_ros.core.moments import SCALINGS, Moments, accumulate
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting

Array = NDArray[np.float64]


class Source(IntEnum):
    """Who chose an action."""

    EXPLOIT = 0
    EXPLORE = 1
    HUMAN = 2
    CORRUPTED = 3
    SCRIPTED = 4
    HOLD = 5


@dataclass(frozen=True)
class LearnerSettings(Settings):
    """Everything that T Algorithms 1 and 2 take, and the grid of features.

    Units: SI and radians, those of the state.
    """

    n_actions: int = setting(3, "number of actions", low=1, high=1000)
    low: tuple[float, ...] = setting((-np.pi, -15 * np.pi), "lower limits of the grid of centres")
    high: tuple[float, ...] = setting((np.pi, 15 * np.pi), "upper limits of the grid of centres")
    centers: tuple[int, ...] = setting((11, 11), "centres per dimension (T IV-A)", low=1)
    normalisation: str = setting(
        "asymmetric", "scaling of the dimensions, T 9-1-2 or 9-1-3", choices=NORMALISATIONS
    )
    width: float = setting(
        1.0, "width of a function in spacings of the centres", low=0.0, low_open=True
    )
    gamma: float = setting(0.98, "discount factor", low=0.0, high=1.0, high_open=True)
    sampling_time: float = setting(0.005, "T_s [s]", low=0.0, low_open=True)
    epsilon: float = setting(0.2, "exploration rate, or where it starts", low=0.0, high=1.0)
    epsilon_decay: float = setting(
        1.0, "factor on the exploration rate per second (T Eq. 14)", low=0.0, high=1.0
    )
    epsilon_min: float = setting(0.0, "exploration rate never decays below", low=0.0, high=1.0)
    update_interval: int = setting(1000, "steps between solves, K_theta", low=1)
    forget_factor: float = setting(
        1.0, "weight kept per step, eta (T Eq. 9-10)", low=0.0, high=1.0, low_open=True
    )
    scaling: str = setting("samples", "divisor of a solve, T Eq. 9-14 or 9-15", choices=SCALINGS)
    delta: float = setting(0.001, "Gamma starts as delta times the identity", low=0.0)
    chi: float = setting(0.01, "offline LSPI stops when the weights change less", low=0.0)
    max_iterations: int = setting(30, "offline LSPI stops after so many iterations", low=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        self.features()  # the grid checks itself

    def features(self) -> RBFGrid:
        """The grid of radial basis functions."""
        return RBFGrid(self.low, self.high, self.centers, self.normalisation, self.width)


@dataclass(frozen=True)
class Update:
    """One policy update.

    Attributes
    ----------
    number : int
        l, counting from 1.
    step : int
        k, online steps so far.
    moments : Moments
        Γ, Λ, z with the batch added.
    solve : Solve
    accepted : bool
        Whether the weights of the solve are now in use.
    change : float
        ‖w_l - w_{l+1}‖ that the solve asked for.
    """

    number: int
    step: int
    moments: Moments
    solve: Solve
    accepted: bool
    change: float


class OnlineLSPI:
    """Learns from a stream of transitions; acts ε-greedily on what it knows.

    Between updates the policy is fixed, so `observe` only keeps the transition; every
    `update_interval` of them become one batch, one accumulation and one solve (T Algorithm 2,
    lines 7 to 12). `update` does that at once. `begin_update` and `finish_update` are its two
    halves for whoever computes in another thread: what runs between them touches nothing here.

    Parameters
    ----------
    settings : LearnerSettings
    rng : numpy.random.Generator
        Draws w₀, exploration and ties.
    """

    def __init__(self, settings: LearnerSettings, rng: np.random.Generator) -> None:
        self.settings = settings
        self.rng = rng
        self.features = settings.features()
        shape = (settings.n_actions, self.features.size)
        self.weights: Array = rng.standard_normal(shape)
        self.moments = Moments.empty(*shape, settings.delta)
        self.step = 0
        self.updates = 0
        self.dropped = 0
        self._batch: list[Transition] = []

    @property
    def epsilon(self) -> float:
        """Exploration rate now (T Eq. 14)."""
        s = self.settings
        decayed = s.epsilon * s.epsilon_decay ** (self.step * s.sampling_time)
        return max(decayed, min(s.epsilon_min, s.epsilon))

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Choose an action (T Algorithm 2, line 5).

        Parameters
        ----------
        state : ndarray of shape (n_dims,)
        explore : bool
            False for the greedy policy alone.

        Returns
        -------
        action : int
        source : Source
        """
        if explore and self.rng.random() < self.epsilon:
            return int(self.rng.integers(self.settings.n_actions)), Source.EXPLORE
        q = self.features.weigh(self.weights, state).tolist()
        best = [a for a, value in enumerate(q) if value == max(q)]
        chosen = best[0] if len(best) == 1 else int(self.rng.choice(best or len(q)))
        return chosen, Source.EXPLOIT

    def observe(self, transition: Transition) -> bool:
        """Keep one transition; one with a number that is not finite is dropped and counted.

        Returns
        -------
        bool
            Whether an update is due.
        """
        t = transition
        numbers = (t.reward, *t.state.tolist(), *t.next_state.tolist())
        if all(map(math.isfinite, numbers)) and 0 <= t.action < self.settings.n_actions:
            self._batch.append(transition)
            self.step += 1
        else:
            self.dropped += 1
        return len(self._batch) >= self.settings.update_interval

    def inform(
        self,
        transitions: Transitions,
        proceed: Callable[[int, float], bool] = lambda iteration, change: True,
    ) -> OfflineResult:
        """Learn from demonstrations, then go on online from there (T III-C).

        Offline LSPI runs from random weights; its weights and its Γ, Λ, z become this
        learner's, unless its last solve is not finite.

        Parameters
        ----------
        transitions : Transitions
        proceed : callable
            As in `offline_lspi`.

        Returns
        -------
        OfflineResult

        Raises
        ------
        InputError
            When no transition is usable.
        """
        usable = transitions.usable(self.settings.n_actions)
        self.dropped += int((~usable).sum())
        if not usable.any():
            raise InputError(
                f"none of {len(transitions)} demonstrated transitions is usable; allowed: finite "
                f"numbers and actions 0 to {self.settings.n_actions - 1}"
            )
        s = self.settings
        result = offline_lspi(
            transitions[usable],
            self.features,
            s.n_actions,
            gamma=s.gamma,
            delta=s.delta,
            chi=s.chi,
            max_iterations=s.max_iterations,
            weights=self.rng.standard_normal(self.weights.shape),
            scaling=s.scaling,
            proceed=proceed,
        )
        if result.solve.status != "non-finite":
            self.weights, self.moments = result.solve.weights, result.moments
        return result

    def update(self) -> Update:
        """Accumulate what was observed and solve (T Algorithm 2, lines 7 to 11)."""
        return self.finish_update(self.begin_update()())

    def begin_update(self) -> Callable[[], tuple[Moments, Solve]]:
        """Take the batch; the returned computation may run anywhere."""
        batch = Transitions.of(self._batch, self.features.n_dims)
        self._batch = []
        # Drawn here, so that the generator is touched by one thread only.
        tie_breaker = np.random.default_rng(self.rng.integers(2**63))
        moments, weights = self.moments, self.weights
        features, s = self.features, self.settings

        def compute() -> tuple[Moments, Solve]:
            phi = features(batch.state)
            next_phi = features(batch.next_state, batch.terminated)
            next_action = greedy(weights, next_phi, tie_breaker)
            grown = accumulate(
                moments, phi, batch.action, batch.reward, next_phi, next_action, s.forget_factor
            )
            return grown, solve(grown, s.gamma, s.scaling)

        return compute

    def finish_update(self, computed: tuple[Moments, Solve]) -> Update:
        """Take the result of `begin_update`'s computation.

        Weights of an unhealthy solve are not used; those before stay.
        """
        moments, solution = computed
        change = float(np.linalg.norm(solution.weights - self.weights))
        if solution.status != "non-finite":
            self.moments = moments
        if solution.healthy:
            self.weights = solution.weights
        self.updates += 1
        return Update(self.updates, self.step, self.moments, solution, solution.healthy, change)

    def state(self) -> dict[str, Any]:
        """Everything that a later `restore` needs to go on bit by bit the same."""
        batch = Transitions.of(self._batch, self.features.n_dims)
        return {
            "weights": self.weights,
            "gram": self.moments.gram,
            "cross": self.moments.cross,
            "reward": self.moments.reward,
            "n_samples": self.moments.n_samples,
            "weight": self.moments.weight,
            "step": self.step,
            "updates": self.updates,
            "dropped": self.dropped,
            "batch": batch,
            "rng": self.rng.bit_generator.state,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` gave.

        Raises
        ------
        InputError
            When it was made with other actions or features.
        """
        if state["weights"].shape != self.weights.shape:
            raise InputError(
                f"weights have shape {state['weights'].shape}; allowed: {self.weights.shape} "
                "(actions, features) of this learner"
            )
        self.weights = state["weights"]
        self.moments = Moments(
            state["gram"], state["cross"], state["reward"], state["n_samples"], state["weight"]
        )
        self.step, self.updates = state["step"], state["updates"]
        self.dropped = state["dropped"]
        self._batch = list(state["batch"])
        self.rng.bit_generator.state = state["rng"]
