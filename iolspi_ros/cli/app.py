"""What every command adds itself to."""

from __future__ import annotations

from typing import Annotated

import typer

from iolspi_ros import __version__

app = typer.Typer(
    name="iolspi",
    help="Learn to control a vehicle online, starting from demonstrations.",
    epilog="Start with: iolspi demo",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)


def _version(wanted: bool) -> None:
    if wanted:
        print(f"iolspi_ros {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
) -> None:
    pass
