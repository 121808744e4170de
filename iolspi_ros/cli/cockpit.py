"""`iolspi cockpit`: fly a vehicle in the browser, and let a learner go on from there."""

from __future__ import annotations

import re
import signal
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.cli.selecting import CONFIG
from iolspi_ros.errors import InputError, check_range
from iolspi_ros.folders import new_folder

if TYPE_CHECKING:
    from iolspi_ros.graph import Graph

PATIENCE = 60.0
"""Seconds for the cockpit to say where it is; a busy machine takes a while to load the page."""


@app.command(epilog="Example: iolspi cockpit --task slung_load --speed 0.5")
def cockpit(
    task: Annotated[str, typer.Option(help="A registered task, or module:Class.")] = "pendulum",
    out: Annotated[
        Path,
        typer.Option(help="A new folder for all that is left; out/cockpit gets numbered ones."),
    ] = Path("out/cockpit"),
    speed: Annotated[
        float, typer.Option(help="Vehicle seconds per second at first, 0.1 to 1.")
    ] = 0.2,
    seed: Annotated[int, typer.Option(min=0, help="Of the vehicle and the learner.")] = 0,
    host: Annotated[
        str,
        typer.Option(
            help="Address to serve on; other than this machine's own needs a token in the "
            "environment variable IOLSPI_COCKPIT_TOKEN."
        ),
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to serve on; 0 for a free one.")] = 0,
    config: Annotated[Optional[Path], typer.Option(help=CONFIG)] = None,
) -> None:
    """Fly a vehicle in the browser, keep what went well, and let the learner take over.

    Starts simulator, demonstrator, learner and the page, and prints the page's address. Ctrl-C
    ends and saves all: the bag of what was kept, and the learner's checkpoint.
    """
    from iolspi_ros import graph, resources
    from iolspi_ros.experiments.headless import make_vehicle

    check_range("--speed", speed, 0.1, 1.0)
    file = config or resources.config(task)
    n_actions = make_vehicle(task, file).description.n_actions
    domain = graph.isolate()
    out = new_folder(out)
    bag, checkpoint = out.resolve() / "demonstration", out.resolve() / "checkpoint.npz"
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    with graph.Graph(out) as nodes:
        address = start_cockpit(nodes, out, host, port)
        nodes.start("learner", {
            "seed": seed, "checkpoint": str(checkpoint), "wait_for_demonstrations": True,
            "background": True, "vehicle_timeout": 0.0,
        }, file)  # fmt: skip
        nodes.start("demonstrator", {**from_page(n_actions), "record": str(bag)}, file)
        nodes.start("simulator", {
            "task": task, "mode": "realtime", "real_time_factor": speed, "seed": seed,
            "order": "sweep",
        }, file)  # fmt: skip
        console.print(
            f"Open [bold]{address}[/bold] and take the stick. Ctrl-C ends and saves.\n"
            f"The graph is in ROS_DOMAIN_ID={domain}; what is left of it will be in {out}."
        )
        while not stop.wait(0.2):
            nodes.check()
    for path, what in ((bag, "What you flew"), (checkpoint, "What was learned")):
        if path.exists():
            console.print(f"{what} is in {out / path.name}")


def from_page(n_actions: int) -> dict[str, Any]:
    """Parameters of a demonstrator whose stick is the page: see `joy` in docs/interfaces.md."""
    return {
        "source": "joy", "review": True, "joy_axis": 0, "joy_buttons": list(range(n_actions)),
        "takeover_button": n_actions, "vehicle_timeout": 0.0,
    }  # fmt: skip


def start_cockpit(nodes: Graph, folder: Path, host: str = "127.0.0.1", port: int = 0) -> str:
    """Start the cockpit among the nodes of a graph, whose logs are in `folder`; its address.

    Raises
    ------
    InputError
        When it ends or does not say where it is.
    """
    log = folder / "cockpit.log"
    nodes.start("cockpit", {"host": host, "port": port})
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if found := re.search(r"^cockpit: open (\S+)$", log.read_text(), re.MULTILINE):
            return found[1]
        nodes.check()
        time.sleep(0.05)
    raise InputError(f"the cockpit did not begin within {PATIENCE:g} s; its words are in {log}")
