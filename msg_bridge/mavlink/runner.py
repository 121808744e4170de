"""The loop that flies: setpoints at a fixed rate, whatever everybody else does."""

from __future__ import annotations

import threading
import traceback

from msg_bridge.mavlink.clock import Clock
from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.status import Say

_CLOSE = 1e-6  # to the time of the next setpoint is at it [s]
_SHARE = 0.5  # of the machine time between two setpoints, in which is listened


class Runner:
    """Runs a flight: in a thread of its own from `start` to `stop`, or step by step.

    Parameters
    ----------
    flight : Flight
    clock : Clock
    say : callable
        Takes words for people.
    """

    def __init__(self, flight: Flight, clock: Clock, say: Say) -> None:
        self._flight, self._clock, self._say = flight, clock, say
        self._period = 1.0 / flight.rate
        self._due = clock.now()
        self._budget = _SHARE * clock.wall(self._period)
        self._spent = 0.0
        self._stopping = threading.Event()
        self._failed = -1.0
        self._thread = threading.Thread(target=self._run, name="setpoints", daemon=True)

    def start(self) -> None:
        """Begin, in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread."""
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join()

    def step(self) -> None:
        """Wait until something has come or a setpoint is due, and see to it.

        Setpoints come first, and listening has a budget: who floods us is not listened to
        until the next setpoint was sent.
        """
        left = self._clock.wall(self._due - self._clock.now())
        if self._spent < self._budget:
            self._flight.link.wait(left)
        else:
            self._stopping.wait(max(left, 0.0))
        now = self._clock.now()
        try:
            if now >= self._due - _CLOSE:
                self._due = max(self._due + self._period, now)
                self._flight.tick(now)
                self._spent = 0.0
            begun = self._clock.elapsed()
            end = begun + self._budget - self._spent
            all_of_it = self._flight.listen(now, lambda: self._clock.elapsed() < end)
            self._spent += self._clock.elapsed() - begun
            if all_of_it:  # a quiet link costs nobody anything: its time is not counted
                self._spent = min(self._spent, 0.9 * self._budget)
        except Exception:
            self._survive(now)

    def _run(self) -> None:
        while not self._stopping.is_set():
            self.step()

    def _survive(self, now: float) -> None:
        """Go on after a fault of our own: a thread that ends would leave the vehicle alone."""
        if now - self._failed > 1.0:
            self._failed = now
            self._say("warning", f"a fault in the bridge: {traceback.format_exc()}")
