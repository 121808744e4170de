"""`iolspi soak`: whether a graph that runs for long, and is harmed all the time, stays well."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.bench import table
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.folders import new_folder


@app.command(epilog="Example: iolspi soak --hours 1")
def soak(
    task: Annotated[str, typer.Option(help="A registered task, or module:Class.")] = "pendulum",
    hours: Annotated[float, typer.Option(min=0.001, help="Of vehicle time.")] = 24.0,
    seed: Annotated[int, typer.Option(min=0, help="Of all of it.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for logs.")] = Path("out/soak"),
) -> None:
    """Fly half of the time alone, and half while messages are lost and falsified and nodes killed.

    Ends with status 1 when something is not as it should be. 24 hours of the pendulum take about
    five.
    """
    from iolspi_ros import graph
    from iolspi_ros.bench import soak as soaking

    graph.isolate()
    out = new_folder(out)
    with bar("soak [steps]", soaking.total(task, hours)) as show:
        rows = soaking.measure(out, task, hours, seed, show)
    table(rows)
    console.print(f"Logs are in {out}.")
    raise typer.Exit(int(any(row.holds is False for row in rows)))
