"""Following a graph of ours from a command: its folder, and how far it has come."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from iolspi_ros.cli.progress import bar

if TYPE_CHECKING:
    from iolspi_ros.graph import Graph
    from iolspi_ros.nodes.monitor import Monitor


class Follower:
    """Shows how far a graph has come, and ends when one of its nodes does.

    Parameters
    ----------
    nodes : Graph
    monitor : Monitor
    """

    def __init__(self, nodes: Graph, monitor: Monitor) -> None:
        self._nodes, self._monitor = nodes, monitor

    def wait(self, ready: Callable[[], bool], seconds: float, what: str) -> None:
        """Wait for something to happen within some seconds."""

        def looked() -> bool:
            self._nodes.check()
            return ready()

        self._monitor.wait(looked, seconds, what)

    def follow(self, what: str, total: int, done: Callable[[], int], seconds: float) -> None:
        """Show a number growing to its total, within some seconds."""
        with bar(what, total) as show:

            def ready() -> bool:
                show(done())
                return done() >= total

            self.wait(ready, seconds, what)
