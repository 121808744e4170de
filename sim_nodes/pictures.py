"""What a task looks like: shapes in metres, for RViz and for the animation of a report.

x points to the right, y away, z upwards (ENU); every task here moves in the plane y = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import Task
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import Outcome, SlungLoad, outcome

Array = NDArray[np.float64]
Point = tuple[float, float, float]
Colour = tuple[float, float, float, float]

BOX, BALL, LINE = "box", "ball", "line"

_DARK, _TEAL, _GREY = (0.12, 0.16, 0.20, 1.0), (0.04, 0.45, 0.52, 1.0), (0.60, 0.63, 0.66, 1.0)
_AMBER, _CLAY = (0.90, 0.55, 0.10, 1.0), (0.55, 0.35, 0.20, 1.0)

_BASKET_DEPTH, _PLANK = 0.6, 0.06  # [m]; T gives neither
_WALL_HEIGHT = 3.0
_BALL = 0.24
_FLOOR = (_BALL + _PLANK) / 2 - _BASKET_DEPTH  # where the load lies, above the rim [m]
FALL_TIME = 0.7
"""How long a dropped load is followed [s]: 2.4 m from rest."""


class Shape(NamedTuple):
    """A thing of one colour.

    Attributes
    ----------
    name : str
        Unlike any other of the same picture.
    kind : str
        BOX, BALL or LINE.
    points : tuple of (x, y, z)
        Centre of a box or ball, corners of a line [m].
    size : (x, y, z)
        Edges of a box, diameters of a ball, and a line's width first [m].
    colour : (red, green, blue, opacity)
        Each 0 to 1.
    """

    name: str
    kind: str
    points: tuple[Point, ...]
    size: Point
    colour: Colour


Picture = tuple[Shape, ...]


def picture(task: Task, state: Array) -> Picture:
    """What a state looks like; always the same shapes in the same order. Some tasks have none.

    Parameters
    ----------
    task : Task
    state : ndarray of shape (n_dims,)
    """
    draw = _PICTURES.get(task.name)
    return draw(task, state) if draw else ()


def dropped(task: Task, before: Array, reward: float, times: Array) -> Array:
    """Where a load is that was dropped in an episode's last step.

    Parameters
    ----------
    task : Task
    before : ndarray of shape (n_dims,)
        The state that the step left.
    reward : float
        Of the step.
    times : ndarray of shape (n,)
        Since then [s].

    Returns
    -------
    ndarray of shape (n, 2)
        x and z [m]; of shape (0, 2) when nothing was dropped.
    """
    if not isinstance(task, SlungLoad):
        return np.empty((0, 2))
    ended = outcome(reward, True)
    if ended not in (Outcome.DUNK, Outcome.MISS):
        return np.empty((0, 2))
    way = task.fall(before, times)
    if ended == Outcome.DUNK:  # it comes to rest in the basket
        landed = way[:, 1] <= _FLOOR - task.rim
        if landed.any():
            first = int(np.argmax(landed))
            way[first:] = (way[first, 0], _FLOOR - task.rim)
    return way


def film(task: Task, states: Sequence[Array], reward: float) -> list[Picture]:
    """A picture for each state of an episode, and of what falls after it, T_s apart.

    Parameters
    ----------
    task : Task
    states : sequence of ndarray of shape (n_dims,)
        At least two.
    reward : float
        Of the last step.
    """
    times = task.dt * np.arange(1.0, round(FALL_TIME / task.dt))
    falling = dropped(task, states[-2], reward, times)
    if not len(falling):
        return [picture(task, state) for state in states]
    pictures = [picture(task, state) for state in states[:-1]]
    return pictures + [_without_load(pictures[-1], x, z) for x, z in falling.tolist()]


def trail(task: Task, states: Array, reward: float) -> Array | None:
    """The way in the plane that tells how an episode went; None when its angle over time does.

    Parameters
    ----------
    task : Task
    states : ndarray of shape (n_states, n_dims)
        At least two.
    reward : float
        Of the last step.

    Returns
    -------
    ndarray of shape (n, 2), or None
        x and z [m].
    """
    if not isinstance(task, SlungLoad):
        return None
    falling = dropped(task, states[-2], reward, np.linspace(0.0, FALL_TIME, 15))
    x, angle = (states[:-1] if len(falling) else states)[:, [0, 2]].T
    swung = np.column_stack([x + task.length * np.sin(angle), -task.length * np.cos(angle)])
    return np.concatenate([swung, falling])


def _without_load(seen: Picture, x: float, z: float) -> Picture:
    """The same quadrotor with its cable gone and the load elsewhere."""
    here = next(shape.points[0] for shape in seen if shape.name == "quadrotor")
    moved = {"load": ((x, 0.0, z),), "cable": (here, here)}
    return tuple(shape._replace(points=moved.get(shape.name, shape.points)) for shape in seen)


def _pendulum(task: Pendulum, state: Array) -> Picture:
    angle, length = float(state[0]), task.length
    bob = (length * math.sin(angle), 0.0, length * math.cos(angle))
    centre = (0.0, 0.0, 0.0)
    thick = length / 12
    return (
        Shape("rod", LINE, (centre, bob), (thick, 0.0, 0.0), _DARK),
        Shape("pivot", BALL, (centre,), (2 * thick,) * 3, _GREY),
        Shape("bob", BALL, (bob,), (4 * thick,) * 3, _TEAL),
    )


def _slung_load(task: SlungLoad, state: Array) -> Picture:
    x, angle, length = float(state[0]), float(state[2]), task.length
    here = (x, 0.0, 0.0)
    load = (x + length * math.sin(angle), 0.0, -length * math.cos(angle))
    left, right = task.goal - task.margin, task.goal + task.margin
    middle, bottom = -task.rim - _BASKET_DEPTH / 2, -task.rim - _BASKET_DEPTH
    side, deep = (_PLANK, 2 * task.margin, _BASKET_DEPTH), 2 * task.margin
    walls = [
        Shape(name, BOX, ((at, 0.0, 0.0),), (_PLANK, deep, _WALL_HEIGHT), (*_GREY[:3], 0.5))
        for name, at in zip(("left wall", "right wall"), task.walls, strict=True)
    ]
    return (
        *walls,
        Shape("basket, left", BOX, ((left, 0.0, middle),), side, _CLAY),
        Shape("basket, right", BOX, ((right, 0.0, middle),), side, _CLAY),
        Shape("basket, floor", BOX, ((task.goal, 0.0, bottom),), (deep, deep, _PLANK), _CLAY),
        Shape("cable", LINE, (here, load), (0.03, 0.0, 0.0), _DARK),
        Shape("quadrotor", BOX, (here,), (0.7, 0.7, 0.1), _TEAL),
        Shape("load", BALL, (load,), (_BALL,) * 3, _AMBER),
    )


_PICTURES: dict[str, Callable[[Any, Array], Picture]] = {
    "pendulum": _pendulum,
    "slung_load": _slung_load,
}
