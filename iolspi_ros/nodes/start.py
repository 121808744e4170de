"""Where the processes of our nodes begin: a signal during the long imports is an end, too."""

from __future__ import annotations

import ctypes
import faulthandler
import importlib
import os
import signal
import sys

from iolspi_ros.environment import no_ros
from iolspi_ros.leftovers import sweep
from iolspi_ros.process import prepare, say

NODES = {
    "simulator": "sim_nodes.simulator",
    "demonstrator": "iolspi_ros.nodes.demonstrator",
    "learner": "iolspi_ros.nodes.learner",
    "bridge": "msg_bridge.mavlink.node",
    "vehicle": "msg_bridge.ros.node",
    "cockpit": "msg_bridge.cockpit.node",
    "graph": "iolspi_ros.nodes.composition",
}


PARENT = "IOLSPI_PARENT"
"""Variable with the process that a node must not outlive, if there is one."""


def start(node: str) -> int:
    """Import and run a node; until it runs, a signal to end ends the process with 0."""
    faulthandler.enable()  # a crash below Python says where it was
    follow_parent()
    prepare()
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: os._exit(0))
    sweep()
    try:
        module = importlib.import_module(NODES[node])
    except ImportError as error:
        if (said := no_ros(error)) is None:
            raise
        say(f"{node}: {said}")
        return 2
    return int(module.main())


def follow_parent() -> None:
    """Ask Linux to interrupt this process when its parent is gone, killed or not."""
    parent = os.environ.get(PARENT)
    if parent is None:
        return
    ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG
    if os.getppid() != int(parent):
        sys.exit(0)  # it was gone before


def simulator() -> int:
    """Run the simulator."""
    return start("simulator")


def demonstrator() -> int:
    """Run the demonstrator."""
    return start("demonstrator")


def learner() -> int:
    """Run the learner."""
    return start("learner")


def bridge() -> int:
    """Run the bridge."""
    return start("bridge")


def vehicle() -> int:
    """Run a robot's own topics as a vehicle."""
    return start("vehicle")


def cockpit() -> int:
    """Run the cockpit."""
    return start("cockpit")


def graph() -> int:
    """Run simulator and learner in one process."""
    return start("graph")


if __name__ == "__main__":
    sys.exit(start(sys.argv.pop(1)))
