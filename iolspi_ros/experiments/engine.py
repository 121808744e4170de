"""Realisations by the hundred: what the store lacks is computed, kept one by one, and found again.

A realisation is a pure function of a frozen setting and a seed. Cells that several figures share
are computed once.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from iolspi_ros.experiments.cells import Cell, Data, Result
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.versions import fingerprint

Task: TypeAlias = tuple[int, Cell, int]  # number, cell, seed
Backend: TypeAlias = Callable[[Sequence[Task]], Iterator[tuple[int, Result]]]


def missing(cells: Iterable[Cell], store: Store) -> list[tuple[Cell, int]]:
    """Realisations that the store lacks, each once, the longest first."""
    wanted = {(cell.key, seed): (cell, seed) for cell in cells for seed in range(cell.seeds)}
    lacking = [(cell, seed) for cell, seed in wanted.values() if store.read(cell, seed) is None]
    return sorted(lacking, key=lambda item: -item[0].cost)


def run(
    lacking: Sequence[tuple[Cell, int]],
    keep: Callable[[Cell, int, Result], None],
    backend: Backend,
    show: Callable[[float], None] = lambda done: None,
) -> None:
    """Compute realisations and keep each as soon as it is there.

    Parameters
    ----------
    lacking : sequence of (Cell, seed)
    keep : callable
        Such as `Store.write`; called in this process only.
    backend : callable
        `local` or `cluster`.
    show : callable
        Is told how much is done, in the unit of `Cell.cost`.
    """
    tasks = [(number, cell, seed) for number, (cell, seed) in enumerate(lacking)]
    kept: set[int] = set()
    done = 0.0
    for number, result in backend(tasks):
        if number in kept:
            continue
        cell, seed = lacking[number]
        keep(cell, seed, result)
        kept.add(number)
        done += cell.cost
        show(done)


def gather(cells: Iterable[Cell], store: Store) -> Data:
    """Results of some cells from the store, which must have them all."""
    found: dict[str, dict[str, NDArray[Any]]] = {}
    for cell in cells:
        rows = [store.read(cell, seed) for seed in range(cell.seeds)]
        whole = [row for row in rows if row is not None]
        assert len(whole) == cell.seeds, f"{cell.label}: {len(whole)} of {cell.seeds} results"
        found[cell.label] = {name: np.stack([row[name] for row in whole]) for name in whole[0]}
    return found


def local(processes: int) -> Backend:
    """Processes of this machine, through joblib; one process is this one."""

    def compute(tasks: Sequence[Task]) -> Iterator[tuple[int, Result]]:
        parallel = Parallel(n_jobs=processes, return_as="generator_unordered")
        yield from parallel(delayed(_compute)(*task) for task in tasks)

    return compute


def cluster(address: str) -> Backend:
    """Workers of a Dask cluster. Tasks of a worker that dies go to another one.

    Raises
    ------
    InputError
        When Dask is not installed, or nobody answers at the address.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise InputError(
            "--backend dask needs Dask; allowed: install the package's extra 'cluster'"
        ) from None
    try:
        client = Client(address, timeout="5s")
    except (OSError, ValueError) as error:
        raise InputError(
            f"--scheduler {address}: no Dask scheduler answers ({error}); "
            "allowed: the address that `dask scheduler` prints, such as tcp://10.0.0.1:8786"
        ) from None

    def compute(tasks: Sequence[Task]) -> Iterator[tuple[int, Result]]:
        with client:
            # pure=False: results must not be taken from an older call with the same arguments.
            futures = [client.submit(_compute, *task, pure=False) for task in tasks]
            for future, answer in as_completed(futures, with_results=True):
                yield answer
                future.release()

    return compute


def _compute(number: int, cell: Cell, seed: int) -> tuple[int, Result]:
    """Runs in a worker, which must have the code and libraries of who asked."""
    here = fingerprint(cell.realise, cell.setting)
    if here != cell.key:
        raise InputError(
            f"this worker would compute {cell.label!r} otherwise ({here}, not {cell.key}); "
            "allowed: workers with the same iolspi_ros, numpy, scipy, numba and Python"
        )
    return number, {name: np.asarray(v) for name, v in cell.realise(cell.setting, seed).items()}
