"""Shapes in metres, of which pictures of a vehicle are made: for RViz and for reports.

x points to the right, y away, z upwards (ENU); a task in two dimensions moves in the plane y = 0.
"""

from __future__ import annotations

from typing import NamedTuple

Point = tuple[float, float, float]
Colour = tuple[float, float, float, float]

BOX, BALL, LINE = "box", "ball", "line"

VEHICLE, FLOOR = "vehicle", "floor"
"""Names of shapes that a view in three dimensions knows: what it follows, what shadows fall on."""

DARK, TEAL, GREY = (0.12, 0.16, 0.20, 1.0), (0.04, 0.45, 0.52, 1.0), (0.60, 0.63, 0.66, 1.0)
AMBER, CLAY = (0.90, 0.55, 0.10, 1.0), (0.55, 0.35, 0.20, 1.0)


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

FALL_TIME = 0.7
"""How long what was released is followed [s]: 2.4 m from rest."""
