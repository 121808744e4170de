"""The cable: inextensible, without mass, and without push.

Taut, it keeps the load on a sphere around the vehicle; slack, both fly by themselves. It goes
slack when it would have to push, and is taut again when its length is reached: an inelastic pull,
along the cable, that takes the speed at which the two part and leaves their momentum.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.quadrotor.airframe import Payload

Array = NDArray[np.float64]

GONE, SLACK, TAUT = 0.0, 1.0, 2.0
"""What the cable is: let go, loose, under tension."""


@cached_njit(inline="always")
def distance(state: Array) -> float:
    """Between the vehicle and its load [m]."""
    x, y, z = state[17] - state[0], state[18] - state[1], state[19] - state[2]
    return math.sqrt(x * x + y * y + z * z)


@cached_njit(inline="always")
def tension(
    state: Array, apart: tuple[float, float, float], mass: float, payload: Payload
) -> tuple[float, float, float, float]:
    """Pull that keeps the length [N], and the direction from the vehicle to the load.

    Parameters
    ----------
    state : ndarray of shape (24,)
    apart : tuple of float
        Acceleration of the load less the vehicle's, as if there were no cable [m/s²].
    mass : float
        Of the vehicle [kg].
    payload : Payload

    Returns
    -------
    pull, x, y, z : float
        Negative where the cable would have to push.
    """
    x, y, z = state[17] - state[0], state[18] - state[1], state[19] - state[2]
    vx, vy, vz = state[20] - state[3], state[21] - state[4], state[22] - state[5]
    length = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    turning = (vx * vx + vy * vy + vz * vz) / length
    parting = x * apart[0] + y * apart[1] + z * apart[2]
    return (parting + turning) * mass * payload.mass / (mass + payload.mass), x, y, z


@cached_njit()
def tighten(state: Array, mass: float, payload: Payload) -> float:
    """Put a taut cable to its length and let the two part no longer, in place.

    The pull is shared as momentum has it; both move so that their centre of mass stays.

    Returns
    -------
    float
        Speed with which they parted [m/s].
    """
    length = distance(state)
    share = payload.mass / (mass + payload.mass)
    parting, slip = 0.0, payload.length / length - 1.0
    for i in range(3):
        unit = (state[17 + i] - state[i]) / length
        parting += unit * (state[20 + i] - state[3 + i])
    for i in range(3):
        gap = state[17 + i] - state[i]
        state[3 + i] += share * parting * gap / length
        state[20 + i] -= (1.0 - share) * parting * gap / length
        state[i] -= share * slip * gap
        state[17 + i] = state[i] + gap * (1.0 + slip)
    return parting
