"""How a person would fly the load in three dimensions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.quadrotor.airframe import Payload
from sim_nodes.tasks.law import Explorer
from sim_nodes.tasks.slung_load_3d.actions import Actions
from sim_nodes.tasks.slung_load_3d.scene import SWING_X, SWING_Y, Basket, X, Y, landing, load_of

Array = NDArray[np.float64]

_CALM = np.zeros(3)


class Perform:
    """Fly to the basket, calm the load on the way, drop it when it would fall in.

    The pilot knows the cable and the load as they should be, and nothing of the wind.
    """

    haste = 0.9  # 1/s: speed wanted for each metre to go
    fastest = 2.2  # m/s
    firmness = 1.6  # 1/s: acceleration for a speed that is missing
    calming = 0.8  # 1/s: acceleration along with the load, for its speed
    daring = 0.6  # share of the basket's radius that it aims at

    def __init__(self, actions: Actions, basket: Basket, payload: Payload) -> None:
        self.actions, self.basket, self.payload = actions, basket, payload

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Drop the load if it would fall in, else steer."""
        if self.would_dunk(state):
            return self.actions.release
        gap = np.array([self.basket.x - state[X], self.basket.y - state[Y]])
        away = float(np.hypot(*gap))
        wanted = gap * min(self.haste, self.fastest / max(away, 1e-9))
        return self.steer(state, wanted, self.calming)

    def would_dunk(self, state: Array) -> bool:
        """Whether a load dropped now falls well inside the basket."""
        position, velocity = load_of(state, self.payload.length)
        x, y, _ = landing(position, velocity, _CALM, self.payload.drag, self.basket.rim)
        far = math.hypot(x - self.basket.x, y - self.basket.y)
        return far <= self.daring * self.basket.radius

    def steer(self, state: Array, velocity: Array, calming: float) -> int:
        """Accelerate towards a velocity [m/s]; along with the load's motion, which calms it."""
        along = state[[SWING_X + 1, SWING_Y + 1]] * np.cos(state[[SWING_X, SWING_Y]])
        push = self.firmness * (velocity - state[[X + 1, Y + 1]])
        return self.actions.nearest(push + calming * self.payload.length * along)


class Explore(Explorer):
    """Bring the load to the basket, fly about, swing it, calm it, drop it just to see."""

    shortest, longest = 0.4, 1.2
    intentions = ("perform",) * 4 + ("roam", "roam", "swing", "calm", "drop")
    speed = 2.0  # m/s, when flying about
    wild = -1.5  # of a load that is swung up: against its motion
    safe = 3.0  # m: farther out it flies back

    def __init__(self, performer: Perform, rng: np.random.Generator) -> None:
        self.perform, self.course = performer, np.zeros(2)
        super().__init__(rng)

    def decide(self, state: Array, time: float) -> int:
        """Act on the present intention; a new one has a course of its own."""
        if time >= self.until:
            angle = self.rng.uniform(0.0, math.tau)
            self.course = self.speed * np.array([math.cos(angle), math.sin(angle)])
        return super().decide(state, time)

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Perform, drop, or steer on a course, and never on into a wall."""
        act = self.perform
        if intention == "perform":
            return act.decide(state, time)
        if intention == "drop":
            return act.actions.release
        place = state[[X, Y]]
        course = self.course if intention == "roam" else np.zeros(2)
        course = np.where(np.abs(place) > self.safe, -self.speed * np.sign(place), course)
        return act.steer(state, course, self.wild if intention == "swing" else act.calming)
