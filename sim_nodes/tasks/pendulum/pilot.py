"""How a person would fly the pendulum."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.law import Explorer
from sim_nodes.tasks.pendulum.dynamics import INERTIA, LENGTH, MASS

Array = NDArray[np.float64]


class Perform:
    """Pump energy until the mass can reach the top, then catch it there."""

    catch_angle = 0.6  # rad: inside, the motor can hold the mass
    lead = 0.09  # s: how far ahead of the angle the balancing hand reacts
    surplus = 1.3  # energy to pump up to, in that of the mass at the top: friction takes some
    dead_zone = 0.08  # rad: small enough to leave alone

    def __init__(self, gravity: float) -> None:
        self.lift = MASS * gravity * LENGTH  # energy of the mass at the top [J]

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Balance near the top, else push along with the motion while energy is short."""
        angle, rate = float(state[0]), float(state[1])
        if abs(angle) < self.catch_angle:
            lean = angle + self.lead * rate
            return 1 if abs(lean) < self.dead_zone else (0 if lean > 0 else 2)
        energy = 0.5 * INERTIA * rate**2 + self.lift * np.cos(angle)
        short = self.surplus * self.lift - energy
        if abs(short) < 0.05 * self.lift:
            return 1
        along = 2 if rate >= 0 else 0
        return along if short > 0 else 2 - along


class Explore(Explorer):
    """Pump, brake, spin, balance, let go."""

    shortest, longest = 0.08, 0.35
    intentions = ("swing up", "swing up", "spin left", "spin right", "brake", "let go")

    def __init__(self, gravity: float, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.perform = Perform(gravity)

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Pump and balance as when performing, brake the rate, or hold one action."""
        if intention == "swing up":
            return self.perform.decide(state, time)
        if intention == "brake":
            return 0 if state[1] > 0 else 2
        return {"spin left": 0, "let go": 1, "spin right": 2}[intention]
