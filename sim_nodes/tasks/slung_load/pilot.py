"""How a person would fly the slung load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import G
from sim_nodes.tasks.law import Explorer
from sim_nodes.tasks.slung_load.dynamics import GOAL, LENGTH, RELEASE, landing

Array = NDArray[np.float64]


class Perform:
    """Fly towards the basket without haste, keep the load swinging, drop it when it would fall in.

    Accelerating against the load's motion swings it up, along with it calms it: the change of
    its energy is -ẍ θ̇ cos θ.
    """

    aim = -1.4  # m: where to hover, on the near side, to swing the load in from
    haste = 0.6  # 1/s: speed wanted for each metre to go
    fastest = 1.25  # m/s
    swing = 1.4  # energy of the load's swing to keep, per mass and length [m/s^2]
    swing_weight = 0.5  # of the swing beside the speed
    dead_zone = 0.13  # m/s: small enough to leave alone
    margin = 1.1  # m: half the part of the basket that it dares to aim at

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Drop the load if it would fall in, else steer."""
        place = landing(state)
        if place is not None and abs(place - GOAL) <= self.margin:
            return RELEASE
        wanted = np.clip(self.haste * (self.aim - state[0]), -self.fastest, self.fastest)
        return self.steer(state, float(wanted), self.swing)

    def steer(self, state: Array, speed: float, swing: float) -> int:
        """Accelerate towards a speed [m/s] and an energy of the swing [m/s²], as both allow."""
        angle, rate = float(state[2]), float(state[3])
        energy = 0.5 * LENGTH * rate**2 + G * (1.0 - np.cos(angle))
        push = speed - float(state[1])
        push -= self.swing_weight * (swing - energy) * rate * np.cos(angle)
        return 1 if abs(push) < self.dead_zone else (0 if push < 0 else 2)


class Explore(Explorer):
    """Bring the load to the basket, fly about, swing it, calm it, drop it just to see."""

    shortest, longest = 0.4, 1.2
    intentions = ("perform", "perform", "left", "right", "swing", "calm", "drop")
    speed = 2.0  # m/s, when flying about
    wild = 5.0  # energy of a load swung high [m/s^2]

    def __init__(self, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.perform = Perform()

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Perform, drop, or steer towards a speed and a swing."""
        if intention == "perform":
            return self.perform.decide(state, time)
        if intention == "drop":
            return RELEASE
        speed = {"left": -self.speed, "right": self.speed}.get(intention, 0.0)
        swing = {"swing": self.wild, "calm": 0.0}.get(intention, self.perform.swing)
        return self.perform.steer(state, speed, swing)
