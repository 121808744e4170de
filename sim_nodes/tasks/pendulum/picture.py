"""What the pendulum looks like."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.pendulum.dynamics import LENGTH
from sim_nodes.tasks.shapes import BALL, DARK, GREY, LINE, TEAL, Picture, Shape

Array = NDArray[np.float64]


def picture(state: Array) -> Picture:
    """Rod, pivot and bob."""
    angle, length = float(state[0]), LENGTH
    bob = (length * math.sin(angle), 0.0, length * math.cos(angle))
    centre = (0.0, 0.0, 0.0)
    thick = length / 12
    return (
        Shape("rod", LINE, (centre, bob), (thick, 0.0, 0.0), DARK),
        Shape("pivot", BALL, (centre,), (2 * thick,) * 3, GREY),
        Shape("bob", BALL, (bob,), (4 * thick,) * 3, TEAL),
    )
