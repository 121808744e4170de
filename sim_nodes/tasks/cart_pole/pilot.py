"""How a person would balance the pole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Perform:
    """Push the cart under the pole."""

    lead = 0.25  # s: how far ahead of the angle the balancing hand reacts
    dead_zone = 0.05  # rad: small enough to leave alone

    def begin(self) -> None:
        """Nothing carries over between episodes."""

    def decide(self, state: Array, time: float) -> int:
        """Push towards the side that it leans to, soon."""
        lean = float(state[0]) + self.lead * float(state[1])
        return 1 if abs(lean) < self.dead_zone else (2 if lean > 0 else 0)
