"""Value iteration by least squares, with few actions or along an axis (T Algorithms 5 and 6)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.features import ChebyshevGrid
from iolspi_ros.core.learner import Proceed
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.methods.base import Sampled, SampledSettings
from iolspi_ros.methods.local_model import LocalModel
from iolspi_ros.settings import setting
from iolspi_ros.task import TaskDescription

Array = NDArray[np.float64]

FEW = "an action was hardly taken yet, so there is no model: the policy stays"


@dataclass(frozen=True)
class ValueSettings(SampledSettings):
    """What both take besides."""

    iterations: int = setting(300, "values are renewed so often at most", low=1)
    tolerance: float = setting(1e-4, "until none changes more, relative to the largest", low=0.0)
    states: int = setting(2000, "samples at which values are renewed, at most", low=1)
    ridge: float = setting(2e-4, "of the least squares, of Gamma's scale", low=0.0)


class ValueIteration(Sampled):
    """V(s) ← max_a r(s, a) + γ wᵀφ(s'), and w by least squares over the samples (T Algorithm 5).

    Transitions and rewards are those of `LocalModel`. In the end the right-hand side is fitted
    for each action, so that the policy needs no model in flight. Values beyond what the rewards
    can add up to are cut off, without which least squares may diverge.
    """

    name = "value_iteration"
    Settings: ClassVar[type[Any]] = ValueSettings

    def improve(
        self, rows: Transitions, weights: Array, rng: np.random.Generator, proceed: Proceed
    ) -> tuple[Array | None, str]:
        """Iterate on a model of the samples, from the values of the policy before."""
        task, s = self.task, self.settings
        if not LocalModel.possible(rows, task):
            return None, FEW
        model = LocalModel(rows, task)
        some = rng.choice(len(rows), min(s.states, len(rows)), replace=False)
        phi = self.features(rows.state[some])
        answers = [model(rows.state[some], np.full(len(some), a)) for a in range(task.n_actions)]
        reward = np.stack([r for _, r, _ in answers], axis=1)
        onward = [self.features(after, ended) for after, _, ended in answers]
        gram = phi.T @ phi
        scale = s.ridge * float((gram**2).sum() / max(np.trace(gram), 1e-300))
        fit = np.linalg.solve(gram + scale * np.eye(len(gram)), phi.T)
        limits = np.array([reward.min(), reward.max(), 0.0]) / (1.0 - task.gamma)
        low, high = limits.min(), limits.max()
        v = self.best(phi @ weights.T)
        change, count = np.inf, 0
        for count in range(1, s.iterations + 1):
            w = fit @ v
            q = np.stack([p @ w for p in onward], axis=1)
            q = reward + task.gamma * np.clip(q, low, high)
            new = np.clip(self.best(q), low, high)
            change, v = float(np.abs(new - v).max()), new
            done = change <= s.tolerance * max(float(np.abs(v).max()), 1e-300)
            if done or not proceed(count / s.iterations):
                break
        return (fit @ q).T, f"{count} iterations on {len(some)} samples, change {change:.3g}"

    def best(self, q: Array) -> Array:
        """Value of the best action, from those of all: (n, n_actions) to (n,)."""
        return q.max(axis=1)


class _Quadratic(ChebyshevGrid):
    """Polynomials of degree two at most."""

    @property
    def table(self) -> Any:
        """The numbers that evaluate it."""
        whole = super().table
        numbers = np.indices(self.centers).reshape(self.n_dims, -1).T
        return whole._replace(kept=np.ascontiguousarray(numbers[numbers.sum(axis=1) <= 2]))


class ContinuousValueIteration(ValueIteration):
    """The same with any action between the least and the greatest (T Algorithm 6).

    Where the dynamics are affine in the action, and V and the reward quadratic, Q is a parabola
    along the axis: three actions tell where it is highest (T Eqs. 4-19 and 4-20), and how high.
    The vehicle then takes the one of its actions that is worth most.
    """

    name = "continuous_value_iteration"

    def __init__(self, task: TaskDescription, settings: Any, rng: np.random.Generator) -> None:
        self._axis = _axis(task)
        super().__init__(task, settings, rng)

    def basis(self) -> Basis:
        """Quadratic polynomials, as the method asks."""
        grid = self.settings.on(self.task)
        return _Quadratic(grid.low, grid.high, (3,) * self.task.n_dims)

    def best(self, q: Array) -> Array:
        """Top of the parabola through the values of three actions, within their limits."""
        return parabola_top(q[:, self._axis[0]], self._axis[1])


def parabola_top(q: Array, a: Array) -> Array:
    """Largest value of the parabola through three points, between the outer two.

    Parameters
    ----------
    q : ndarray of shape (n, 3)
    a : ndarray of shape (3,)
        Where the values are, in order.
    """
    after, later = np.roll(a, -1), np.roll(a, -2)
    upper, lower = q @ (after**2 - later**2), 2.0 * q @ (after - later)
    with np.errstate(divide="ignore", invalid="ignore"):
        top = upper / lower  # T Eq. 4-20
    top = np.clip(np.where(np.isfinite(top), top, a[1]), a[0], a[2])  # T Eq. 4-19
    shares = [  # Lagrange's polynomials
        (top - after[i]) * (top - later[i]) / ((a[i] - after[i]) * (a[i] - later[i]))
        for i in range(3)
    ]
    there: Array = np.maximum((q * np.stack(shares, axis=1)).sum(axis=1), q.max(axis=1))
    return there


def _axis(task: TaskDescription) -> tuple[list[int], Array]:
    """Three actions along one axis, and their values.

    Raises
    ------
    InputError
        When the actions are not numbers of one axis.
    """
    values = [action.value for action in task.actions]
    numbers = [value[0] for value in values if len(value) == 1]
    if len(numbers) < len(values) or len(set(numbers)) < len(values) or len(values) < 3:
        raise InputError(
            f"learner continuous_value_iteration needs three or more actions that are different "
            f"numbers along one axis; those of task {task.name} are {', '.join(map(str, values))}. "
            "Allowed for this task: a learner that takes any list of actions, such as iolspi, "
            "q_learning, value_iteration or fitted_q"
        )
    order = np.argsort(numbers)
    chosen = [int(order[0]), int(order[len(order) // 2]), int(order[-1])]
    return chosen, np.array(numbers)[chosen]
