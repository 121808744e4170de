"""The clocks of a bridge: the vehicle's, and the machine's that waits for it."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Vehicle time and machine time; both only ever grow."""

    def now(self) -> float:
        """Vehicle time [s]."""
        ...

    def elapsed(self) -> float:
        """Machine time [s]."""
        ...

    def wall(self, seconds: float) -> float:
        """Machine time that a vehicle time takes [s]."""
        ...


class VehicleClock:
    """The machine's steady clock, as many times as fast as the vehicle's.

    Parameters
    ----------
    factor : float
        Vehicle seconds per second.
    """

    def __init__(self, factor: float) -> None:
        self._factor, self._start = factor, time.monotonic()

    def now(self) -> float:
        """Vehicle time since the clock was made [s]."""
        return self.elapsed() * self._factor

    def elapsed(self) -> float:
        """Machine time since the clock was made [s]."""
        return time.monotonic() - self._start

    def wall(self, seconds: float) -> float:
        """Machine time that a vehicle time takes [s]."""
        return seconds / self._factor
