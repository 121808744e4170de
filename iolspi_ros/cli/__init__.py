"""The `iolspi` command."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from iolspi_ros import __version__
from iolspi_ros.environment import no_ros
from iolspi_ros.errors import InputError
from iolspi_ros.process import prepare

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


def main() -> int:
    """Run the command; bad input is said in one line, with status 2."""
    prepare()
    from iolspi_ros.cli import (  # noqa: F401  they add themselves
        bench,
        demo,
        demos,
        doctor,
        fly,
        learn,
        new_task,
        record,
        reproduce,
        run,
        sitl,
        up,
    )

    try:
        app()
    except InputError as error:
        print(f"iolspi: {error}", file=sys.stderr)
        return 2
    except ImportError as error:
        if (said := no_ros(error)) is None:
            raise
        print(f"iolspi: {said}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("iolspi: interrupted", file=sys.stderr)
        return 130
    return 0
