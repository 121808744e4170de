"""Apprenticeship: a model of the expert's flights, and the best policy on it (T Algorithm 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.learner import Proceed, Source
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.methods.base import Sampled, SampledSettings
from iolspi_ros.methods.local_model import LocalModel
from iolspi_ros.methods.near_optimal import Grid, near_optimal
from iolspi_ros.methods.value_iteration import FEW
from iolspi_ros.settings import setting
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ApprenticeSettings(SampledSettings):
    """What it takes besides."""

    points: int = setting(20_000, "of the grid that is planned on, about", low=4, high=10**7)


class Apprentice(Sampled):
    """Dynamic programming on `LocalModel` of what was flown, the expert's flights first.

    Of T's two cases Waslander searches by noise, which is `policy_search`, and Abbeel plans; this
    plans (T Algorithm 7) on a regular grid between the limits of the state. T's is offline; with
    each update online it plans again, as T proposes.
    """

    name = "apprentice"
    Settings: ClassVar[type[Any]] = ApprenticeSettings
    shaping: ClassVar[tuple[str, ...]] = (*Sampled.shaping, "points")

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        super().__init__(task, settings, rng)
        bounds = settings.on(task)
        count = max(int(settings.points ** (1.0 / task.n_dims)), 2)
        self._grid = Grid(bounds.low, bounds.high, (count,) * task.n_dims)
        self.weights = np.zeros((task.n_actions, self._grid.size))  # Q at the points

    def basis(self) -> Basis:
        """None: values are those of a grid's points."""
        n = self.task.n_dims
        return RBFGrid((0.0,) * n, (1.0,) * n, (1,) * n)

    def act(self, state: Array, explore: bool = True) -> tuple[int, Source]:
        """Choose an action, when there was an expert.

        Raises
        ------
        InputError
            When nothing was demonstrated.
        """
        if not self.n_samples:
            raise InputError(
                "learner apprentice has no expert to learn from; allowed: demonstrations first, "
                "or a learner that begins from nothing, such as iolspi or value_iteration"
            )
        return super().act(state, explore)

    def values(self, states: Array, snapshot: Array | None = None) -> Array:
        """Q on the model, between points of the grid."""
        held = self.weights if snapshot is None else snapshot
        return np.stack([self._grid.interpolate(row, states) for row in held], axis=1)

    def improve(
        self, rows: Transitions, weights: Array, rng: np.random.Generator, proceed: Proceed
    ) -> tuple[Array | None, str]:
        """Plan."""
        if not LocalModel.possible(rows, self.task):
            return None, FEW
        model, task, grid = LocalModel(rows, self.task), self.task, self._grid
        scale = float(np.abs(rows.reward).max())
        best = near_optimal(
            model, grid, task.n_actions, task.gamma, max(1e-4 * scale, 1e-12),
            lambda done: None,
        )  # fmt: skip
        q = best.q(grid.points(0, grid.size))
        proceed(1.0)
        return q.T.copy(), f"planned on {grid.size} points, from {len(rows)} samples"
