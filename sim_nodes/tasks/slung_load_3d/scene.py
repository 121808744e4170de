"""Where the task is flown, what is seen of the vehicle, where a load falls, and what it earns."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.errors import InputError
from sim_nodes.quadrotor.airframe import G
from sim_nodes.quadrotor.body import CABLE as CABLE_STATE
from sim_nodes.quadrotor.body import direction, swing
from sim_nodes.quadrotor.cable import SLACK

Array = NDArray[np.float64]

DUNK, MISS, CABLE, WALL = 100.0, -10.0, -50.0, -150.0
"""Rewards of the four ways in which the task ends (T Eq. 20)."""

X, Y, Z, SWING_X, SWING_Y = 0, 2, 4, 6, 8
"""Where positions [m] and the cable's angles [rad] stand in what is seen; the rate of each, behind
it."""
SEEN = 10

HALL, CEILING = 5.0, 6.0
"""Walls at ± this in x and y, and above [m]: the floor of T 6-3's Cyberzoo is 10 m by 10 m."""


class Basket(NamedTuple):
    """A round basket."""

    x: float
    y: float
    rim: float  # above the ground [m]
    radius: float  # [m]


def check_basket(basket: Basket) -> None:
    """Raise unless it stands in the hall, on the ground.

    Raises
    ------
    InputError
        Naming the field, its value and what is allowed.
    """
    if not all(map(math.isfinite, basket)):
        raise InputError(f"basket is {tuple(basket)}; allowed: finite numbers")
    if not basket.rim > 0.0:
        raise InputError(
            f"the basket's rim is at {basket.rim} m, inside the ground; allowed: (0.0, {CEILING})"
        )
    if not basket.rim < CEILING:
        raise InputError(f"the basket's rim is at {basket.rim} m; allowed: (0.0, {CEILING})")
    if not basket.radius > 0.0:
        raise InputError(f"basket_radius is {basket.radius}; allowed: above 0.0")
    for name, place in (("x", basket.x), ("y", basket.y)):
        if abs(place) + basket.radius > HALL:
            raise InputError(
                f"the basket reaches through a wall: {name} is {place}, its radius "
                f"{basket.radius}; allowed: within ±{HALL} m"
            )


@cached_njit()
def see(state: Array, seen: Array) -> None:
    """What is seen of a vehicle's state, shape (24,), into ten places."""
    for i in range(3):
        seen[2 * i], seen[2 * i + 1] = state[i], state[3 + i]
    swing(state, seen[SWING_X:])


def load_of(seen: Array, length: float) -> tuple[Array, Array]:
    """Position [m] and velocity [m/s] of the load on its taut cable, each of shape (3,)."""
    angles, rates = seen[[SWING_X, SWING_Y]], seen[[SWING_X + 1, SWING_Y + 1]]
    unit = direction(*angles.tolist())
    turning = np.append(np.cos(angles) * rates, 0.0)
    turning[2] = -(unit[:2] @ turning[:2]) / min(unit[2], -1e-3)  # across the cable
    return seen[:SWING_X:2] + length * unit, seen[1:SWING_X:2] + length * turning


@cached_njit()
def _fallen(drag: float, time: float) -> tuple[float, float]:
    """Seconds of its own speed that a falling thing keeps, and metres that it has fallen."""
    x = drag * time
    if x < 1e-4:  # both to the fourth order
        return time * (1.0 - x / 2.0 + x * x / 6.0), G * time * time * (
            0.5 - x / 6.0 + x * x / 24.0
        )
    kept = -math.expm1(-x) / drag
    return kept, G * (time - kept) / drag


@cached_njit()
def falling(position: Array, velocity: Array, wind: Array, drag: float, time: float) -> Array:
    """Where a load is some time after its release [m], shape (3,): exact for linear drag."""
    kept, down = _fallen(drag, time)
    place = position + wind * time + (velocity - wind) * kept
    place[2] -= down
    return place


@cached_njit()
def landing(position: Array, velocity: Array, wind: Array, drag: float, rim: float) -> Array:
    """Where a released load crosses the rim's plane from above: x, y [m] and the time [s].

    NaN when it hangs below the plane already.
    """
    out = np.full(3, math.nan)
    if position[2] < rim:
        return out
    low, high = 0.0, 0.1
    while falling(position, velocity, wind, drag, high)[2] > rim:
        low, high = high, 2.0 * high
    for _ in range(50):
        middle = 0.5 * (low + high)
        if falling(position, velocity, wind, drag, middle)[2] > rim:
            low = middle
        else:
            high = middle
    out[:2] = falling(position, velocity, wind, drag, high)[:2]
    out[2] = high
    return out


@cached_njit()
def crash(state: Array) -> float:
    """`crashed` of a vehicle's whole state, shape (24,)."""
    qw, qx, qy, qz = state[6], state[7], state[8], state[9]
    up = 2.0 * (qx * qz + qw * qy), 2.0 * (qy * qz - qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)
    return crashed(state[:3], up, state[17:20], state[CABLE_STATE] >= SLACK)


@cached_njit()
def crashed(place: Array, up: tuple[float, float, float], load: Array, tied: bool) -> float:
    """Reward of a vehicle that has crashed, 0 for one that flies (T Eq. 20).

    It must stay between walls, ground and ceiling, its load above the ground, and the cable below
    the rotors.

    Parameters
    ----------
    place, load : ndarray of shape (3,)
        Of the vehicle and the load [m].
    up : tuple of float
        Where the rotors' axis points to.
    tied : bool
        Whether the load hangs on the cable.
    """
    x, y, z = place[0], place[1], place[2]
    if max(abs(x), abs(y)) > HALL or z < 0.0 or z > CEILING or load[2] < 0.0:
        return WALL
    above = up[0] * (load[0] - x) + up[1] * (load[1] - y) + up[2] * (load[2] - z)
    return CABLE if tied and above > 0.0 else 0.0


def dunks(landed: Array, basket: Basket) -> bool:
    """Whether a load that crosses the rim's plane at (x, y, …) [m] falls in; NaN never does."""
    return math.hypot(landed[0] - basket.x, landed[1] - basket.y) <= basket.radius


def distance(seen: Array, basket: Basket) -> float:
    """Of the vehicle from the basket, in the plane [m]."""
    return math.hypot(seen[X] - basket.x, seen[Y] - basket.y)
