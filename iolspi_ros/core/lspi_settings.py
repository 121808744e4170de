"""Everything that least-squares policy iteration takes, each with its default and range."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from iolspi_ros.core.basis import Basis
from iolspi_ros.core.buffer import Buffer, Cells, Partition
from iolspi_ros.core.features import BASES, NORMALISATIONS, ChebyshevGrid, RBFGrid
from iolspi_ros.core.kernels import Crowds, Kernels
from iolspi_ros.core.moments import SCALINGS
from iolspi_ros.core.shield import Shield
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription

AUTO, GRID = "auto", "rbf"
ALGORITHMS = ("refreshed", "literal")

CELLS_PER_CENTER = 2
"""Boxes of the buffer along a dimension, for each of its centres."""
UNLIMITED = 10.0
"""What the shield takes for the limit of a variable that has none, in its own unit."""
MOST_CENTERS, LEAST_CENTERS, USUAL_SIZE = 11, 3, 600
"""Of a grid whose centres nobody gave: per dimension, and functions in all."""


@dataclass(frozen=True)
class LSPISettings(Settings):
    """Everything that T Algorithms 1 and 2 and their refreshed form take, and the features.

    Units: SI and radians, those of the state. What is empty by default comes from the task, by
    `resolve`.
    """

    algorithm: str = setting(
        "refreshed",
        "keep samples and iterate policies on them, or T Algorithm 2 to the letter",
        choices=ALGORITHMS,
    )
    basis: str = setting(
        "",
        "a grid of radial functions (T 9-1) or Chebyshev polynomials (T 4-1-2); auto: radial "
        "functions around the samples; empty for a grid where centers are given, and else auto",
        choices=("", *BASES, AUTO),
    )
    kernels: int = setting(500, "auto: functions of a state, at most", low=1)
    metric: tuple[float, ...] = setting(
        (1.0,),
        "auto: what each variable's range counts beside others', one for all or each",
        low=0.0,
        low_open=True,
        high=1e6,
    )
    low: tuple[float, ...] = setting(
        (), "lower limits of the grid of centres; else the task's", endless=True
    )
    high: tuple[float, ...] = setting(
        (), "upper limits of the grid of centres; else the task's", endless=True
    )
    centers: tuple[int, ...] = setting(
        (), "centres per dimension (T IV-A); else by their number", low=1
    )
    periodic: tuple[bool, ...] = setting(
        (), "dimensions in which high is low again, one for all or each; else the task's; T: false"
    )
    normalisation: str = setting(
        "asymmetric", "scaling of the dimensions, T 9-1-2, 9-1-3 or 8-1", choices=NORMALISATIONS
    )
    width: float = setting(
        1.0, "width of a function in spacings of the centres", low=0.0, low_open=True
    )
    constant: bool = setting(False, "rbf: a function that is 1 everywhere besides (T Eq. 8-2)")
    epsilon: float = setting(0.2, "exploration rate, or where it starts", low=0.0, high=1.0)
    epsilon_decay: float = setting(
        1.0, "factor on the exploration rate per second (T Eq. 14)", low=0.0, high=1.0
    )
    epsilon_min: float = setting(0.0, "exploration rate never decays below", low=0.0, high=1.0)
    update_interval: int = setting(1000, "steps between solves, K_theta", low=1)
    forget_factor: float = setting(
        1.0, "weight kept per step, eta (T Eq. 9-10)", low=0.0, high=1.0, low_open=True
    )
    scaling: str = setting(
        "samples", "literal: divisor of a solve, T Eq. 9-14 or 9-15", choices=SCALINGS
    )
    delta: float = setting(1.0, "literal: Gamma starts as delta times the identity", low=0.0)
    chi: float = setting(0.01, "offline LSPI stops when the weights change less", low=0.0)
    max_iterations: int = setting(30, "offline LSPI stops after so many iterations", low=1)
    buffer_size: int = setting(6000, "refreshed: samples kept", low=1)
    samples_per_cell: int = setting(
        8, "refreshed: samples kept of one action in a box of half a spacing each way", low=1
    )
    keep_demonstrations: bool = setting(
        True, "refreshed: demonstrated samples have places of their own in the buffer"
    )
    refresh_iterations: int = setting(
        20, "refreshed: an update gives a delta up after so many policies", low=1
    )
    refresh_budget: float = setting(
        0.0, "refreshed: an update starts no policy after so long [s]; 0.0 for no limit", low=0.0
    )

    shield: bool = setting(False, "veto actions that are predicted to lead out of the envelope")
    envelope_low: tuple[float, ...] = setting(
        (-np.inf,), "shield: lower limits of the state, one for all or each", endless=True
    )
    envelope_high: tuple[float, ...] = setting(
        (np.inf,), "shield: upper limits of the state, one for all or each", endless=True
    )
    envelope_round: tuple[bool, ...] = setting(
        (), "shield: variables whose limits are those of one ellipse together, not of a box"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not all(low < high for low, high in zip(self.low, self.high, strict=False)):
            raise InputError(f"low is {self.low}, high {self.high}; allowed: low < high in each")
        known = self.low and self.high and np.isfinite([*self.low, *self.high]).all()
        if known and self.centers and self.basis != AUTO:
            self.features()  # the grid checks itself
        if self.basis == AUTO and self.algorithm != "refreshed":
            raise InputError(
                f"algorithm is {self.algorithm} with basis {AUTO}; allowed: refreshed, since Γ of "
                "one basis says nothing in another"
            )
        low, high = np.broadcast_arrays(np.array(self.envelope_low), np.array(self.envelope_high))
        if not (low < high).all():
            raise InputError(
                f"envelope_low is {self.envelope_low}, envelope_high {self.envelope_high}; "
                "allowed: each low < high"
            )
        rounded, limited = np.array(self.envelope_round, bool), np.isfinite(high - low)
        if len(limited) in (1, len(rounded)) and (rounded & ~limited).any():
            raise InputError(
                f"envelope_round is {self.envelope_round} where a limit is missing; allowed: "
                "variables with a finite number in envelope_low and in envelope_high"
            )
        if self.shield and not (np.isfinite(low) | np.isfinite(high)).any():
            raise InputError(
                "shield is on without a limit; allowed: a finite number in envelope_low or "
                "envelope_high"
            )

    def resolve(self, task: TaskDescription) -> LSPISettings:
        """With the task's limits and a grid where none are given.

        Raises
        ------
        InputError
            When the grid is of another number of dimensions, or the task has no limits.
        """
        n = task.n_dims
        for name in (
            "low", "high", "centers", "metric", "periodic", "envelope_low", "envelope_high",
            "envelope_round",
        ):  # fmt: skip
            count = len(getattr(self, name))
            for_all = name in ("metric", "periodic", "envelope_low", "envelope_high")
            if count not in ((0, 1, n) if for_all else (0, n)):
                raise InputError(
                    f"{name} has {count} entries; allowed: {n}, one for each of "
                    f"{', '.join(task.names)}"
                )
        count = min(max(int(USUAL_SIZE ** (1.0 / n)), LEAST_CENTERS), MOST_CENTERS)
        grid = bool(self.centers) or self.algorithm == "literal"
        found = replace(
            self,
            basis=self.basis or (GRID if grid else AUTO),
            low=self.low or task.low,
            high=self.high or task.high,
            centers=self.centers or (count,) * n,
            periodic=self.periodic or task.periodic,
        )
        for name, low, high in zip(task.names, found.low, found.high, strict=True):
            if found.basis != AUTO and not math.isfinite(high - low):
                raise InputError(
                    f"variable {name} of task {task.name} has no limits; allowed: give the "
                    "parameters low and high of the grid, or basis: auto"
                )
        return found

    def features(self) -> Basis:
        """The basis functions of a state."""
        if self.basis == AUTO:
            wraps = np.broadcast_to(np.array(self.periodic), (len(self.low),))
            return Kernels.unseen(np.where(wraps, np.subtract(self.high, self.low), 0.0))
        if self.basis == "chebyshev":
            return ChebyshevGrid(self.low, self.high, self.centers)
        return RBFGrid(
            self.low, self.high, self.centers, self.normalisation, self.width, self.periodic,
            self.constant,
        )  # fmt: skip

    def guarded(self, task: TaskDescription) -> Shield:
        """A shield of a task that has seen nothing."""
        edges = np.clip([self.low, self.high], -UNLIMITED, UNLIMITED)
        period = self.features().table.periods
        low, high = (
            np.broadcast_to(np.array(limit, float), (len(self.low),)).copy()
            for limit in (self.envelope_low, self.envelope_high)
        )
        round_ = np.array(self.envelope_round or (False,) * len(low), bool)
        return Shield.empty(
            self.shield, low, high, round_, edges.mean(axis=0), (edges[1] - edges[0]) / 2, period,
            task.n_actions, np.array([action.value for action in task.actions], float),
        )  # fmt: skip

    def buffer(self) -> Buffer:
        """An empty buffer."""
        features = self.features()
        counts = tuple(CELLS_PER_CENTER * count for count in self.centers)
        cells: Partition = (
            Crowds(features.points, features.scales, features.periods)
            if isinstance(features, Kernels)
            else Cells(self.low, self.high, counts)
        )
        return Buffer.empty(
            cells, self.samples_per_cell, self.buffer_size, self.keep_demonstrations
        )
