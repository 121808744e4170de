"""Scripted pilots: stand-ins for a person at the stick, and they say so wherever they appear.

A law says what an attentive pilot would do in a state; `ScriptedPilot` makes it human: it sees
late, foresees imperfectly, and does not change its mind at every step.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.cart_pole import CartPole
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad

Array = NDArray[np.float64]

MODES = ("perform", "explore")


@dataclass(frozen=True)
class PilotSettings(Settings):
    """How human the scripted pilot is. Times are vehicle times."""

    mode: str = setting("perform", "do the task well, or explore the states", choices=MODES)
    reaction_delay: float = setting(
        0.03, "age of the state that it reacts to [s]", low=0.0, high=5.0
    )
    hold_time: float = setting(0.02, "shortest time between two decisions [s]", low=0.0, high=5.0)
    prediction_error: float = setting(
        0.2, "standard deviation of its relative error in foreseeing the delay", low=0.0, high=10.0
    )


class Law(Protocol):
    """What a pilot wants in a state."""

    def begin(self) -> None:
        """Start an episode."""
        ...

    def decide(self, state: Array, time: float) -> int:
        """Index of the action for a state, shape (n_dims,), at a time in the episode [s]."""
        ...


class PendulumPerform:
    """Pump energy until the mass can reach the top, then catch it there."""

    catch_angle = 0.6  # rad: inside, the motor can hold the mass
    lead = 0.09  # s: how far ahead of the angle the balancing hand reacts
    surplus = 1.3  # energy to pump up to, in that of the mass at the top: friction takes some
    dead_zone = 0.08  # rad: small enough to leave alone

    def __init__(self, task: Pendulum, rng: np.random.Generator) -> None:
        self.task = task
        self.lift = task.mass * task.g * task.length  # energy of the mass at the top [J]

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Balance near the top, else push along with the motion while energy is short."""
        angle, rate = float(state[0]), float(state[1])
        if abs(angle) < self.catch_angle:
            lean = angle + self.lead * rate
            return 1 if abs(lean) < self.dead_zone else (0 if lean > 0 else 2)
        energy = 0.5 * self.task.inertia * rate**2 + self.lift * np.cos(angle)
        short = self.surplus * self.lift - energy
        if abs(short) < 0.05 * self.lift:
            return 1
        along = 2 if rate >= 0 else 0
        return along if short > 0 else 2 - along


class Explorer:
    """Changes its intention every now and then; a task's own says what each of them means."""

    shortest, longest = 0.0, 0.0  # s between two intentions
    intentions: tuple[str, ...] = ()  # drawn from; one that stands twice comes twice as often

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.begin()

    def begin(self) -> None:
        """Start with an intention drawn at random."""
        self.until = 0.0
        self.intention = self.intentions[0]

    def decide(self, state: Array, time: float) -> int:
        """Act on the present intention."""
        if time >= self.until:
            self.intention = self.intentions[int(self.rng.integers(len(self.intentions)))]
            self.until = time + float(self.rng.uniform(self.shortest, self.longest))
        return self.follow(self.intention, state, time)

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Action for an intention in a state."""
        raise NotImplementedError


class PendulumExplore(Explorer):
    """Pump, brake, spin, balance, let go."""

    shortest, longest = 0.08, 0.35
    intentions = ("swing up", "swing up", "spin left", "spin right", "brake", "let go")

    def __init__(self, task: Pendulum, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.perform = PendulumPerform(task, rng)

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Pump and balance as when performing, brake the rate, or hold one action."""
        if intention == "swing up":
            return self.perform.decide(state, time)
        if intention == "brake":
            return 0 if state[1] > 0 else 2
        return {"spin left": 0, "let go": 1, "spin right": 2}[intention]


