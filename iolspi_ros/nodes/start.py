"""Where the processes of our nodes begin: a signal during the long imports is an end, too."""

from __future__ import annotations

import importlib
import os
import signal
import sys

NODES = {
    "simulator": "sim_nodes.simulator",
    "demonstrator": "iolspi_ros.nodes.demonstrator",
    "learner": "iolspi_ros.nodes.learner",
}


def start(node: str) -> int:
    """Import and run a node; until it runs, SIGINT and SIGTERM end the process with 0."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))
    return int(importlib.import_module(NODES[node]).main())


def simulator() -> int:
    """Run the simulator."""
    return start("simulator")


def demonstrator() -> int:
    """Run the demonstrator."""
    return start("demonstrator")


def learner() -> int:
    """Run the learner."""
    return start("learner")


if __name__ == "__main__":
    sys.exit(start(sys.argv.pop(1)))
