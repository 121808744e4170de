"""What is computed many times: a frozen setting, realised from one seed after the other."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

from numpy.typing import NDArray

from iolspi_ros.experiments.versions import fingerprint

Realise: TypeAlias = Callable[[Any, int], Mapping[str, Any]]
Result: TypeAlias = dict[str, NDArray[Any]]
Data: TypeAlias = Mapping[str, Mapping[str, NDArray[Any]]]
"""By cell, then by name: the realisations of that cell, stacked, shape (n_seeds, ...)."""


@dataclass(frozen=True)
class Cell:
    """One setting, realised from seeds 0, 1, 2 and so on.

    Attributes
    ----------
    label : str
        What it is called within its figure or table.
    realise : callable
        `realise(setting, seed)`: numbers and arrays by name, of the same shapes for every seed.
        A module's own function, so that other processes find it.
    setting : dataclass
        Frozen; see `versions.fingerprint`.
    seeds : int
        Number of realisations.
    cost : float
        About how long one takes [s of one core]; only the order of work and the ETA depend on it.
    """

    label: str
    realise: Realise
    setting: Any
    seeds: int = 50
    cost: float = 1.0

    @cached_property
    def key(self) -> str:
        """Name of what makes its results: setting, code and versions."""
        return fingerprint(self.realise, self.setting)
