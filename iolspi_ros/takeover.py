"""Whether a person has the vehicle, decided at the vehicle's side; no ROS here."""

from __future__ import annotations

import time
from collections.abc import Callable

from iolspi_ros.core.learner import PERSON, Source

PATIENCE = 0.3
"""Seconds without a word after which a holder, or the action of a person, is gone."""
REPEAT = 0.1
"""Seconds at most between two words of who holds the vehicle."""
LOOK = 0.05
"""Seconds between two looks of who listens."""
Key = tuple[float, float]
"""Episode and step of an observation."""


class Listening:
    """A clock on which only the time passes in which somebody listened.

    A process that computed, or got no processor, has words waiting that it has not heard: nobody
    was silent meanwhile.

    Parameters
    ----------
    clock : callable
        Seconds on a steady clock.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._passed, self._looked = 0.0, clock()

    def __call__(self) -> float:
        """Seconds."""
        return self._passed + min(self._clock() - self._looked, 2 * LOOK)

    def look(self) -> None:
        """Say that what was said until now could be heard; call it every `LOOK`."""
        self._passed, self._looked = self(), self._clock()


class Takeover:
    """Who may act: anybody, or a person alone.

    Parameters
    ----------
    clock : callable
        Seconds on a steady clock of the machine's.

    Attributes
    ----------
    count : int
        Times that a person took the vehicle.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._said = False
        self._heard = self._acted = 0.0
        self._let_go = self._answered = (-1.0, -1.0)
        self.count = 0

    @property
    def held(self) -> bool:
        """Whether a person has the vehicle now."""
        return self._said and self._clock() - self._heard <= PATIENCE

    def hear(self, held: bool, seen: Key) -> None:
        """Take what `takeover` says, and the observation seen last by who says it."""
        now = self._clock()
        if held and not self.held:
            self._acted = now
            self.count += 1
        self._said, self._heard = held, now
        if not held:
            self._let_go = seen

    def takes(self, source: int, neutral: bool, seen: Key) -> bool:
        """Whether an action is taken, by who chose it; a person's is remembered as fresh.

        A person who answers what came after they gave the vehicle back has taken it: the word
        that says so is under way, on another topic.

        Parameters
        ----------
        source : int
        neutral : bool
            It is the neutral one, which as a hold is anybody's.
        seen : (float, float)
            The observation that it answers.
        """
        if source in PERSON:
            if source == Source.HUMAN and seen > self._let_go:  # a script's may be corrupted, too
                self.hear(True, seen)
            self._acted, self._answered = self._clock(), seen
            return True
        return not self.held or (neutral and source == Source.HOLD)

    def silent(self, shown: Key) -> bool:
        """Whether the person who has it has not acted for so long that neutral takes its place.

        Who has answered what is `shown` is waited for by nobody, however slowly the vehicle goes.
        """
        waited = self._answered != shown and self._clock() - self._acted > PATIENCE
        return self.held and waited
