"""How likely a load that is let go falls where the task wants it, as well as it is known where."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from msg_bridge.mavlink.flown import FlownTask
from msg_bridge.mavlink.motion import Motion, Vector

Array = NDArray[np.float64]

_DRAWS = 128  # a power of two, as the sequence wants it; they take some milliseconds
_OPENS = (0.0, 0.1)  # after it was told to, a gripper lets go [s]


def chance(task: FlownTask, motion: Motion, covariance: Array, noise: tuple[float, float]) -> float:
    """Probability that a load let go here falls where it should.

    Errors are drawn, always the same ones, and each is judged by the task itself: of the cable's
    direction and rate by their covariance, of position and velocity by their noise, and the time
    that a gripper takes is anything up to a tenth of a second.

    Parameters
    ----------
    task : FlownTask
    motion : Motion
        As it is believed to be.
    covariance : ndarray of shape (6, 6)
        Of the cable's direction and its rate.
    noise : tuple of float
        Standard deviations of the position [m] and of the velocity [m/s], along each axis.

    References
    ----------
    Quasi-random points: I. M. Sobol', USSR Comp. Math. Math. Phys. 7(4), 1967.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal, late = _draws()
    cables = np.array([*motion.cable, *motion.cable_rate]) + normal[:, :6] @ root.T
    places = np.array(motion.place) + noise[0] * normal[:, 6:9]
    speeds = np.array(motion.velocity) + noise[1] * normal[:, 9:12]
    wanted = task.landed(np.array(task.goal))
    hits = sum(
        task.dropped(_later(motion, place, speed, cable, wait)) == wanted
        for place, speed, cable, wait in zip(places, speeds, cables, late.tolist(), strict=True)
    )
    return hits / _DRAWS


def _later(motion: Motion, place: Array, speed: Array, cable: Array, wait: float) -> Motion:
    """The same motion with these, a moment later [s]."""
    direction, rate = cable[:3] + wait * cable[3:], cable[3:]
    direction = direction / np.linalg.norm(direction)
    rate = rate - float(rate @ direction) * direction
    x, across, height = (place + wait * speed).tolist()
    along, drift, climb = speed.tolist()
    return motion._replace(
        x=x, across=across, height=height, speed=along, drift=drift, climb=climb,
        cable=_vector(direction), cable_rate=_vector(rate),
    )  # fmt: skip


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z


@functools.cache
def _draws() -> tuple[Array, Array]:
    """Numbers of a normal distribution, shape (n, 12), and times until it opens [s], shape (n,)."""
    points = qmc.Sobol(13, scramble=False).fast_forward(_DRAWS).random(_DRAWS)
    low, high = _OPENS
    return ndtri(points[:, :12]), low + (high - low) * points[:, 12]
