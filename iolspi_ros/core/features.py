"""Features of a state, φ(s).

The features of a state and an action, φ(s, a), are φ(s) in the block of that action and zero
in every other block (T IV-A), so they are never built: whoever needs them works on blocks.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError, check_choice, check_range

Array = NDArray[np.float64]

NORMALISATIONS = ("asymmetric", "symmetric")


@dataclass(frozen=True)
class RBFGrid:
    """An equidistant grid of Gaussian radial basis functions (T 9-1).

    Parameters
    ----------
    low, high : tuple of float, length n_dims
        Limits between which the centres are spaced, in the state's own units.
    centers : tuple of int, length n_dims
        Number of centres c_d along each dimension. A dimension with one centre does not
        vary: its factor is 1.
    normalisation : {"asymmetric", "symmetric"}
        "symmetric" maps every dimension to [-1, 1] (T Eq. 9-2) with one round width, that of
        the first dimension with more than one centre. "asymmetric" also scales each dimension
        by its number of centres (T Eqs. 9-4 to 9-9), which makes the functions ellipsoidal.
    width : float
        Width σ of a function in spacings of that first dimension's centres; T uses 1.

    Raises
    ------
    InputError
        When the limits, the numbers of centres or the width do not make a grid.

    References
    ----------
    T (Schonebaum 2016), sections 9-1-1 to 9-1-3.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    centers: tuple[int, ...]
    normalisation: str = "asymmetric"
    width: float = 1.0

    def __post_init__(self) -> None:
        if not len(self.low) == len(self.high) == len(self.centers) > 0:
            raise InputError(
                f"low, high and centers have {len(self.low)}, {len(self.high)} and "
                f"{len(self.centers)} entries; allowed: one each per dimension"
            )
        for d, (low, high, count) in enumerate(zip(self.low, self.high, self.centers, strict=True)):
            if not (np.isfinite(low) and np.isfinite(high) and low < high):
                raise InputError(f"low[{d}], high[{d}] are {low}, {high}; allowed: low < high")
            check_range(f"centers[{d}]", count, 1, 10_000)
        check_choice("normalisation", self.normalisation, NORMALISATIONS)
        check_range("width", self.width, 0.0, np.inf, low_open=True, high_open=True)

    @property
    def n_dims(self) -> int:
        """Number of state variables."""
        return len(self.centers)

    @property
    def size(self) -> int:
        """Number of functions, the product of the centres."""
        return int(np.prod(self.centers))

    @cached_property
    def _axes(self) -> tuple[tuple[Array, float], ...]:
        """Per dimension: the centres, and the gain that turns a distance to one into σ."""
        counts = np.array(self.centers)
        varying = counts[counts > 1]
        reference = int(varying[0]) if len(varying) else 1
        axes = []
        for low, high, count in zip(self.low, self.high, self.centers, strict=True):
            # Normalised, the spacing of the reference dimension is σ = 2 / (c_ref - 1); the
            # scale of T Eq. 9-9 then makes (c_d - 1) / (H - L) of the distance in dimension d.
            spacings = count - 1 if self.normalisation == "asymmetric" else reference - 1
            gain = spacings / (high - low) / self.width if count > 1 else 0.0
            axes.append((np.linspace(low, high, count), gain))
        return tuple(axes)

    @cached_property
    def _flat(self) -> tuple[NDArray[np.int64], Array, Array, tuple[slice, ...]]:
        """All centres in one row: their dimension, place and gain, and where each axis is."""
        counts = np.array(self.centers)
        dimension = np.repeat(np.arange(self.n_dims), counts)
        centers = np.concatenate([centers for centers, _ in self._axes])
        gains = np.array([gain for _, gain in self._axes])[dimension] * np.sqrt(0.5)
        ends = np.cumsum(counts)
        parts = tuple(slice(end - n, end) for end, n in zip(ends, counts, strict=True))
        return dimension, centers, gains, parts

    def weigh(self, weights: Array, state: Array) -> Array:
        """Sum of w φ(s) for one state, contracted dimension by dimension: φ is never built.

        Parameters
        ----------
        weights : ndarray of shape (n, size)
        state : ndarray of shape (n_dims,)

        Returns
        -------
        ndarray of shape (n,)
        """
        dimension, centers, gains, parts = self._flat
        distance = (state[dimension] - centers) * gains
        factors = np.exp(-(distance * distance))
        left = weights.reshape(len(weights), *self.centers)
        for part in reversed(parts):
            left = left @ factors[part]
        return left

    @property
    def points(self) -> Array:
        """Centres μ in the state's units, shape (size, n_dims), last dimension fastest."""
        mesh = np.meshgrid(*(centers for centers, _ in self._axes), indexing="ij")
        return np.stack([axis.ravel() for axis in mesh], axis=1)

    def __call__(self, states: Array, terminated: NDArray[np.bool_] | None = None) -> Array:
        """Evaluate every function.

        Parameters
        ----------
        states : ndarray of shape (n_samples, n_dims) or (n_dims,)
        terminated : ndarray of bool, shape (n_samples,), optional
            Rows after which nothing follows: their features are zero.

        Returns
        -------
        ndarray of shape (n_samples, size), or (size,) for a single state

        Raises
        ------
        InputError
            When the states do not have `n_dims` entries.
        """
        states = np.asarray(states, dtype=np.float64)
        if states.shape[-1:] != (self.n_dims,):
            raise InputError(f"state has shape {states.shape}; allowed: (..., {self.n_dims})")
        phi = np.ones((*states.shape[:-1], 1))
        for d, (centers, gain) in enumerate(self._axes):
            # T Eq. 9-3 is a product over dimensions: one short row of exponentials each.
            distance = (states[..., d, None] - centers) * gain
            factor = np.exp(-0.5 * distance * distance)
            phi = (phi[..., :, None] * factor[..., None, :]).reshape(*states.shape[:-1], -1)
        if terminated is not None:
            phi[np.asarray(terminated)] = 0.0
        return phi
