"""What those who demonstrate ask of their node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from iolspi_ros.core.samples import Sample
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription


class SamplesOut(Protocol):
    """A managed node that publishes and records samples.

    Attributes
    ----------
    task : TaskDescription
    active : bool
    given : mapping
        Parameters that its arguments give it, by name.
    recorded : int
        Samples in the bag that are to be read.
    """

    task: TaskDescription
    active: bool
    given: Mapping[str, Any]
    recorded: int

    @property
    def corruption(self) -> float:
        """Probability that an action is replaced by a random one, as it is now."""
        ...

    def begin(self) -> None:
        """Start recording, if that is wanted, and say that a demonstration begins."""
        ...

    def end(self) -> None:
        """Say that the demonstration has ended, and close the bag."""
        ...

    def send(self, sample: Sample) -> None:
        """Record one transition, and publish it as soon as the listeners keep up."""
        ...

    def queue(self, sample: Sample, message: bytes) -> None:
        """Publish one transition as soon as the listeners keep up."""
        ...

    def flush(self) -> bool:
        """Publish what waits; False when a slow listener made some of it wait longer."""
        ...

    def record(self, topic: str, kind: str, stamp: int, data: bytes) -> None:
        """Write a serialised message to the bag, if one is being recorded."""
        ...

    def listeners(self) -> int:
        """How many nodes take samples."""
        ...

    def fail(self, error: InputError) -> None:
        """End the node."""
        ...

    def __getattr__(self, name: str) -> Any: ...
