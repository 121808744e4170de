"""Grids of functions: products of one function of each variable."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from iolspi_ros.core.basis import Basis, Table
from iolspi_ros.errors import InputError, check_choice, check_range

Array = NDArray[np.float64]

BASES = ("rbf", "chebyshev")
NORMALISATIONS = ("asymmetric", "symmetric", "none")


@dataclass(frozen=True)
class RBFGrid(Basis):
    """An equidistant grid of Gaussian radial basis functions (T 9-1).

    Parameters
    ----------
    low, high, centers
        As of every basis; the centres are spaced evenly from low to high.
    normalisation : {"asymmetric", "symmetric"}
        "symmetric" maps every dimension to [-1, 1] (T Eq. 9-2) with one round width, that of
        the first dimension with more than one centre. "asymmetric" also scales each dimension
        by its number of centres (T Eqs. 9-4 to 9-9), which makes the functions ellipsoidal.
        "none" leaves the state as it is (T Eq. 8-2).
    width : float
        Width σ of a function in spacings of that first dimension's centres, or unnormalised in
        the units of the state; T uses 1.
    periodic : tuple of bool
        Dimensions in which `high` is `low` again, one for all or each. There the functions
        wrap around and no centre stands at `high`. T has none.
    constant : bool
        A function before the others that is 1 everywhere (T Eq. 8-2).
    kept : tuple of int
        Numbers of the Gaussians that were not trimmed away; empty for all.

    Raises
    ------
    InputError
        When the limits, the numbers of centres or the width do not make a grid.

    References
    ----------
    T (Schonebaum 2016), sections 9-1-1 to 9-1-4 and 8-1.
    """

    normalisation: str = "asymmetric"
    width: float = 1.0
    periodic: tuple[bool, ...] = (False,)
    constant: bool = False
    kept: tuple[int, ...] = field(default=(), repr=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("normalisation", self.normalisation, NORMALISATIONS)
        check_range("width", self.width, 0.0, np.inf, low_open=True, high_open=True)
        if len(self.periodic) not in (1, self.n_dims):
            raise InputError(
                f"periodic has {len(self.periodic)} entries; allowed: 1 or {self.n_dims}"
            )

    @cached_property
    def _axes(self) -> tuple[list[Array], Array, Array]:
        """Centres, gain and period of each dimension."""
        wraps = np.broadcast_to(np.array(self.periodic), (self.n_dims,))
        ranges = np.subtract(self.high, self.low)
        steps = np.array(self.centers) - ~wraps
        varying = np.flatnonzero(np.array(self.centers) > 1)
        reference = steps[varying[0]] if len(varying) else 1
        # Normalised, the spacing of the reference dimension is σ = 2 / (c_ref - 1); the scale
        # of T Eq. 9-9 then makes (c_d - 1) / (H - L) of the distance in dimension d.
        spacings = {"asymmetric": steps, "symmetric": reference, "none": ranges}[self.normalisation]
        gains = np.where(np.array(self.centers) > 1, spacings / ranges / self.width, 0.0)
        centers = [
            np.linspace(low, high, count, endpoint=not wrap)
            for low, high, count, wrap in zip(self.low, self.high, self.centers, wraps, strict=True)
        ]
        return centers, gains, np.where(wraps, ranges, 0.0)

    @cached_property
    def table(self) -> Table:
        """The numbers that evaluate it."""
        centers, gains, periods = self._axes
        counts = np.array(self.centers)
        numbers = np.arange(math.prod(self.centers)) if self.constant else ()
        kept = np.stack(np.unravel_index(np.array(self.kept or numbers, np.int64), counts), axis=1)
        if self.constant:
            kept = np.insert(kept, 0, -1, axis=0)
        places = np.concatenate(centers)
        return Table(False, counts, places, gains, periods, np.ascontiguousarray(kept),
                     np.zeros((0, self.n_dims)))  # fmt: skip

    @property
    def points(self) -> Array:
        """Centres μ in the state's units, shape (size, n_dims), last dimension fastest."""
        mesh = np.meshgrid(*self._axes[0], indexing="ij")
        points = np.stack([axis.ravel() for axis in mesh], axis=1)
        return points[list(self.kept)] if self.kept else points

    def trim(self, states: Array) -> RBFGrid:
        """Keep the centres inside the convex hull of some states (T 9-1-4).

        The hull spans the dimensions that vary; the others do not count.

        Parameters
        ----------
        states : ndarray of shape (n_samples, n_dims)

        Returns
        -------
        RBFGrid

        Raises
        ------
        InputError
            When the states span no hull, or no centre is inside.
        """
        varying = [d for d, count in enumerate(self.centers) if count > 1]
        points, samples = self.points[:, varying], np.asarray(states)[:, varying]
        if len(varying) == 1:
            inside = (points[:, 0] >= samples.min()) & (points[:, 0] <= samples.max())
        else:
            try:
                inside = Delaunay(samples).find_simplex(points) >= 0
            except (QhullError, ValueError) as error:
                raise InputError(
                    f"{len(samples)} states span no convex hull in {len(varying)} dimensions; "
                    f"allowed: at least {len(varying) + 1} that do not lie in a plane or a line"
                ) from error
        if not inside.any():
            raise InputError(
                f"none of {self.size} centres is in the convex hull of {len(samples)} states; "
                "allowed: states that spread over at least one centre, or a finer grid"
            )
        numbers = np.array(self.kept)[inside] if self.kept else np.flatnonzero(inside)
        return replace(self, kept=tuple(numbers.tolist()))


@dataclass(frozen=True)
class ChebyshevGrid(Basis):
    """Chebyshev polynomials of the first kind, multiplied out by T Eqs. 4-2 to 4-5.

    Dimension d has the polynomials ψ_0 to ψ_(c_d - 1) of its variable normalised to [-1, 1]
    (T Eq. 4-3); a state beyond the limits counts as at the limit, since polynomials explode
    there. T multiplies with polynomials of the action too; as many as there are actions span
    the same functions as a block for each action, which is what we have.
    """

    @cached_property
    def table(self) -> Table:
        """The numbers that evaluate it."""
        low, high, counts = np.array(self.low), np.array(self.high), np.array(self.centers)
        places = np.repeat((low + high) / 2, counts)
        nothing = np.empty((0, self.n_dims), np.int64)
        return Table(True, counts, places, 2 / (high - low), np.zeros(self.n_dims), nothing,
                     np.zeros((0, self.n_dims)))  # fmt: skip
