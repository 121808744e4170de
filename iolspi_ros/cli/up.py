"""`iolspi up`: start a graph, watch it, and start again what ends."""

from __future__ import annotations

import signal
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.folders import new_folder

if TYPE_CHECKING:
    from iolspi_ros.graph import Graph

FIRST, LONGEST = 1.0, 30.0
"""Seconds before a node is started again: at first, and after it has ended again and again."""
STEADY = 60.0
"""Seconds that a node must live to be trusted again."""


@app.command(epilog="Example: iolspi up --task pendulum --demos demos/pendulum/set_5 --out out/up")
def up(
    out: Annotated[Path, typer.Option(help="A new folder for logs and checkpoints.")],
    task: Annotated[str, typer.Option(help="A registered task, or module:Class.")] = "pendulum",
    demos: Annotated[Optional[Path], typer.Option(help="Bag to learn from first.")] = None,
    mode: Annotated[str, typer.Option(help="realtime or lockstep.")] = "realtime",
    seed: Annotated[int, typer.Option(min=0, help="Of the vehicle and the learner.")] = 0,
) -> None:
    """Run simulator and learner until told to stop; what ends is started again.

    The learner goes on from its newest checkpoint. Where there is `ros2 launch`, that does it, too.
    """
    from iolspi_ros import environment, graph, resources
    from iolspi_ros.errors import check_choice

    check_choice("--mode", mode, ("realtime", "lockstep"))
    environment.check()
    kept = environment.keep_to_this_machine()
    out, file = new_folder(out), resources.config(task)
    learner: dict[str, Any] = {
        "seed": seed, "resume": True, "checkpoint": str(out.resolve() / "checkpoint.npz"),
        "wait_for_demonstrations": demos is not None, "background": mode == "realtime",
    }  # fmt: skip
    console.print(
        f"Logs are in {out}{'; heard on this machine only' if kept else ''}. Ctrl-C ends."
    )
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: stop.set())
    with graph.Graph(out) as nodes:
        nodes.start("simulator", {"task": task, "mode": mode, "seed": seed}, file)
        nodes.start("learner", learner, file)
        if demos is not None:
            bags = {"bags": [str(demos.resolve())], "learner_timeout": 60.0}
            nodes.start("demonstrator", bags, file)
        watch(nodes, stop)


def watch(nodes: Graph, stop: threading.Event) -> None:
    """Start again what ends, later and later, until told to stop."""
    begun: dict[str, float] = {}
    pauses: dict[str, float] = {}
    due: dict[str, float] = {}
    while not stop.wait(0.2):
        now = time.monotonic()
        for name, status in nodes.ended().items():
            if name not in due:
                steady = now - begun.get(name, 0.0) > STEADY
                pauses[name] = FIRST if steady else min(2 * pauses.get(name, FIRST), LONGEST)
                due[name] = now + pauses[name]
                console.print(
                    f"{name} ended (status {status}); it starts again in {pauses[name]:g} s"
                )
            elif now >= due[name]:
                del due[name]
                begun[name] = now
                nodes.restart(name)
