"""What the quadrotor's dynamics leave out: the ground under the vehicle and its load."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.quadrotor.airframe import Airframe, Payload
from sim_nodes.quadrotor.body import CABLE, LOAD, SIZE
from sim_nodes.quadrotor.cable import SLACK, TAUT, distance
from sim_nodes.quadrotor.control import heading_of

Array = NDArray[np.float64]

_FRICTION = 0.05  # time in which a load on the ground stops [s]


def at_rest(load: tuple[float, float]) -> Array:
    """State on the ground, nose to the north, with the load lying beside it [m]."""
    state = np.zeros(SIZE)
    state[6] = state[9] = math.sqrt(0.5)
    state[LOAD][:2], state[CABLE] = load, SLACK
    return state


@cached_njit()
def touch(state: Array, payload: Payload, dt: float) -> float:
    """Stop at the ground what a step has brought below it, in place.

    Returns
    -------
    float
        Speed with which the quadrotor came to the ground in this step [m/s].
    """
    if state[19] < 0.0:
        slip = math.exp(-dt / _FRICTION)
        state[19] = 0.0
        state[20], state[21], state[22] = state[20] * slip, state[21] * slip, max(state[22], 0.0)
        if state[CABLE] == TAUT and distance(state) < payload.length:
            state[CABLE] = SLACK
    if state[2] >= 0.0:
        return 0.0
    impact = max(-state[5], 0.0)
    half = 0.5 * heading_of(state)
    state[2] = 0.0
    state[3], state[4], state[5] = 0.0, 0.0, max(state[5], 0.0)
    state[6], state[7], state[8], state[9] = math.cos(half), 0.0, 0.0, math.sin(half)
    state[10], state[11], state[12] = 0.0, 0.0, 0.0
    return impact


@cached_njit()
def push(state: Array, frame: Airframe) -> float:
    """Thrust of the rotors over the quadrotor's mass [m/s^2]."""
    squares = 0.0
    for i in range(13, 17):
        squares += state[i] * state[i]
    return frame.thrust * squares / frame.mass
