"""Nodes as processes of one graph: started together, and none left behind."""

from __future__ import annotations

import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml

from iolspi_ros import environment
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.start import PARENT

PATIENCE = 5.0
"""Seconds that a node has to end by itself; ours need less than two."""


DOMAINS = range(1, 102)
"""ROS domains that are chosen from: those whose ports lie below Linux' ephemeral ones."""

PARTICIPANTS = 20
"""Of a domain that are looked for."""

_OWN = ExitStack()
"""What this process keeps to its end."""


def _bound(port: int) -> socket.socket | None:
    """A socket on a UDP port; None when the port is in use."""
    found = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        found.bind(("", port))
    except OSError:
        found.close()
        return None
    return found


def _nobody_on(port: int) -> bool:
    found = _bound(port)
    if found is not None:
        found.close()
    return found is not None


@contextmanager
def own_domain() -> Iterator[int]:
    """A ROS domain in which nobody on this machine is, and which nobody else is given meanwhile.

    The ports of domain N begin at 7400 + 250 N (the DDSI-RTPS standard). Participant k listens on
    10 + 2 k from there; the first may have ended while others go on. The standard gives 9 to
    nobody: who has a domain keeps that one, because its participants come only later.

    Raises
    ------
    InputError
        All of them are in use.
    """
    domains = list(DOMAINS)
    random.SystemRandom().shuffle(domains)
    for domain in domains:
        begin = 7400 + 250 * domain
        if (claim := _bound(begin + 9)) is None:
            continue
        with claim:
            if all(_nobody_on(begin + 10 + 2 * k) for k in range(PARTICIPANTS)):
                yield domain
                return
    raise InputError("every ROS domain from 1 to 101 is in use on this machine; allowed: set one")


def isolate() -> int:
    """Keep this process and its children to this machine and to a domain of their own.

    What the user has set stays. Call before rclpy starts.

    Returns
    -------
    int
        The ROS domain, for whoever wants to look on.
    """
    environment.check()
    os.environ.setdefault(environment.RANGE, "LOCALHOST")
    if "ROS_DOMAIN_ID" not in os.environ:
        os.environ["ROS_DOMAIN_ID"] = str(_OWN.enter_context(own_domain()))
    os.environ.setdefault("HOME", tempfile.gettempdir())  # rcl writes its logs there
    return int(os.environ["ROS_DOMAIN_ID"])


class Graph:
    """Some nodes, each in a process of its own.

    Parameters
    ----------
    folder : Path
        Where each node's output goes, as NAME.log.
    environment : mapping of str to str
        Variables that the nodes have otherwise than this process.
    """

    def __init__(self, folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self._folder, self._environment = folder, dict(environment or {})
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._commands: dict[str, tuple[str, tuple[str, ...]]] = {}

    def __enter__(self) -> Graph:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)  # one Ctrl-C may come twice
        try:
            self.stop()
        finally:
            signal.signal(signal.SIGINT, before)

    def start(
        self,
        node: str,
        parameters: Mapping[str, Any],
        file: Path | None = None,
        *,
        namespace: str = "",
        name: str = "",
    ) -> None:
        """Start a node with a parameter file and parameters before it; its log is called `name`."""
        arguments = ["--ros-args", *(["-r", f"__ns:={namespace}"] if namespace else [])]
        if file is not None:
            arguments += ["--params-file", str(file)]
        for key, value in parameters.items():
            text = yaml.safe_dump(value, default_flow_style=True).splitlines()[0]
            arguments += ["-p", f"{key}:={text}"]
        self.run(name or node, "iolspi_ros.nodes.start", node, *arguments)

    def run(self, name: str, module: str, *arguments: str) -> None:
        """Start a Python module that ends with its parent, as our nodes do; `name` is its log's."""
        self._commands[name] = (module, arguments)
        with (self._folder / f"{name}.log").open("ab") as log:
            # A session of its own: a Ctrl-C reaches us alone, and we end the nodes in order.
            self._processes[name] = subprocess.Popen(
                [sys.executable, "-P", "-m", module, *arguments],
                stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                env=os.environ | self._environment | {PARENT: str(os.getpid())},
            )  # fmt: skip

    def check(self) -> None:
        """Raise when a node has ended by itself.

        Raises
        ------
        InputError
            With the last thing that it said.
        """
        for node, process in self._processes.items():
            if process.poll() is not None:
                log = self._folder / f"{node}.log"
                lines = log.read_text(errors="replace").strip().splitlines() or ["it said nothing"]
                raise InputError(f"{node} ended (status {process.returncode}): {lines[-1]}")

    def ended(self) -> dict[str, int]:
        """Exit status of each node that has ended by itself."""
        found = {name: process.poll() for name, process in self._processes.items()}
        return {name: status for name, status in found.items() if status is not None}

    def kill(self, name: str) -> None:
        """End a node as the machine would end it, without a word."""
        self._processes[name].kill()
        self._processes[name].wait()

    def limit_files(self, name: str, size: int | None) -> None:
        """Let a node write no byte beyond so many of any file, as a full disk; None: as before."""
        most = resource.RLIM_INFINITY if size is None else size
        pid = self._processes[name].pid
        _, hard = resource.prlimit(pid, resource.RLIMIT_FSIZE)
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (most, hard))

    def end(self, name: str, patience: float = PATIENCE) -> None:
        """End one node before the others, if it is there; kill it when it does not listen."""
        process = self._processes.pop(name, None)
        if process is None:
            return
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.wait(patience)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def restart(self, name: str) -> None:
        """Start a node that has ended again, as it was started; its log goes on."""
        module, arguments = self._commands[name]
        self.run(name, module, *arguments)

    def stop(self) -> None:
        """End all nodes; kill what does not listen."""
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + PATIENCE
        for process in self._processes.values():
            try:
                process.wait(max(deadline - time.monotonic(), 0.01))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        self._processes.clear()
