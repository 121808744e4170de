"""What commands share that compute realisations: where, and how far they are."""

from __future__ import annotations

import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import typer

from iolspi_ros.cli.progress import bar, console
from iolspi_ros.errors import InputError, check_choice

if TYPE_CHECKING:
    from iolspi_ros.experiments.cells import Cell
    from iolspi_ros.experiments.engine import Backend
    from iolspi_ros.experiments.results import Store

BACKEND = Annotated[str, typer.Option(help="local, or dask: a cluster.")]
SCHEDULER = Annotated[str, typer.Option(help="Address of the Dask scheduler.")]
PROCESSES = Annotated[int, typer.Option(help="Of backend local; -1 for all cores.")]


def backend_of(name: str, scheduler: str, processes: int) -> Backend:
    """What the options name.

    Raises
    ------
    InputError
        When they contradict each other.
    """
    from iolspi_ros.experiments import engine

    check_choice("--backend", name, ("local", "dask"))
    if (name == "dask") != bool(scheduler):
        raise InputError("--backend dask and --scheduler ADDRESS go together")
    return engine.cluster(scheduler) if scheduler else engine.local(processes)


def compute(cells: Iterable[Cell], store: Store, backend: Backend) -> None:
    """Compute what the store lacks."""
    from iolspi_ros.experiments import engine

    lacking = engine.missing(cells, store)
    if not lacking:
        return
    start = time.monotonic()
    total = max(1, round(sum(cell.cost for cell, _ in lacking)))
    try:
        with bar(f"{len(lacking)} realisations [s of a core]", total) as show:
            engine.run(lacking, store.write, backend, lambda done: show(round(done)))
    except KeyboardInterrupt:
        console.print("interrupted; what was computed is kept, and the same command goes on")
        raise
    console.print(f"{len(lacking)} realisations took {time.monotonic() - start:.0f} s")
