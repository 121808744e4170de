"""`iolspi new-task`: a commented starting point for a vehicle of one's own."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.errors import InputError, check_choice

KINDS = ("python", "robot", "gymnasium")


@app.command("new-task", epilog="Example: iolspi new-task my_boat --kind python")
def new_task(
    name: Annotated[str, typer.Argument(help="Of the vehicle: letters, digits and _.")],
    kind: Annotated[
        str,
        typer.Option(
            help="python: dynamics of your own; robot: its own ROS topics; gymnasium: an "
            "environment with other limits or actions."
        ),
    ] = "python",
    out: Annotated[Path, typer.Option(help="Folder to write it to.")] = Path("."),
) -> None:
    """Write a starting point for a vehicle of your own; it works as it is."""
    from iolspi_ros import resources
    from iolspi_ros.cli.templates import TEMPLATES

    check_choice("--kind", kind, KINDS)
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(
            f"name is {name!r}; allowed: lower-case letters, digits and _, a letter first"
        )
    resources.make_folder(out)
    path = out / f"{name}{'.py' if kind == 'python' else '.yaml'}"
    cls = "".join(part.capitalize() for part in name.split("_") if part)
    text = TEMPLATES[kind].replace("@NAME@", name).replace("@CLASS@", cls)
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{path} exists already; allowed: another name, or --out") from None
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error
    where = "" if out == Path(".") else f"cd {out} && "
    then = {
        "python": f"{where}PYTHONPATH=. iolspi learn --task {name}:{cls}",
        "robot": f"iolspi run vehicle --task {path}",
        "gymnasium": f"iolspi learn --task {path}",
    }[kind]
    console.print(f"{path} is there. Try it as it is:\n    {then}\nthen make it yours.")
