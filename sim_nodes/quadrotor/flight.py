"""A vehicle under its controller in the wind: one, or many at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.quadrotor.airframe import Airframe, Payload
from sim_nodes.quadrotor.body import SIZE, STAGES, move
from sim_nodes.quadrotor.control import MEMORY, Gains, steer
from sim_nodes.quadrotor.wind import Gusts, begin_gusts, blow

Array = NDArray[np.float64]

STEP = 0.005
"""Of controller and motion [s]."""


class Vehicle(NamedTuple):
    """One vehicle in the air, with all that changes while it flies.

    Attributes
    ----------
    state : ndarray of shape (24,)
        As of `body`.
    memory : ndarray of shape (6,)
        As of `control`.
    gust : ndarray of shape (3, 2)
        As of `wind`.
    wind : ndarray of shape (3,)
        Velocity of the air now [m/s].
    """

    state: Array
    memory: Array
    gust: Array
    wind: Array


def vehicle(state: Array, air: Gusts, rng: np.random.Generator) -> Vehicle:
    """A vehicle in a state, with gusts as they are in the long run."""
    gust = np.zeros((3, 2))
    begin_gusts(air, rng, gust)
    return Vehicle(state, np.zeros(MEMORY), gust, air.steady.copy())


@cached_njit()
def fly(
    one: Vehicle, mode: int, sticks: Array, air: Gusts, rng: np.random.Generator,
    gains: Gains, frame: Airframe, payload: Payload, steps: int,
) -> None:  # fmt: skip
    """Hold the sticks for some `STEP`, in place."""
    room, command = np.empty((STAGES, SIZE)), np.empty(4)
    for _ in range(steps):
        blow(air, rng, one.gust, one.wind)
        steer(one.state, one.memory, mode, sticks, gains, frame, STEP, command)
        move(one.state, command, one.wind, frame, payload, STEP, room)


@cached_njit()
def fly_all(
    states: Array, memories: Array, mode: int, sticks: Array, wind: Array,
    gains: Gains, frame: Airframe, payload: Payload, steps: int,
) -> None:  # fmt: skip
    """Hold sticks, shape (n, 4), for some `STEP`: many vehicles in one steady wind, in place."""
    room, command = np.empty((STAGES, SIZE)), np.empty(4)
    for n in range(len(states)):
        for _ in range(steps):
            steer(states[n], memories[n], mode, sticks[n], gains, frame, STEP, command)
            move(states[n], command, wind, frame, payload, STEP, room)