class SlungLoadPerform:
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

    def __init__(self, task: SlungLoad, rng: np.random.Generator) -> None:
        self.task = task

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Drop the load if it would fall in, else steer."""
        landing = self.task.landing(state)
        if landing is not None and abs(landing - self.task.goal) <= self.margin:
            return RELEASE
        wanted = np.clip(self.haste * (self.aim - state[0]), -self.fastest, self.fastest)
        return self.steer(state, float(wanted), self.swing)

    def steer(self, state: Array, speed: float, swing: float) -> int:
        """Accelerate towards a speed [m/s] and an energy of the swing [m/s²], as both allow."""
        angle, rate = float(state[2]), float(state[3])
        energy = 0.5 * self.task.length * rate**2 + self.task.g * (1.0 - np.cos(angle))
        push = speed - float(state[1])
        push -= self.swing_weight * (swing - energy) * rate * np.cos(angle)
        return 1 if abs(push) < self.dead_zone else (0 if push < 0 else 2)


class SlungLoadExplore(Explorer):
    """Bring the load to the basket, fly about, swing it, calm it, drop it just to see."""

    shortest, longest = 0.4, 1.2
    intentions = ("perform", "perform", "left", "right", "swing", "calm", "drop")
    speed = 2.0  # m/s, when flying about
    wild = 5.0  # energy of a load swung high [m/s^2]

    def __init__(self, task: SlungLoad, rng: np.random.Generator) -> None:
        super().__init__(rng)
        self.perform = SlungLoadPerform(task, rng)

    def follow(self, intention: str, state: Array, time: float) -> int:
        """Perform, drop, or steer towards a speed and a swing."""
        if intention == "perform":
            return self.perform.decide(state, time)
        if intention == "drop":
            return RELEASE
        speed = {"left": -self.speed, "right": self.speed}.get(intention, 0.0)
        swing = {"swing": self.wild, "calm": 0.0}.get(intention, self.perform.swing)
        return self.perform.steer(state, speed, swing)


class CartPolePerform:
    """Push the cart under the pole."""

    lead = 0.25  # s: how far ahead of the angle the balancing hand reacts
    dead_zone = 0.05  # rad: small enough to leave alone

    def __init__(self, task: CartPole, rng: np.random.Generator) -> None:
        pass

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Push towards the side that it leans to, soon."""
        lean = float(state[0]) + self.lead * float(state[1])
        return 1 if abs(lean) < self.dead_zone else (2 if lean > 0 else 0)


_LAWS: dict[tuple[str, str], type] = {
    ("pendulum", "perform"): PendulumPerform,
    ("pendulum", "explore"): PendulumExplore,
    ("slung_load", "perform"): SlungLoadPerform,
    ("slung_load", "explore"): SlungLoadExplore,
    ("cart_pole", "perform"): CartPolePerform,
}


class ScriptedPilot:
    """A law behind human senses and hands.

    Parameters
    ----------
    task : Task
    settings : PilotSettings
    rng : numpy.random.Generator

    Raises
    ------
    InputError
        When nobody can fly this task.
    """

    def __init__(self, task: Task, settings: PilotSettings, rng: np.random.Generator) -> None:
        law = _LAWS.get((task.name, settings.mode))
        if law is None:
            known = ", ".join(f"{name} ({mode})" for name, mode in _LAWS)
            raise InputError(f"no scripted pilot for task {task.name!r}; allowed: {known}")
        self.task, self.settings, self.rng = task, settings, rng
        self.law: Law = law(task, rng)
        self._delay = round(settings.reaction_delay / task.dt)
        self._hold = max(1, round(settings.hold_time / task.dt))
        self.begin()

    def begin(self) -> None:
        """Start an episode with rested hands."""
        self._seen: deque[Array] = deque(maxlen=self._delay + 1)
        self._held, self._wait, self._steps = self.task.neutral, 0, 0
        self.law.begin()

    def act(self, state: Array) -> int:
        """Action of this sampling time; call once a step, in order.

        Parameters
        ----------
        state : ndarray of shape (n_dims,)

        Returns
        -------
        int
        """
        self._seen.append(state)
        if self._wait == 0:
            self._held = self.law.decide(self._foreseen(), self._steps * self.task.dt)
            self._wait = self._hold
        self._wait -= 1
        self._steps += 1
        return self._held

    def _foreseen(self) -> Array:
        """The late state, carried forward along its velocities, not quite right."""
        state = self._seen[0].copy()
        ahead = (len(self._seen) - 1) * self.task.dt
        error = 1.0 + self.settings.prediction_error * float(self.rng.standard_normal())
        state[0::2] += state[1::2] * ahead * error
        for d, wraps in enumerate(self.task.periodic):
            if wraps:
                span = self.task.high[d] - self.task.low[d]
                state[d] = (state[d] - self.task.low[d]) % span + self.task.low[d]
        return state
