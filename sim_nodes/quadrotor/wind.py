"""Wind: steady, and gusts with the spectra of Dryden (MIL-F-8785C, 3.7.2 and 3.7.3).

The low-altitude model. Gusts are carried past the vehicle by the steady wind, so its speed stands
where an aeroplane's airspeed does. Below 10 feet they are as at 10 feet. They are filtered white
noise, discretised exactly: variance and spectrum do not depend on the step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.errors import InputError, check_range

Array = NDArray[np.float64]

FOOT = 0.3048
"""[m]"""
_LOWEST, _HIGHEST = 10.0, 1000.0  # of the low-altitude model [ft]
STRONGEST = 30.0
"""Wind that anybody would ask for [m/s]."""


class Gusts(NamedTuple):
    """What turns white noise into gusts at one height, step and wind; axes along, across, up.

    Attributes
    ----------
    steady : ndarray of shape (3,)
        Velocity of the air without gusts [m/s].
    axes : ndarray of shape (3, 3)
        Rows: along, across and up, in the world.
    keep : ndarray of shape (3, 2, 2)
        What a step leaves of the two states of each axis.
    fresh : ndarray of shape (3, 2, 2)
        What it makes of two normal numbers.
    out : ndarray of shape (3, 2)
        From those states to a velocity [m/s].
    begin : ndarray of shape (3, 2)
        Standard deviations of those states in the long run; they are independent then.
    """

    steady: Array
    axes: Array
    keep: Array
    fresh: Array
    out: Array
    begin: Array


def check_wind(speed: float, direction: float) -> None:
    """Raise unless it is a wind.

    Raises
    ------
    InputError
        Naming the field, its value and what is allowed.
    """
    check_range("wind [m/s]", speed, 0.0, STRONGEST)
    if not math.isfinite(direction):
        raise InputError(f"wind_direction is {direction}; allowed: an angle [rad]")


def scales(speed: float, height: float) -> tuple[Array, Array]:
    """Lengths [m] and intensities [m/s] of gusts along, across and up (MIL-F-8785C).

    Parameters
    ----------
    speed : float
        Of the wind 20 feet above the ground [m/s].
    height : float
        Above the ground [m].
    """
    feet = min(max(height / FOOT, _LOWEST), _HIGHEST)
    rough = 0.177 + 0.000823 * feet
    long, up = feet / rough**1.2 * FOOT, 0.1 * speed
    across = up / rough**0.4
    return np.array([long, long, feet * FOOT]), np.array([across, across, up])


def gusts(speed: float, direction: float, height: float, dt: float, strength: float = 1.0) -> Gusts:
    """The air at a height, for steps of one length.

    Parameters
    ----------
    speed : float
        Of the steady wind [m/s].
    direction : float
        Where it blows to, counter-clockwise from east [rad].
    height : float
        [m]
    dt : float
        [s]
    strength : float
        Of the gusts, in the standard's own; 0 for none.
    """
    cosine, sine = math.cos(direction), math.sin(direction)
    axes = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    keep, fresh = np.zeros((3, 2, 2)), np.zeros((3, 2, 2))
    out, begin = np.zeros((3, 2)), np.zeros((3, 2))
    lengths, intensities = scales(speed, height)
    for axis in range(3 if speed > 0.0 and strength > 0.0 else 0):
        rate, sigma = speed / lengths[axis], strength * intensities[axis]
        if axis == 0:  # Φ ~ 1 / (1 + (ω/a)²), a = V/L: one pole
            keep[axis, 0, 0] = math.exp(-rate * dt)
            begin[axis, 0], out[axis, 0] = 1.0, sigma
        else:  # Φ ~ (1 + 3 (ω/a)²) / (1 + (ω/a)²)²: two poles and a zero
            near = math.exp(-rate * dt)
            keep[axis] = near * np.array(
                [[1.0 + rate * dt, dt], [-rate * rate * dt, 1.0 - rate * dt]]
            )
            begin[axis] = 0.5 * rate**-1.5, 0.5 * rate**-0.5
            out[axis] = sigma * rate**1.5, sigma * math.sqrt(3.0 * rate)
        variance = np.diag(begin[axis] ** 2)
        lost = variance - keep[axis] @ variance @ keep[axis].T
        size = 1 if axis == 0 else 2
        fresh[axis, :size, :size] = np.linalg.cholesky(lost[:size, :size])
    return Gusts(speed * axes[0], axes, keep, fresh, out, begin)


@cached_njit()
def begin_gusts(air: Gusts, rng: np.random.Generator, gust: Array) -> None:
    """States of the gusts, shape (3, 2), as they are in the long run, in place."""
    for axis in range(3):
        for i in range(2):
            gust[axis, i] = air.begin[axis, i] * rng.standard_normal()


@cached_njit()
def blow(air: Gusts, rng: np.random.Generator, gust: Array, wind: Array) -> None:
    """One step of the gusts, in place, and the air's velocity [m/s], shape (3,), into `wind`."""
    wind[:] = air.steady
    for axis in range(3):
        first, second = rng.standard_normal(), rng.standard_normal()
        keep, fresh = air.keep[axis], air.fresh[axis]
        a = keep[0, 0] * gust[axis, 0] + keep[0, 1] * gust[axis, 1] + fresh[0, 0] * first
        b = keep[1, 0] * gust[axis, 0] + keep[1, 1] * gust[axis, 1]
        b += fresh[1, 0] * first + fresh[1, 1] * second
        gust[axis, 0], gust[axis, 1] = a, b
        speed = air.out[axis, 0] * a + air.out[axis, 1] * b
        for i in range(3):
            wind[i] += speed * air.axes[axis, i]
