"""The slung load on a grid of states: a finite problem with a clock (T ch. 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.task.finite import FiniteTask

Array = NDArray[np.float64]

G, LENGTH, DT = 9.81, 1.0, 0.2
"""g [m/s²], L [m] and T_s [s] (T Table 5-2)."""
GOAL, MARGIN = 5.0, 1.0
"""Middle and half width of the basket [m]."""
RIM, DEPTH = 0.5, 0.3
"""z of the basket's rim below the quadrotor, and how far below it counts as in [m]."""
STEEP = 80.0
"""Angle of the cable beyond which every step is penalised [deg]."""
PENALTY = -10.0
ACCELERATIONS = (-10.0, 0.0, 10.0)
"""Of the quadrotor [m/s²]; T gives none, see `SlungGrid`."""


@cached_njit()
def _move(state: Array, acceleration: float, low: Array, high: Array, following: Array) -> None:
    """One T_s by T Eqs. 5-1 to 5-6, capped; angles in radians here."""
    x, speed, angle, rate = state
    following[1] = min(max(speed + acceleration * DT, low[1]), high[1])
    following[0] = min(max(x + following[1] * DT, low[0]), high[0])
    pushed = (following[1] - speed) / DT  # none of it when the speed is at its cap
    turning = -math.cos(angle) * pushed / LENGTH - math.sin(angle) * G / LENGTH
    following[3] = min(max(rate + turning * DT, low[3]), high[3])
    following[2] = min(max(angle + following[3] * DT, low[2]), high[2])


@cached_njit()
def _successors(low: Array, spacing: Array, counts: NDArray[np.int64]) -> NDArray[np.int32]:
    """The point next to where each action leads from each point."""
    high = low + spacing * (counts - 1)
    found = np.empty((counts.prod(), len(ACCELERATIONS)), np.int32)
    state, following = np.empty(4), np.empty(4)
    for k in range(len(found)):
        left = k
        for d in range(3, -1, -1):
            state[d] = low[d] + spacing[d] * (left % counts[d])
            left //= counts[d]
        for a in range(len(ACCELERATIONS)):
            _move(state, ACCELERATIONS[a], low, high, following)
            number = 0
            for d in range(4):
                place = math.floor((following[d] - low[d]) / spacing[d] + 0.5)
                number = number * counts[d] + int(place)
            found[k, a] = number
    return found


@dataclass(frozen=True)
class SlungGrid:
    """T's preliminary simulation: fly the load into a basket as soon as possible.

    State [x, ẋ, θ, θ̇]: position of the quadrotor [m] and its rate [m/s]; angle of the cable,
    positive to the right, and its rate, in degrees as T Table 5-5 has them. After every step it
    is put on the nearest point of the grid, so that the problem is finite and Markov but for the
    clock. Since no action changes ẋ by less than 1 m/s, the finer grid of T Table 5-1 has the
    same reachable points.

    T leaves open, and here it is so: the accelerations. With ±10 m/s², and none where the speed
    is capped, the best flight from rest takes 1.4 s and swings the load to the left, which is
    what T's Q-learning found (T Table 5-4, Fig. 5-6). |θ| counts in T Eq. 5-7, once for each
    step that arrives beyond `STEEP`: T's -24.84 is -2.2² - 2 · 10.

    References
    ----------
    T 5-1, Eqs. 5-1 to 5-7, Tables 5-1, 5-2 and 5-5.
    """

    end_time: float = 5.0  # T_end [s]

    low = (-2.0, -5.0, -110.0, -540.0)
    spacing = (0.5, 1.0, 10.0, 20.0)
    counts = (21, 11, 23, 55)

    @property
    def size(self) -> int:
        """Number of states."""
        return math.prod(self.counts)

    @property
    def horizon(self) -> int:
        """Steps after which the clock ends an episode."""
        return round(self.end_time / DT)

    def states(self, numbers: NDArray[np.int64]) -> Array:
        """States of some points, shape (n, 4) [m, m/s, deg, deg/s]."""
        index = np.stack(np.unravel_index(numbers, self.counts), axis=-1)
        return np.add(self.low, index * np.array(self.spacing))

    def numbers(self, states: Array) -> NDArray[np.int64]:
        """Points next to some states, shape (n,)."""
        places = np.rint((np.asarray(states) - self.low) / self.spacing).astype(np.int64)
        found: NDArray[np.int64] = np.ravel_multi_index(tuple(places.T), self.counts)
        return found

    @property
    def start(self) -> int:
        """The point at x = 0, at rest, hanging."""
        return int(self.numbers(np.zeros((1, 4)))[0])

    def scattered(self) -> NDArray[np.int64]:
        """The points at rest with any x and θ, from which T 5-4-1 starts at random."""
        x, angle = np.meshgrid(np.arange(self.counts[0]), np.arange(self.counts[2]))
        rest = self.counts[1] // 2, self.counts[3] // 2
        where = (x.ravel(), np.full(x.size, rest[0]), angle.ravel(), np.full(x.size, rest[1]))
        found: NDArray[np.int64] = np.ravel_multi_index(where, self.counts)
        return found

    def in_basket(self, states: Array) -> NDArray[np.bool_]:
        """Whether the load is falling into the basket (T 5-1-2), shape (n,)."""
        x, _, degrees, rate = states.T
        angle = np.deg2rad(degrees)
        across, below = x + LENGTH * np.sin(angle), LENGTH * np.cos(angle)
        tiny = 1e-9  # cos 60° is the rim, and not below it
        inside = (np.abs(across - GOAL) <= MARGIN) & (below > RIM + tiny) & (below < RIM + DEPTH)
        return inside & (np.sin(angle) * rate <= 0.0)

    @cached_property
    def task(self) -> FiniteTask:
        """The whole problem as tables."""
        angles = np.array((1.0, 1.0, np.pi / 180, np.pi / 180))
        successor = _successors(
            np.array(self.low) * angles, np.array(self.spacing) * angles, np.array(self.counts)
        )
        states = self.states(np.arange(self.size))
        times = DT * np.arange(self.horizon + 1.0)
        return FiniteTask(
            successor,
            np.where(np.abs(states[:, 2]) > STEEP, PENALTY, 0.0),
            self.in_basket(states),
            -times * times,
            -2.0 * self.end_time**2,
        )
