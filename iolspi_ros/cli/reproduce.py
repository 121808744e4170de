"""`iolspi reproduce`: the thesis' figures, tables and claims, computed again."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.errors import InputError, check_choice

if TYPE_CHECKING:
    from iolspi_ros.experiments.engine import Backend
    from iolspi_ros.experiments.results import Store
    from iolspi_ros.experiments.thesis.study import Study

QUICK_REALISATIONS = 5


@app.command(epilog="Example: iolspi reproduce fig4 table9-1 --quick")
def reproduce(
    names: Annotated[
        Optional[list[str]], typer.Argument(help="Figures and tables; see --list.")
    ] = None,
    everything: Annotated[bool, typer.Option("--all", help="All of them.")] = False,
    listing: Annotated[bool, typer.Option("--list", help="Say which there are.")] = False,
    quick: Annotated[
        bool, typer.Option(help="5 realisations of shorter runs: a first look.")
    ] = False,
    realisations: Annotated[
        Optional[int], typer.Option(min=2, help="At most so many of each setting.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for results; what is there already is not recomputed.")
    ] = Path("out/reproduce"),
    backend: Annotated[str, typer.Option(help="local, or dask: a cluster.")] = "local",
    scheduler: Annotated[str, typer.Option(help="Address of the Dask scheduler.")] = "",
    processes: Annotated[int, typer.Option(help="Of backend local; -1 for all cores.")] = -1,
) -> None:
    """Compute figures, tables and claims of the thesis again, and say which hold.

    OUT/data keeps every realisation, so that a call that was interrupted goes on where it
    stopped; OUT/thesis has the numbers as CSV and the figures; OUT/thesis.md shows them.
    """
    from iolspi_ros.experiments import engine
    from iolspi_ros.experiments.results import Store
    from iolspi_ros.experiments.thesis import catalogue, page
    from iolspi_ros.experiments.thesis.study import write_rows

    known = catalogue.studies()
    if listing:
        for study in known.values():
            console.print(f"{study.name:<12} {study.title}  (T {study.where})")
        return
    if bool(names) == everything:
        raise InputError("say which figures and tables, or --all; `--list` names them")
    check_choice("--backend", backend, ("local", "dask"))
    if quick and realisations is None:
        realisations = QUICK_REALISATIONS
    studies = [s.thinned(realisations, quick) for s in catalogue.chosen(names or list(known))]
    folder = out / "thesis"
    store = Store(out / "data", console.print)
    _compute(studies, store, _backend(backend, scheduler, processes))
    claims = []
    with bar("tables and figures", len(studies)) as show:
        for number, study in enumerate(studies, 1):
            claims += page.save(study, engine.gather(study.cells, store), folder)
            show(number)
    write_rows(folder / page.CLAIMS, claims, page.CLAIM_COLUMNS)
    written = page.write(studies, folder)
    for row in claims:
        console.print(f"{row['study']}: {row['claim']}: [bold]{row['verdict']}[/bold]")
    counts = Counter(row["verdict"] for row in claims)
    console.print(", ".join(f"{n} {verdict}" for verdict, n in counts.items()) or "no claims")
    console.print(f"Look at [bold]{written}[/bold]")


def _backend(name: str, scheduler: str, processes: int) -> Backend:
    from iolspi_ros.experiments import engine

    if (name == "dask") != bool(scheduler):
        raise InputError("--backend dask and --scheduler ADDRESS go together")
    return engine.cluster(scheduler) if scheduler else engine.local(processes)


def _compute(studies: list[Study], store: Store, backend: Backend) -> None:
    """Compute what the store lacks."""
    from iolspi_ros.experiments import engine

    lacking = engine.missing((cell for study in studies for cell in study.cells), store)
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
