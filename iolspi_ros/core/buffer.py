"""Samples kept for the policies to come: bounded, and spread over the states visited."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.outliers import FEW, rare
from iolspi_ros.core.samples import Transitions

Array = NDArray[np.float64]


_RARE = 4 * FEW
"""Places for rewards far beyond all others, however many crowd with them."""


class Partition(Protocol):
    """Parts of the state space, in each of which a crowd counts as one."""

    @property
    def n_dims(self) -> int:
        """Number of state variables."""
        ...

    def __call__(self, states: Array, action: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of the part and action of each sample, shape (n_samples,)."""
        ...


@dataclass(frozen=True)
class Cells:
    """Boxes of the state space; those beyond the limits reach to infinity.

    Parameters
    ----------
    low, high : tuple of float, length n_dims
    counts : tuple of int, length n_dims
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    counts: tuple[int, ...]

    @property
    def n_dims(self) -> int:
        """Number of state variables."""
        return len(self.counts)

    def __call__(self, states: Array, action: NDArray[np.int64]) -> NDArray[np.int64]:
        """Number of the box and action of each sample, shape (n_samples,)."""
        low, counts = np.array(self.low), np.array(self.counts)
        share = (states - low) / (np.array(self.high) - low)
        place = np.clip(share * counts, 0, counts - 1).astype(np.int64)
        box = np.ravel_multi_index(tuple(place.T), self.counts).astype(np.int64)
        return box + action * int(np.prod(self.counts))


@dataclass(frozen=True)
class Buffer:
    """Samples in the order in which they came, at most `bound` of them.

    When a box of states has more than `per_cell` samples of one action, its oldest goes. When
    all boxes together still have too many, the fullest are thinned, then the oldest go.
    With `keep_demonstrations`, half as many places again are theirs in each box.

    Attributes
    ----------
    transitions : Transitions
    born : ndarray of int, shape (n_samples,)
        Online step k at which each came; demonstrations come at step 0.
    demonstrated : ndarray of bool, shape (n_samples,)
    cells : Cells
    per_cell, bound : int
    keep_demonstrations : bool
    """

    transitions: Transitions
    born: NDArray[np.int64]
    demonstrated: NDArray[np.bool_]
    cells: Partition
    per_cell: int
    bound: int
    keep_demonstrations: bool

    @classmethod
    def empty(
        cls, cells: Partition, per_cell: int, bound: int, keep_demonstrations: bool
    ) -> Buffer:
        """Without a sample."""
        none = np.zeros(0, np.int64)
        rows = Transitions.of([], cells.n_dims)
        return cls(rows, none, none.astype(bool), cells, per_cell, bound, keep_demonstrations)

    def __len__(self) -> int:
        return len(self.transitions)

    def add(
        self, batch: Transitions, step: int, demonstrated: NDArray[np.bool_] | bool = False,
        *, at_once: bool = False,
    ) -> Buffer:  # fmt: skip
        """With a batch more, and without what no longer fits.

        Parameters
        ----------
        batch : Transitions
            Oldest first.
        step : int
            Online step k of its last sample.
        demonstrated : ndarray of bool, shape (n_samples,), or bool for all
        at_once : bool
            All are as old as the last: they were not flown online.

        Returns
        -------
        Buffer
        """
        newer = np.zeros(len(batch), np.int64) if at_once else np.arange(len(batch))[::-1]
        born = step - newer
        shown = np.broadcast_to(demonstrated, len(batch))
        grown = replace(
            self,
            transitions=self.transitions + batch,
            born=np.concatenate([self.born, born]),
            demonstrated=np.concatenate([self.demonstrated, shown]),
        )
        return grown._rows(grown._staying())

    def weight(
        self, step: int, forget_factor: float, believed: NDArray[np.bool_] | None = None
    ) -> Array:
        """How much each sample counts: every box of states and action as much as another.

        A sample that came k steps ago counts η^k, as in T Eqs. 9-10 to 9-12; all of one box
        together count what its newest does. One that is not believed counts nothing.

        Returns
        -------
        ndarray of shape (n_samples,)
        """
        faded = forget_factor ** (step - self.born).astype(np.float64)
        if believed is not None:
            faded = np.where(believed, faded, 0.0)
        _, cell = np.unique(self._cell(), return_inverse=True)
        newest = np.zeros(cell.max(initial=-1) + 1)
        np.maximum.at(newest, cell, faded)
        together = np.bincount(cell, faded)
        weight: Array = faded * (newest / np.maximum(together, 1e-300))[cell]
        return weight

    def _cell(self) -> NDArray[np.int64]:
        return self.cells(self.transitions.state, self.transitions.action)

    def _rows(self, rows: NDArray[np.bool_]) -> Buffer:
        return replace(
            self,
            transitions=self.transitions[rows],
            born=self.born[rows],
            demonstrated=self.demonstrated[rows],
        )

    def _staying(self) -> NDArray[np.bool_]:
        """Which samples fit, shape (n_samples,).

        Rewards far beyond all others stay, up to a number that is believed.
        """
        staying, own = self._fitting(), rare(self.transitions.reward)
        own[np.flatnonzero(own)[:-_RARE]] = False
        staying |= own
        spare = int(staying.sum()) - self.bound
        if spare > 0:
            staying[np.flatnonzero(staying & ~own)[:spare]] = False
        return staying

    def _fitting(self) -> NDArray[np.bool_]:
        """Which samples fit, as many of each part as of another."""
        n = len(self)
        cell = self._cell()
        rank = _rank(cell)
        if self.keep_demonstrations:
            # They have places of their own, so that what is newer is never kept out.
            among = _rank(np.where(self.demonstrated, cell, -1 - np.arange(n)))
            rank = np.where(self.demonstrated, np.minimum(rank, 2 * among), rank)
        staying = rank < self.per_cell
        if staying.sum() <= self.bound:
            return staying
        fits = np.cumsum(np.bincount(rank, minlength=1)) <= self.bound
        depth = int(np.count_nonzero(fits))
        staying = rank < depth
        spare = self.bound - int(staying.sum())
        rest = np.flatnonzero(rank == depth)
        staying[rest[len(rest) - spare :]] = True
        return staying


def _rank(cell: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many of the same box came later, shape (n_samples,)."""
    order = np.argsort(cell, kind="stable")
    ends = np.searchsorted(cell[order], cell[order], side="right")
    rank = np.empty(len(cell), np.int64)
    rank[order] = ends - 1 - np.arange(len(cell))
    return rank
