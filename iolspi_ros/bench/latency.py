"""From an action on the topic to the setpoint on the wire, through the graph, by kernel stamps."""

from __future__ import annotations

import multiprocessing
import os
import select
import socket
import struct
import threading
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros import graph, qos, wire
from iolspi_ros.bench.flying import parameters
from iolspi_ros.bench.rows import Row, at_most
from iolspi_ros.core.learner import Source
from msg_bridge.mavlink.codec import Codec
from sim_nodes.tasks.slung_load import SlungLoad

SAMPLES = 2000
FACTOR = 2.0
"""Vehicle seconds per second."""
_STAMP = 35  # SO_TIMESTAMPNS of Linux: when the kernel took a datagram
_LONGEST = 600.0  # [s]


class Tap:
    """Stands between bridge and autopilot, and notes when which setpoint passed.

    Parameters
    ----------
    autopilot : (str, int)
        Where it listens.
    """

    def __init__(self, autopilot: tuple[str, int]) -> None:
        self._near = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._near.bind(("127.0.0.1", 0))
        self._near.setsockopt(socket.SOL_SOCKET, _STAMP, 1)
        self._far = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._far.connect(autopilot)
        self.address = self._near.getsockname()
        self.passed: list[tuple[int, float]] = []
        """Time since 1970 [ns] and acceleration to the east [m/s²]."""
        self._codec = Codec(254, 1)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Let both addresses go."""
        self._ending.set()
        self._thread.join()
        self._near.close()
        self._far.close()

    def _run(self) -> None:
        bridge: Any = None
        while not self._ending.is_set():
            readable, _, _ = select.select([self._near, self._far], [], [], 0.1)
            if self._near in readable:
                data, extra, _, bridge = self._near.recvmsg(2048, 64)
                self._far.send(data)
                self._note(data, extra)
            if self._far in readable and bridge is not None:
                self._near.sendto(self._far.recv(2048), bridge)

    def _note(self, data: bytes, extra: list[tuple[int, int, bytes]]) -> None:
        seconds, nanoseconds = struct.unpack("qq", extra[0][2])
        for message in self._codec.read(data, whole=True):
            if isinstance(message, dialect.MAVLink_set_position_target_local_ned_message):
                self.passed.append((seconds * 10**9 + nanoseconds, message.afy))


def delays(
    asked: NDArray[np.int64], passed: NDArray[np.int64], values: NDArray[np.float64], within: float
) -> NDArray[np.float64]:
    """From each action to the first setpoint that differs from those before it [s].

    Parameters
    ----------
    asked : ndarray of int, shape (n,)
        When actions were published [ns]; each differs from the one before.
    passed : ndarray of int, shape (m,)
        When setpoints passed [ns].
    values : ndarray of shape (m,)
        What they asked for.
    within : float
        What comes later than this belongs to no action [s].

    Returns
    -------
    ndarray of shape (k,)
        Of those actions that changed something in time.
    """
    found = []
    for start in asked:
        first, last = np.searchsorted(passed, [start, start + round(within * 1e9)])
        changed = np.flatnonzero(np.abs(values[first:last] - values[first - 1]) > 1e-3)
        if first and len(changed):
            found.append((passed[first + changed[0]] - start) * 1e-9)
    return np.array(found)


def rows(folder: Path, samples: int = SAMPLES) -> list[Row]:
    """Median and worst thousandth, with a learner that solves beside all the time."""
    from iolspi_ros import runtime
    from sim_nodes.autopilot.server import Sitl

    graph.isolate()
    context = multiprocessing.get_context("spawn")
    solver = context.Process(target=_solve, daemon=True)
    solver.start()
    with Sitl(
        "px4", ["udpin:127.0.0.1:0"], parameters("px4", SIM_SPEEDUP=FACTOR), ready_after=2.0
    ) as sitl:
        tap = Tap(sitl.addresses[0])
        try:
            with runtime.session():
                asked = _answer(folder, f"udpout:127.0.0.1:{tap.address[1]}", samples)
        finally:
            tap.close()
            solver.terminate()
            solver.join()
    passed, values = (np.array(part) for part in zip(*tap.passed, strict=True))
    step = SlungLoad.description.sampling_time / FACTOR
    measured = 1e3 * delays(np.array(asked), passed, values, step)
    return [
        at_most("action to wire, median", float(np.median(measured)), "ms", 1.0),
        Row("action to wire, 99.9 %", float(np.quantile(measured, 0.999)), "ms"),
        Row("action to wire, not within its step", 1.0 - len(measured) / len(asked), "share"),
    ]


def _answer(folder: Path, url: str, samples: int) -> list[int]:
    """Answer the bridge with full accelerations to and fro; when each was published [ns]."""
    import rclpy
    from std_msgs.msg import Float64MultiArray

    from iolspi_ros import runtime

    asked: list[int] = []
    rewards, actions = wire.RewardRows(), wire.Rows("action", wire.ACTION)
    node = rclpy.create_node("latency")
    out = node.create_publisher(Float64MultiArray, "action", qos.OUTGOING)

    def answer(message: Any) -> None:
        episode, step, sec, nanosec, _, terminated, truncated, _ = rewards.read(message)
        if terminated or truncated:
            return
        other = 2 * (len(asked) % 2)  # never the same twice, also when a step is left out
        reply = actions.message(episode, step, sec, nanosec, other, Source.SCRIPTED)
        asked.append(time.time_ns())
        out.publish(reply)

    node.create_subscription(Float64MultiArray, "reward", answer, qos.CONTROL)
    try:
        with closing(runtime.Loop(node)) as loop, graph.Graph(folder) as nodes:
            flight = {"url": url, "autostart": "activate", "real_time_factor": FACTOR,
                      "action_timeout": 0.3, "initial": "narrow"}  # fmt: skip
            nodes.start("bridge", flight)
            end = time.monotonic() + _LONGEST
            while len(asked) < samples and time.monotonic() < end:
                nodes.check()
                runtime.check()
                loop.once(0.1)
    finally:
        node.destroy_node()
    return asked


def _solve() -> None:
    """Learn offline from a shipped set, again and again, as long as the parent lives."""
    from iolspi_ros.bags import read_demonstration
    from iolspi_ros.experiments.headless import prepare
    from iolspi_ros.resources import find

    parent = os.getppid()
    bag = find("demos", "slung_load", "set_5")
    while os.getppid() == parent:
        world, learner, _ = prepare("slung_load", find("config", "slung_load.yaml"), 0)
        learner.pretrain(read_demonstration(bag, world.task.description).transitions())
