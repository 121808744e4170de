"""What every node says of itself on /diagnostics: company, rates, silence, memory."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from iolspi_ros import qos, runtime

PERIOD = 1.0
"""Seconds between two reports."""
SILENCE = 2.0
"""Seconds without a word after which somebody is silent."""
LEVELS = (DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR)
_PAGE = os.sysconf("SC_PAGE_SIZE")


class Report:
    """What one report says; the worst of it gives the level.

    Attributes
    ----------
    values : dict of str to object
    """

    def __init__(self, text: str) -> None:
        self._texts, self._level = [text], DiagnosticStatus.OK
        self.values: dict[str, object] = {"phase": text}

    def worry(self, text: str, level: bytes = DiagnosticStatus.WARN) -> None:
        """Add what is wrong, unless it is nothing."""
        if text:
            self._texts.append(text)
            self._level = max(self._level, level)

    def message(self, node: Node, what: str) -> DiagnosticArray:
        """As it is sent."""
        text = "; ".join(self._texts)
        return diagnostics(node, what, self._level, text, self.values)


def diagnostics(
    node: Node, what: str, level: bytes, text: str, values: dict[str, object]
) -> DiagnosticArray:
    """One status of a node.

    Parameters
    ----------
    node : rclpy.node.Node
    what : str
        What of it, as in "learner: learning".
    level : bytes
        Of DiagnosticStatus.
    text : str
    values : dict
    """
    message = DiagnosticArray()
    message.header.stamp = node.get_clock().now().to_msg()
    pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    name = node.get_fully_qualified_name()[1:]
    message.status = [
        DiagnosticStatus(
            level=level, name=f"{name}: {what}", message=text, hardware_id=name, values=pairs
        )
    ]
    return message


class Vitals:
    """Reports once a second how a node is.

    Parameters
    ----------
    node : rclpy.node.Node
    what : str
        What it does, as in "learning".
    sole : sequence of str
        Topics on which only one may publish, this node or another.
    report : callable
        Makes a report, to which what every node says is added.
    """

    def __init__(
        self, node: Node, what: str, sole: Sequence[str], report: Callable[[], Report]
    ) -> None:
        self._node, self._what, self._report = node, what, report
        self._sole = [node.resolve_topic_name(topic) for topic in sole]
        self._said = ""
        self._out = node.create_publisher(DiagnosticArray, "/diagnostics", qos.OUTGOING)
        self._timer = runtime.wall_timer(node, PERIOD, self._send)

    def _send(self) -> None:
        report = self._report()
        crowd = self.crowd()
        report.worry(crowd)
        if crowd != self._said:
            self._said = crowd
            if crowd:
                self._node.get_logger().warning(crowd)
        report.values |= {"memory [MB]": round(memory() / 1e6, 1), "open files": open_files()}
        self._out.publish(report.message(self._node, self._what))

    def crowd(self) -> str:
        """Who publishes where only one may, in words; empty for nobody."""
        found = []
        with suppress(runtime.RCLError):
            for topic in self._sole:
                others = self._node.get_publishers_info_by_topic(topic)
                if len(others) > 1:
                    names = ", ".join(sorted(_name(other) for other in others))
                    found.append(f"{len(others)} publish on {topic}, where only one may: {names}")
        return "; ".join(found)

    def close(self) -> None:
        """Say nothing more."""
        self._node.destroy_timer(self._timer)
        runtime.destroy_publishers(self._node, self._out)


def _name(other: Any) -> str:
    return f"{other.node_namespace.rstrip('/')}/{other.node_name}"


class Pulse:
    """How often something comes, and how long it has not.

    Attributes
    ----------
    lost : int
        Steps left out.
    """

    def __init__(self) -> None:
        self.lost = 0
        self.late = 0
        self._count, self._since = 0, time.monotonic()
        self._last = 0.0

    def beat(self, expected: float = 0.0) -> None:
        """It came; late when it was expected every so many seconds and took half as long again."""
        now = time.monotonic()
        if expected and self._last and now - self._last > 1.5 * expected:
            self.late += 1
        self._count, self._last = self._count + 1, now

    @property
    def silence(self) -> float:
        """Seconds since the last; 0 before the first."""
        return time.monotonic() - self._last if self._last else 0.0

    def rate(self) -> float:
        """How often a second since this was asked last."""
        now = time.monotonic()
        count, since = self._count, self._since
        self._count, self._since = 0, now
        return count / max(now - since, 1e-6)


def memory() -> int:
    """Bytes of this process in memory."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * _PAGE
    except (OSError, IndexError, ValueError):
        return 0


def open_files() -> int:
    """Open file descriptors of this process."""
    try:
        return len(os.listdir("/proc/self/fd"))
    except OSError:
        return 0
