"""`iolspi run`: start one node, as `ros2 run` does where there is a ROS installation."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from iolspi_ros.cli import app
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.start import NODES, start


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    epilog="Example: iolspi run simulator --ros-args --params-file config/pendulum.yaml",
)
def run(
    context: typer.Context,
    node: Annotated[str, typer.Argument(help=f"One of: {', '.join(NODES)}.")],
) -> None:
    """Start one node; what follows goes to it.

    Parameters come behind `--ros-args`; config/pendulum.yaml lists them, docs/interfaces.md says
    what the nodes say to each other.
    """
    if node not in NODES:
        raise InputError(f"node is {node!r}; allowed: {', '.join(NODES)}")
    if context.args and "--ros-args" not in context.args:
        raise InputError(
            f"{' '.join(context.args)} would do nothing; allowed: --ros-args, then -p "
            "NAME:=VALUE or --params-file FILE (config/pendulum.yaml lists the parameters)"
        )
    sys.argv = [node, *context.args]
    raise SystemExit(start(node))
