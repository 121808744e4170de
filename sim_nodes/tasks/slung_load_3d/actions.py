"""What can be asked of the vehicle: accelerations, climbing, and letting the load go."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from iolspi_ros.task import Action, Symmetry
from iolspi_ros.task.description import MOST_ACTIONS

Array = NDArray[np.float64]

JOINTS = ("x", "y", "z", "swing_x", "swing_y")
"""What is seen: a position and a velocity of each."""
PUSH, CLIMB = 3.0, 0.8
"""Of the usual actions: acceleration each way [m/s²] (T IV-B); climb and descent [m/s]."""


class Actions(NamedTuple):
    """The list of actions; the last lets the load go.

    Attributes
    ----------
    values : ndarray of shape (n_actions, 2) or (n_actions, 3)
        Acceleration towards x and y [m/s²]; with vertical ones, climb [m/s].
    neutral : int
        That accelerates nowhere.
    """

    values: Array
    neutral: int

    @property
    def release(self) -> int:
        """Index of the action that lets the load go."""
        return len(self.values) - 1

    def nearest(self, push: Array) -> int:
        """Action that comes nearest to an acceleration, shape (2,), at the altitude held."""
        level = self.values[:-1]
        off = ((level[:, :2] - push) ** 2).sum(axis=1)
        if level.shape[1] == 3:
            off = np.where(level[:, 2] == 0.0, off, np.inf)
        return int(np.argmin(off))

    def described(self) -> tuple[Action, ...]:
        """The same for a task's description."""
        named = [Action(_name(value), value) for value in map(tuple, self.values[:-1].tolist())]
        return (*named, Action("release", tuple(self.values[-1].tolist())))


def usual(vertical: bool) -> Actions:
    """Nine accelerations, upwards and downwards if wanted, and a release."""
    level = list(product((-PUSH, 0.0, PUSH), repeat=2))
    if vertical:
        rows = [(*push, 0.0) for push in level]
        rows += [(0.0, 0.0, CLIMB), (0.0, 0.0, -CLIMB), (0.0, 0.0, 0.0)]
        return Actions(np.array(rows), 4)
    return Actions(np.array([*level, (0.0, 0.0)]), 4)


def listed(numbers: tuple[float, ...], vertical: bool) -> Actions:
    """Actions that somebody gives as one row of numbers, and a release.

    Raises
    ------
    InputError
        When they are no whole vectors, not finite, too many, or none stands still.
    """
    if not numbers:
        return usual(vertical)
    size = 3 if vertical else 2
    what = "x, y [m/s²] and climb [m/s]" if vertical else "x and y [m/s²]"
    if len(numbers) % size or not all(map(math.isfinite, numbers)):
        raise InputError(
            f"accelerations has {len(numbers)} entries: {list(numbers)}; allowed: {size} finite "
            f"numbers for each action, towards {what}"
        )
    rows = np.array(numbers).reshape(-1, size)
    still = np.flatnonzero(~rows.any(axis=1))
    if not len(still) or len(rows) >= MOST_ACTIONS:
        raise InputError(
            f"accelerations has {len(rows)} actions, {len(still)} of them zero; allowed: at most "
            f"{MOST_ACTIONS - 1}, and one of zeros, which is flown while nobody says anything"
        )
    return Actions(np.concatenate([rows, np.zeros((1, size))]), int(still[0]))


_MIRRORS = {
    "mirror in x": (np.array([[-1.0, 0.0], [0.0, 1.0]]), {"x": "-x", "swing_x": "-swing_x"}),
    "mirror in y": (np.array([[1.0, 0.0], [0.0, -1.0]]), {"y": "-y", "swing_y": "-swing_y"}),
    "x for y": (
        np.array([[0.0, 1.0], [1.0, 0.0]]),
        {"x": "y", "y": "x", "swing_x": "swing_y", "swing_y": "swing_x"},
    ),
}


def symmetries(chosen: Actions, fixed: Array) -> tuple[Symmetry, ...]:
    """What may be exchanged, about the middle of the hall: a quarter turn is two of these.

    Parameters
    ----------
    chosen : Actions
        Must be the same when mirrored.
    fixed : ndarray of shape (n, 2)
        Vectors in the plane that must stay: where the basket is, where the wind blows to.
    """
    found = []
    for name, (mirror, changed) in _MIRRORS.items():
        images = chosen.values.copy()
        images[:, :2] = images[:, :2] @ mirror
        off = np.abs(images[:-1, None] - chosen.values[None, :-1]).max(axis=2)
        if off.min(axis=1).max(initial=0.0) > 1e-9 or np.abs(fixed @ mirror - fixed).max() > 1e-9:
            continue
        variables = tuple(
            f"{changed.get(joint, joint)}.{what}"
            for joint in JOINTS for what in ("position", "velocity")
        )  # fmt: skip
        places = (*off.argmin(axis=1).tolist(), chosen.release)
        found.append(Symmetry(name, variables, places))
    return tuple(found)


def _name(value: tuple[float, ...]) -> str:
    if len(value) == 3 and not any(value[:2]) and value[2]:
        return f"{'up' if value[2] > 0 else 'down'} {abs(value[2]):g} m/s"
    return " ".join("0" if v == 0.0 else f"{v:+g}" for v in value)
