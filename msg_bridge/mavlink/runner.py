"""The thread that flies: setpoints at a fixed rate, whatever everybody else does."""

from __future__ import annotations

import threading
import time
import traceback

from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.voice import Say


class Clock:
    """Vehicle time [s]: the machine's steady clock, as many times as fast as the vehicle's."""

    def __init__(self, factor: float) -> None:
        self._factor, self._start = factor, time.monotonic()

    def now(self) -> float:
        """Since the clock was made [s]."""
        return (time.monotonic() - self._start) * self._factor

    def wall(self, seconds: float) -> float:
        """Wall time that a vehicle time takes [s]."""
        return seconds / self._factor


class Runner:
    """Runs a flight in a thread of its own, until it is stopped.

    Parameters
    ----------
    flight : Flight
    clock : Clock
    say : callable
        Takes words for people.
    """

    def __init__(self, flight: Flight, clock: Clock, say: Say) -> None:
        self._flight, self._clock, self._say = flight, clock, say
        self._stopping = threading.Event()
        self._failed = -1.0
        self._thread = threading.Thread(target=self._run, name="setpoints", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        clock, flight = self._clock, self._flight
        period = 1.0 / flight.settings.rate
        due = clock.now()
        while not self._stopping.is_set():
            flight.link.wait(clock.wall(due - clock.now()))
            now = clock.now()
            try:
                if now >= due:
                    due = max(due + period, now)
                    flight.tick(now)
                else:
                    flight.listen(now)
            except Exception:
                self._survive(now)

    def _survive(self, now: float) -> None:
        """Go on after a fault of our own: a thread that ends would leave the vehicle alone."""
        if now - self._failed > 1.0:
            self._failed = now
            self._say("warning", f"a fault in the bridge: {traceback.format_exc()}")
