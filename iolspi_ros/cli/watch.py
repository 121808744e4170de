"""`iolspi watch`: look at a running graph in the terminal."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from typing import Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console

PERIOD = 0.1
"""Seconds between two pictures; without a terminal there is a line for every `LINES` of them."""
LINES = 20


STICK_PERIOD = 0.01
"""Seconds between two looks at the keyboard."""


@app.command(epilog="Example: ROS_DOMAIN_ID=42 iolspi watch")
def watch(
    seconds: Annotated[Optional[float], typer.Option(help="How long; until Ctrl-C.")] = None,
    stick: Annotated[
        bool,
        typer.Option(
            "--stick",
            help="Publish this keyboard as joy: arrows, numbers for actions, space to take over. A "
            "terminal says nothing of a key let go: a tap holds for 0.7 s, and 0 lets go at once.",
        ),
    ] = False,
) -> None:
    """Look at a running graph in the terminal: vehicle, who acts, scores, learner, health.

    Which graph is a matter of ROS_DOMAIN_ID, which the commands that start one print.
    """
    import rclpy
    from rich.live import Live

    from iolspi_ros import environment, runtime
    from msg_bridge.cockpit.board import Board
    from msg_bridge.cockpit.terminal import line_of, view_of
    from msg_bridge.cockpit.terminal_stick import TerminalStick, key_by_key
    from msg_bridge.cockpit.watching import Watching

    environment.check()
    environment.keep_to_this_machine()
    with ExitStack() as stack:
        keys = stack.enter_context(key_by_key()) if stick else -1
        stack.enter_context(runtime.session())
        node, board = rclpy.create_node("watch"), Board()
        stack.callback(node.destroy_node)
        stack.callback(Watching(node, board, lambda task: None).close)
        also, wait = (lambda: None), PERIOD / 2
        if stick:
            hands = TerminalStick(node, board, keys)
            stack.callback(hands.close)
            also, wait = hands.look, STICK_PERIOD
        loop = stack.enter_context(closing(runtime.Loop(node)))
        end = time.monotonic() + (float("inf") if seconds is None else seconds)

        def every(period: float, show: Callable[[], None]) -> None:
            due = time.monotonic()
            while time.monotonic() < end and runtime.ok():
                if time.monotonic() >= due:
                    show()
                    due = time.monotonic() + period
                loop.once(min(period, wait))
                also()

        if console.is_terminal:
            live = stack.enter_context(Live(console=console, auto_refresh=False, transient=True))
            every(PERIOD, lambda: live.update(view_of(board), refresh=True))
        else:
            every(LINES * PERIOD, lambda: print(line_of(board), flush=True))
