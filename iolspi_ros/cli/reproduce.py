"""`iolspi reproduce`: the thesis' figures, tables and claims, computed again."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.computing import BACKEND, PROCESSES, SCHEDULER, backend_of, compute
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.errors import InputError

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
    backend: BACKEND = "local",
    scheduler: SCHEDULER = "",
    processes: PROCESSES = -1,
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
    if quick and realisations is None:
        realisations = QUICK_REALISATIONS
    studies = [s.thinned(realisations, quick) for s in catalogue.chosen(names or list(known))]
    folder = out / "thesis"
    store = Store(out / "data", console.print)
    cells = (cell for study in studies for cell in study.cells)
    compute(cells, store, backend_of(backend, scheduler, processes))
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
