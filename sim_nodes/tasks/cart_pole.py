"""Balancing a pole on a cart, pushed by noisy forces: Lagoudakis and Parr's problem (T ch. 8)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import guvectorize, njit
from numpy.typing import NDArray

from iolspi_ros.settings import Settings, setting
from sim_nodes.tasks.base import advance

Array = NDArray[np.float64]

FALLEN = math.pi / 2
"""Angle beyond which the pole has fallen [rad]."""
FORCE_NOISE = 10.0
"""Half-width of the uniform noise on every force [N]; `step` takes it as its noise."""
_FORCES = (-50.0, 0.0, 50.0)


@njit(cache=True)
def _acceleration(angle: float, rate: float, force: float, p: Array) -> float:
    """α̈ [rad/s²] (T Eq. 8-1)."""
    g, m, l, kappa, _ = p  # noqa: E741
    sine, cosine = math.sin(angle), math.cos(angle)
    turning = kappa * m * l * rate * rate * sine * cosine  # sin(2α) / 2
    return (g * sine - turning - kappa * cosine * force) / (
        4.0 * l / 3.0 - kappa * m * l * cosine * cosine
    )


@njit(cache=True)
def _step(
    state: Array, action: int, noise: float, parameters: Array, following: Array
) -> tuple[float, bool]:
    """One T_s by one step of the fourth-order Runge-Kutta method; -1 for falling."""
    angle, rate, h = state[0], state[1], parameters[4]
    force = _FORCES[action] + noise
    a1, b1 = rate, _acceleration(angle, rate, force, parameters)
    a2 = rate + h / 2 * b1
    b2 = _acceleration(angle + h / 2 * a1, a2, force, parameters)
    a3 = rate + h / 2 * b2
    b3 = _acceleration(angle + h / 2 * a2, a3, force, parameters)
    a4 = rate + h * b3
    b4 = _acceleration(angle + h * a3, a4, force, parameters)
    following[0] = angle + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    following[1] = rate + h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    fell = abs(following[0]) > FALLEN
    return (-1.0 if fell else 0.0), fell


@guvectorize(
    ["void(f8[:], i8, f8, f8[:], f8[:], f8[:], b1[:])"], "(d),(),(),(p)->(d),(),()", cache=True
)
def _steps(
    state: Array,
    action: int,
    noise: float,
    parameters: Array,
    following: Array,
    reward: Array,
    terminated: NDArray[np.bool_],
) -> None:
    reward[0], terminated[0] = _step(state, action, noise, parameters, following)


@dataclass(frozen=True)
class CartPole(Settings):
    """Parameters and equations of the pole on a cart.

    State [α, α̇]: angle of the pole [rad], zero upright; rate [rad/s]. Actions: forces of
    -50, 0 and +50 N on the cart, each with uniform noise of ±`FORCE_NOISE`. Where the cart
    is does not matter.

    Left open, and here it is so: the initial perturbation, normal with the same `deviation` for
    angle and rate; the integration, by one Runge-Kutta step. From near the equilibrium a random
    episode balances for 7.9 steps; L's "about 6" takes a deviation near 0.33.

    References
    ----------
    L: M.G. Lagoudakis and R. Parr, "Least-squares policy iteration", Journal of Machine
    Learning Research 4, 2003, section 9.1. T 8-1, Eq. 8-1.
    """

    deviation: float = setting(
        0.01, "standard deviation of the initial angle and rate [rad], [rad/s]",
        low=0.0, high=10.0,
    )  # fmt: skip

    name = "cart_pole"
    joints = ("pole",)
    actions = _FORCES
    action_unit = "N"
    action_names = ("-50 N", "0 N", "+50 N")
    neutral = 1
    dt = 0.1
    episode_steps = 3000
    study = 300
    gamma = 0.95
    # Pushed from rest, no pole is faster before it has fallen.
    low = (-FALLEN, -10.0)
    high = (FALLEN, 10.0)
    periodic = (False, False)
    axes = ("angle [rad]", "rate [rad/s]")
    pictured = (0, 1)
    success = "never fall"
    endings = ("time-out", "fall")
    reference_points = (201, 201)
    reference_lookahead = 1
    compiled = staticmethod(_step)

    g = 9.81  # [m/s^2]
    mass = 2.0  # m of the pole [kg]
    cart = 8.0  # M [kg]
    length = 0.5  # l [m]
    _constants = (g, mass, length, 1.0 / (mass + cart), dt)

    def parameters(self, time: float) -> Array:
        """(g, m, l, κ, T_s), shape (5,); always the same."""
        return np.array(self._constants)

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | int,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Any, Any]:
        """One sampling time, the force held; reward and end are of the state reached."""
        return advance(_step, _steps, state, action, noise, self.parameters(time))

    def initial_states(self) -> Array:
        """Angle and rate each at zero or one deviation from it, shape (9, 2)."""
        values = np.linspace(-self.deviation, self.deviation, 3)
        return np.stack(np.meshgrid(values, values, indexing="ij"), axis=-1).reshape(-1, 2)

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """Angle and rate normal around zero."""
        return self.deviation * rng.standard_normal(2)

    def ending(self, reward: Array, terminated: NDArray[np.bool_]) -> NDArray[np.int64]:
        """A fall, or the clock."""
        return np.asarray(terminated, np.int64)

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether the pole never fell."""
        stood: NDArray[np.bool_] = np.all(rewards == 0.0, axis=0)
        return stood
