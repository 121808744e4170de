"""Saving a learner that a command trains: while it learns, and whatever ends it."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from iolspi_ros.cli.progress import console
from iolspi_ros.core.learner import Learner, Source, Update, update
from iolspi_ros.core.samples import Observation
from iolspi_ros.experiments.headless import Listener
from iolspi_ros.saving import checkpoint
from iolspi_ros.saving.keeper import Keeper, Snapshot

UPDATES, SECONDS, KEPT = 10, 10.0, 3
"""How often it is saved while learning, and how many are kept."""
ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
Found = TypeVar("Found")


class Saving:
    """A learner in training, of which a whole state is always at hand.

    Parameters
    ----------
    keeper : Keeper
    learner : Learner
    name : str
        Of the learner, as registered.

    Attributes
    ----------
    interrupted : bool
        Whether a signal has asked for an end.
    status : int
        Exit status that tells which.
    """

    def __init__(self, keeper: Keeper, learner: Learner, name: str) -> None:
        self._keeper, self._learner, self._name = keeper, learner, name
        self._before: Snapshot | None = None  # of what is being computed
        self.interrupted, self.status = False, 0

    def ask(self, number: int, _: object) -> None:
        """Take a signal: what is computed breaks off at once, the rest at the next step."""
        self.interrupted, self.status = True, 128 + number
        if self._before is not None:
            raise KeyboardInterrupt

    def snapshot(self) -> Snapshot:
        """What is known; while something is computed, what was known before."""
        if self._before is not None:
            return self._before
        return checkpoint.snapshot(self._learner, self._name, self._keeper.run)

    def computed(self, compute: Callable[[], Found]) -> Found:
        """Compute something that counts only when it is whole."""
        self._check()
        self._before = self.snapshot()
        found = compute()
        self._before = None
        return found

    def _check(self) -> None:
        if self.interrupted:
            raise KeyboardInterrupt

    def listener(self, other: Listener) -> Listener:
        """A listener that saves now and then, and ends training when a signal has asked."""

        def improve(learner: Learner) -> Update:
            made = self.computed(lambda: update(learner))
            self._keeper.updated()
            if self._keeper.due(UPDATES, SECONDS):
                self._keeper.offer(self.snapshot())
            return made

        def observed(observation: Observation, action: int, source: Source) -> None:
            self._check()
            if other.on_observation is not None:
                other.on_observation(observation, action, source)

        return replace(other, on_observation=observed, improve=improve)


@contextmanager
def saved(path: Path, learner: Learner, name: str) -> Iterator[Saving]:
    """Train a learner inside: it is saved while that goes on, and at the end, however it comes.

    A signal to end is taken for an end; what is half computed then is left out.
    """
    keeper = Keeper(path, KEPT, console.print)
    saving = Saving(keeper, learner, name)
    before: dict[Any, Any] = {number: signal.signal(number, saving.ask) for number in ENDS}
    try:
        yield saving
    except KeyboardInterrupt:
        saving.interrupted = True
    finally:
        for number in ENDS:
            signal.signal(number, signal.SIG_IGN)  # a second Ctrl-C must not cut the saving
        try:
            keeper.save(saving.snapshot())
            keeper.close()
        finally:
            for number in ENDS:
                signal.signal(number, before[number])
