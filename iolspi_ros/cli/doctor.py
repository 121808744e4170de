"""`iolspi doctor`: what of this machine and environment is in the way, and what to do."""

from __future__ import annotations

from typing import Annotated

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console

MARKS = {"ok": "[green]ok[/green]", "note": "[yellow]note[/yellow]", "bad": "[red]bad[/red]"}


@app.command(epilog="Example: iolspi doctor --offline")
def doctor(
    offline: Annotated[
        bool, typer.Option("--offline", help="Leave out what starts two nodes to hear each other.")
    ] = False,
) -> None:
    """Check the installation, the middleware, the clock, memory and disk; status 1 for trouble."""
    from iolspi_ros.cli import checkup

    worst = 0
    for finding in checkup.look(discovery=not offline):
        console.print(f"{MARKS[finding.level]:<22} {finding.what}: {finding.found}")
        if finding.cure:
            console.print(f"       {finding.cure}")
        worst = max(worst, finding.level == "bad")
    raise typer.Exit(worst)
