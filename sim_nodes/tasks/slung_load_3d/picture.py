"""What the hall, the quadrotor and its load look like."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.quadrotor.airframe import Payload
from sim_nodes.tasks.shapes import (
    AMBER,
    BALL,
    BOX,
    CLAY,
    DARK,
    FLOOR,
    GREY,
    LINE,
    TEAL,
    VEHICLE,
    Picture,
    Point,
    Shape,
)
from sim_nodes.tasks.slung_load_3d.scene import (
    CEILING,
    DUNK,
    HALL,
    MISS,
    Basket,
    falling,
    load_of,
)

Array = NDArray[np.float64]

_BALL, _LINE, _CORNERS = 0.16, 0.03, 24


def picture(state: Array, basket: Basket, length: float, at: Point | None = None) -> Picture:
    """Hall, basket, cable, quadrotor and load; without the cable when the load is elsewhere.

    Parameters
    ----------
    state : ndarray of shape (10,)
    basket : Basket
    length : float
        Of the cable [m].
    at : (x, y, z), optional
        Where the load is when it is off its cable [m].
    """
    here: Point = (float(state[0]), float(state[2]), float(state[4]))
    load: Point = tuple(load_of(state, length)[0].tolist())
    end = load
    if at is not None:
        end, load = here, at
    return (
        Shape(FLOOR, BOX, ((0.0, 0.0, -0.02),), (2 * HALL, 2 * HALL, 0.04), (*GREY[:3], 0.35)),
        *_edges(),
        *_basket(basket),
        Shape("cable", LINE, (here, end), (_LINE, 0.0, 0.0), DARK),
        Shape(VEHICLE, BOX, (here,), (0.45, 0.45, 0.1), TEAL),
        Shape("load", BALL, (load,), (_BALL,) * 3, AMBER),
    )


def _edges() -> list[Shape]:
    """The hall's upright edges and its ceiling's."""
    corners = [(x * HALL, y * HALL) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    thin, pale = (_LINE, 0.0, 0.0), (*GREY[:3], 0.5)
    above = tuple((x, y, CEILING) for x, y in (*corners, corners[0]))
    edges = [
        Shape(f"edge {n}", LINE, ((x, y, 0.0), (x, y, CEILING)), thin, pale)
        for n, (x, y) in enumerate(corners)
    ]
    return [*edges, Shape("ceiling", LINE, above, thin, pale)]


def _basket(basket: Basket) -> list[Shape]:
    """Rim, foot and staves."""
    angles = np.linspace(0.0, math.tau, _CORNERS + 1)
    ring = [
        (basket.x + basket.radius * math.cos(a), basket.y + basket.radius * math.sin(a))
        for a in angles.tolist()
    ]
    thick = (2 * _LINE, 0.0, 0.0)
    staves = [
        Shape(f"basket, stave {n}", LINE, ((x, y, 0.0), (x, y, basket.rim)), thick, CLAY)
        for n, (x, y) in enumerate(ring[:-1:3])
    ]
    circles = [
        Shape(f"basket, {name}", LINE, tuple((x, y, z) for x, y in ring), thick, CLAY)
        for name, z in (("rim", basket.rim), ("foot", 0.0))
    ]
    return [*circles, *staves]


def released(before: Array, reward: float, times: Array, basket: Basket, payload: Payload) -> Array:
    """Where a load is that was released in the last step; see `SlungLoad3D.released`."""
    if reward not in (DUNK, MISS):
        return np.empty((0, 3))
    position, velocity = load_of(before, payload.length)
    calm = np.zeros(3)
    way = np.array([falling(position, velocity, calm, payload.drag, t) for t in times.tolist()])
    low = way[:, 2] <= _BALL / 2
    if low.any():  # it lies where it came down
        way[int(np.argmax(low)) :] = (*way[int(np.argmax(low)), :2], _BALL / 2)
    return way
