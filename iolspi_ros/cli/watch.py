"""`iolspi watch`: look at a running graph in the terminal."""

from __future__ import annotations

import time
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console

PERIOD = 0.1
"""Seconds between two pictures; without a terminal there is a line for every `LINES` of them."""
LINES = 20


@app.command(epilog="Example: ROS_DOMAIN_ID=42 iolspi watch")
def watch(
    seconds: Annotated[Optional[float], typer.Option(help="How long; until Ctrl-C.")] = None,
) -> None:
    """Look at a running graph in the terminal: vehicle, who acts, scores, learner, health.

    Which graph is a matter of ROS_DOMAIN_ID, which the commands that start one print.
    """
    import rclpy
    from rich.live import Live

    from iolspi_ros import environment, runtime
    from msg_bridge.cockpit.board import Board
    from msg_bridge.cockpit.terminal import line_of, view_of
    from msg_bridge.cockpit.watching import Watching

    environment.check()
    environment.keep_to_this_machine()
    with runtime.session():
        node, board = rclpy.create_node("watch"), Board()
        watching = Watching(node, board, lambda task: None)
        loop = runtime.Loop(node)
        end = time.monotonic() + (float("inf") if seconds is None else seconds)
        try:
            if console.is_terminal:
                with Live(console=console, auto_refresh=False, transient=True) as live:
                    _every(loop, PERIOD, end, lambda: live.update(view_of(board), refresh=True))
            else:
                _every(loop, LINES * PERIOD, end, lambda: print(line_of(board), flush=True))
        finally:
            watching.close()
            node.destroy_node()


def _every(loop: Any, period: float, end: float, show: Any) -> None:
    """Handle events, and show something every so many seconds."""
    from iolspi_ros import runtime

    due = time.monotonic()
    while time.monotonic() < end and runtime.ok():
        if time.monotonic() >= due:
            show()
            due = time.monotonic() + period
        loop.once(min(period, 0.05))
