"""The machine's own speed, beside which the others stand."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from iolspi_ros.bench.rows import Row


def fastest(work: Callable[[], object], times: int) -> float:
    """Least time of several runs [s]: others on the machine only ever add."""
    least = np.inf
    for _ in range(times):
        start = time.perf_counter()
        work()
        least = min(least, time.perf_counter() - start)
    return float(least)


def rows() -> list[Row]:
    """Speed of a matrix product in double precision, on one thread unless told otherwise."""
    matrix = np.random.default_rng(0).standard_normal((1500, 1500))
    took = fastest(lambda: matrix @ matrix, 5)
    return [Row("machine: dgemm", 2 * 1500**3 / took / 1e9, "GFLOP/s")]
