"""Between this graph's frames (ENU, FLU: REP-103) and an autopilot's (NED, FRD).

Each map is its own inverse, so one function serves both ways.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ORDER = (1, 0, 2)
_SIGNS = np.array([1.0, 1.0, -1.0])


def swap_world(vector: Array) -> Array:
    """East-north-up to north-east-down, or back.

    Parameters
    ----------
    vector : ndarray of shape (..., 3)
        In any unit.

    Returns
    -------
    ndarray of shape (..., 3)
    """
    swapped: Array = np.asarray(vector, float)[..., _ORDER] * _SIGNS
    return swapped


def swap_body(vector: Array) -> Array:
    """Forward-left-up to forward-right-down, or back.

    Parameters
    ----------
    vector : ndarray of shape (..., 3)
        In any unit.

    Returns
    -------
    ndarray of shape (..., 3)
    """
    return np.asarray(vector, float) * np.array([1.0, -1.0, -1.0])
