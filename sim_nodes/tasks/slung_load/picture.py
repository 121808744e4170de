"""What the quadrotor, its load and the basket look like."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.shapes import (
    AMBER,
    BALL,
    BOX,
    CLAY,
    DARK,
    GREY,
    LINE,
    TEAL,
    Picture,
    Point,
    Shape,
)
from sim_nodes.tasks.slung_load.dynamics import (
    GOAL,
    LENGTH,
    MARGIN,
    RIM,
    WALLS,
    Outcome,
    falling,
    outcome,
)

Array = NDArray[np.float64]

_BASKET_DEPTH, _PLANK = 0.6, 0.06  # [m]; T gives neither
_WALL_HEIGHT = 3.0
_BALL = 0.24
_FLOOR = (_BALL + _PLANK) / 2 - _BASKET_DEPTH  # where the load lies, above the rim [m]


def released(before: Array, reward: float, times: Array) -> Array:
    """Where a load is that was released in the last step; see `SlungLoad.released`."""
    ended = outcome(reward, True)
    if ended not in (Outcome.DUNK, Outcome.MISS):
        return np.empty((0, 3))
    way = np.insert(falling(before, times), 1, 0.0, axis=1)
    if ended == Outcome.DUNK:  # it comes to rest in the basket
        landed = way[:, 2] <= _FLOOR - RIM
        if landed.any():
            first = int(np.argmax(landed))
            way[first:] = (way[first, 0], 0.0, _FLOOR - RIM)
    return way


def picture(state: Array, at: Point | None = None) -> Picture:
    """Walls, basket, cable, quadrotor and load; without the cable when the load is elsewhere.

    Parameters
    ----------
    state : ndarray of shape (4,)
    at : (x, y, z), optional
        Where the load is when it is off its cable [m].
    """
    x, angle = float(state[0]), float(state[2])
    here = (x, 0.0, 0.0)
    load = (x + LENGTH * math.sin(angle), 0.0, -LENGTH * math.cos(angle))
    end = load
    if at is not None:
        end, load = here, at
    left, right = GOAL - MARGIN, GOAL + MARGIN
    middle, bottom = -RIM - _BASKET_DEPTH / 2, -RIM - _BASKET_DEPTH
    side, deep = (_PLANK, 2 * MARGIN, _BASKET_DEPTH), 2 * MARGIN
    walls = [
        Shape(name, BOX, ((at, 0.0, 0.0),), (_PLANK, deep, _WALL_HEIGHT), (*GREY[:3], 0.5))
        for name, at in zip(("left wall", "right wall"), WALLS, strict=True)
    ]
    return (
        *walls,
        Shape("basket, left", BOX, ((left, 0.0, middle),), side, CLAY),
        Shape("basket, right", BOX, ((right, 0.0, middle),), side, CLAY),
        Shape("basket, floor", BOX, ((GOAL, 0.0, bottom),), (deep, deep, _PLANK), CLAY),
        Shape("cable", LINE, (here, end), (0.03, 0.0, 0.0), DARK),
        Shape("quadrotor", BOX, (here,), (0.7, 0.7, 0.1), TEAL),
        Shape("load", BALL, (load,), (_BALL,) * 3, AMBER),
    )
