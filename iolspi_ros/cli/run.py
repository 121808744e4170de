"""`iolspi run`: start one node, as `ros2 run` does where there is a ROS installation."""

from __future__ import annotations

import sys
from typing import Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.start import NODES, start


@app.command(
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    epilog="Example: iolspi run simulator --task pendulum --ros-args -p mode:=realtime",
)
def run(
    context: typer.Context,
    node: Annotated[str, typer.Argument(help=f"One of: {', '.join(NODES)}.")],
    task: Annotated[
        Optional[str],
        typer.Option(
            help="A registered task, module:Class, gymnasium:ID or a file (of vehicle: a robot's); "
            "with parameters of config/TASK.yaml."
        ),
    ] = None,
) -> None:
    """Start one node; what follows goes to it.

    Parameters come behind `--ros-args`; config/pendulum.yaml lists them, docs/interfaces.md says
    what the nodes say to each other.
    """
    from iolspi_ros import environment, resources
    from sim_nodes.tasks import task_class

    if node not in NODES:
        raise InputError(f"node is {node!r}; allowed: {', '.join(NODES)}")
    if context.args and "--ros-args" not in context.args:
        raise InputError(
            f"{' '.join(context.args)} would do nothing; allowed: --ros-args, then -p "
            "NAME:=VALUE or --params-file FILE (config/pendulum.yaml lists the parameters)"
        )
    first: list[str] = []
    if task is not None:
        first = ["--ros-args"]
        if node != "vehicle":
            task_class(task)  # says which there are
        else:
            first += ["-p", f"vehicle:task:={task}"]
        if file := resources.config(task):
            first += ["--params-file", str(file)]
        if node in ("simulator", "graph"):
            first += ["-p", f"simulator:task:={task}"]
    if environment.keep_to_this_machine():
        print(
            f"{node}: heard on this machine only; {environment.RANGE}=SUBNET lets the network in "
            "(docs/security.md)",
            file=sys.stderr,
        )
    sys.argv = [node, *first, *context.args]
    raise SystemExit(start(node))
