"""Policies changed by Gaussian noise, and flown on a model of the samples (T Algorithm 3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.features import ChebyshevGrid
from iolspi_ros.core.learner import Proceed
from iolspi_ros.core.samples import Transitions
from iolspi_ros.methods.base import Sampled, SampledSettings
from iolspi_ros.methods.local_model import LocalModel
from iolspi_ros.methods.value_iteration import FEW
from iolspi_ros.settings import setting

Array = NDArray[np.float64]
FORESIGHT = 3.0
"""A flight on the model is as long as rewards count, so many times 1 / (1 - γ)."""


@dataclass(frozen=True)
class SearchSettings(SampledSettings):
    """What it takes besides."""

    degree: int = setting(3, "of the polynomials of the policy, in each variable", low=1, high=9)
    noise: float = setting(0.3, "deviation of what is added, relative to the weights", low=0.0)
    rounds: int = setting(5, "rounds of an update", low=1)
    candidates: int = setting(30, "policies tried in a round", low=1)
    starts: int = setting(16, "states that each is flown from, of those seen", low=1)


class PolicySearch(Sampled):
    """Keep the best of a policy and of others near it, judged by flights on `LocalModel`.

    T's policy is one polynomial of the state, for an action that is any number; here each action
    has one, and the greatest is taken. T tries one random vector at a time, here are a round of
    them around the same policy. Its first guess is what imitates the samples best.
    """

    name = "policy_search"
    Settings: ClassVar[type[Any]] = SearchSettings
    shaping: ClassVar[tuple[str, ...]] = (*Sampled.shaping, "degree")

    def basis(self) -> Basis:
        """Polynomials of each variable, multiplied out (T Eq. 4-11)."""
        grid = self.settings.on(self.task)
        return ChebyshevGrid(grid.low, grid.high, (self.settings.degree + 1,) * self.task.n_dims)

    def improve(
        self, rows: Transitions, weights: Array, rng: np.random.Generator, proceed: Proceed
    ) -> tuple[Array | None, str]:
        """Search around the best policy so far (T Algorithm 3, lines 6 to 20)."""
        s = self.settings
        if not LocalModel.possible(rows, self.task):
            return None, FEW
        model = LocalModel(rows, self.task)
        best = weights if weights.any() else self._imitating(rows)
        starts = rows.state[rng.choice(len(rows), s.starts)]
        found = -np.inf
        for number in range(s.rounds):
            noise = s.noise * max(float(best.std()), 1e-6)
            tried = best + noise * rng.standard_normal((s.candidates, *best.shape))
            tried[0] = best
            returns = self._fly(model, tried, starts)
            best, found = tried[returns.argmax()], float(returns.max())
            if not proceed((number + 1) / s.rounds):
                break
        return best, f"{s.rounds} rounds of {s.candidates}, return {found:.4g} on the model"

    def _imitating(self, rows: Transitions) -> Array:
        """Least squares for 1 where an action was taken and 0 where another was."""
        phi = self.features(rows.state)
        taken = np.eye(self.task.n_actions)[rows.action]
        gram = phi.T @ phi + 1e-3 * len(rows) * np.eye(phi.shape[1])
        found = np.linalg.solve(gram, phi.T @ taken).T
        return np.asarray(found, np.float64)

    def _fly(self, model: LocalModel, tried: Array, starts: Array) -> Array:
        """Mean discounted return of each policy, shape (n,)."""
        task, n = self.task, len(tried)
        horizon = min(task.episode_steps, int(FORESIGHT / (1.0 - task.gamma)))
        states = np.tile(starts, (n, 1))
        alive, total = np.ones(len(states), bool), np.zeros(len(states))
        for k in range(horizon):
            up = np.flatnonzero(alive)
            if not len(up):
                break
            phi = self.features(states[up])
            scores = np.einsum("nf,naf->na", phi, tried[up // len(starts)])
            after, reward, ended = model(states[up], scores.argmax(axis=1))
            total[up] += task.gamma**k * reward
            states[up], alive[up] = after, ~ended
        return total.reshape(n, -1).mean(axis=1)
