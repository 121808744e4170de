"""Balancing a pole on a cart, pushed by noisy forces: Lagoudakis and Parr's problem (T ch. 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Action, Ending, TaskDescription, Variable
from sim_nodes.tasks.base import advance
from sim_nodes.tasks.cart_pole import dynamics
from sim_nodes.tasks.cart_pole.dynamics import FALLEN, FORCES, PARAMETERS, SAMPLING_TIME
from sim_nodes.tasks.cart_pole.pilot import Perform
from sim_nodes.tasks.law import Law

Array = NDArray[np.float64]


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

    # Pushed from rest, no pole is faster before it has fallen.
    description = TaskDescription(
        name="cart_pole",
        variables=(
            Variable("pole.position", "rad", -FALLEN, FALLEN, label="angle"),
            Variable("pole.velocity", "rad/s", -10.0, 10.0, label="rate"),
        ),
        actions=tuple(
            Action(name, (force,))
            for name, force in zip(("-50 N", "0 N", "+50 N"), FORCES, strict=True)
        ),
        action_unit="N",
        neutral=1,
        sampling_time=SAMPLING_TIME,
        episode_steps=3000,
        gamma=0.95,
        endings=(Ending("time-out", success=True), Ending("fall")),
        success="never fall",
    )
    usual_episodes = 300
    reference_points = (201, 201)
    reference_lookahead = 1
    compiled = staticmethod(dynamics.step)

    def parameters(self, time: float) -> Array:
        """(g, m, l, κ, T_s), shape (5,); always the same."""
        return np.array(PARAMETERS)

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | int,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Any, Any]:
        """One sampling time, the force held; reward and end are of the state reached."""
        return advance(dynamics.step, dynamics.steps, state, action, noise, self.parameters(time))

    def initial_states(self) -> Array:
        """Angle and rate each at zero or one deviation from it, shape (9, 2)."""
        values = np.linspace(-self.deviation, self.deviation, 3)
        return np.stack(np.meshgrid(values, values, indexing="ij"), axis=-1).reshape(-1, 2)

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """Angle and rate normal around zero."""
        return self.deviation * rng.standard_normal(2)

    def pilot(self, mode: str, rng: np.random.Generator) -> Law | None:
        """The law of a scripted pilot who performs; nobody explores this."""
        return Perform() if mode == "perform" else None
