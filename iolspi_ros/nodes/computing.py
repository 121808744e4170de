"""What a learner computes beside the control thread, and what is observed while it does."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from iolspi_ros.beside import beside, finished
from iolspi_ros.core.learner import Learner, Update
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.saving.keeper import Snapshot


class Computing:
    """One computation at a time: an update, or learning from demonstrations.

    Parameters
    ----------
    core : Learner

    Attributes
    ----------
    before : Snapshot or None
        What was known when the computation under way began.
    since : list of Transition
        What was observed since.
    cut : bool
        Whether learning from demonstrations was told to stop, and is half done.
    """

    def __init__(self, core: Learner) -> None:
        self._core = core
        self._future: Future[Any] | None = None
        self._finish: Callable[[Any], Update] | None = None  # of an update
        self._stopped = False
        self.before: Snapshot | None = None
        self.since: list[Transition] = []
        self.cut = False

    @property
    def under_way(self) -> bool:
        """Whether anything is being computed, or waits to be taken."""
        return self._future is not None

    @property
    def updating(self) -> bool:
        """Whether an update is being computed, or waits to be taken."""
        return self._future is not None and self._finish is not None

    @property
    def pretraining(self) -> bool:
        """Whether it learns from demonstrations, or that waits to be taken."""
        return self._future is not None and self._finish is None

    def update(self, before: Snapshot) -> None:
        """Begin an update."""
        self._finish = self._core.finish_update
        self._begin(before, self._core.begin_update())

    def pretrain(self, before: Snapshot, transitions: Transitions) -> None:
        """Begin to learn from demonstrations."""

        def proceed(share: float) -> bool:
            self.cut = self._stopped
            return not self.cut

        self._finish = None
        self._begin(before, lambda: self._core.pretrain(transitions, proceed))

    def _begin(self, before: Snapshot, compute: Callable[[], Any]) -> None:
        assert self._future is None
        self.before, self.since = before, []
        self._future = beside(compute)

    def stop(self) -> None:
        """Have learning from demonstrations end early."""
        self._stopped = True

    def over(self, seconds: float = 0.0) -> bool:
        """Whether within some seconds nothing is computed any more; it may wait to be taken."""
        return finished(self._future, seconds)

    def take(self) -> Update:
        """What was computed; whatever went wrong in it is raised here."""
        assert self._future is not None
        (future, self._future), self.before = (self._future, None), None
        found = future.result()
        return found if self._finish is None else self._finish(found)
