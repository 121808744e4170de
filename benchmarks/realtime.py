"""From a state to the learner's action, in real time, beside a node that does nothing but answer.

usage: .venv/bin/python benchmarks/realtime.py [MINUTES]

The pendulum at its 200 steps a second, and a learner that learns from a shipped set and goes on
while it flies. A bare rclpy node hears the same reward and publishes an array at once. All times
are those at which DDS was given a message, so what listens here is not part of them.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros import graph, resources
from iolspi_ros.process import prepare

Times = dict[tuple[int, int], int]
"""When the first message of an (episode, step) was published [ns]."""


def echo() -> None:
    """Answer each reward with its first four numbers."""
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.experimental import EventsExecutor
    from std_msgs.msg import Float64MultiArray

    from iolspi_ros import qos

    rclpy.init()
    node = rclpy.create_node("echo")
    out = node.create_publisher(Float64MultiArray, "echo", qos.OUTGOING)
    answer = Float64MultiArray()

    def reply(message: Any) -> None:
        answer.data = message.data[:4]
        out.publish(answer)

    node.create_subscription(Float64MultiArray, "reward", reply, qos.CONTROL)
    loop = EventsExecutor()
    loop.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        while rclpy.ok():
            loop.spin_once(timeout_sec=0.25)


class Ear:
    """Listens, and takes when each message was published; last for those that end an episode."""

    def __init__(self, node: Any) -> None:
        from std_msgs.msg import Float64MultiArray

        from iolspi_ros import qos

        self.times: dict[str, Times] = {}
        self.ends: set[tuple[int, int]] = set()
        self._subscriptions = {
            topic: node.create_subscription(Float64MultiArray, topic, print, qos.RECORDING)
            for topic in ("reward", "action", "echo")
        }
        self.updates = node.create_subscription(Float64MultiArray, "update", print, qos.RECORDING)
        self.n_updates = 0

    def take(self) -> None:
        """Everything that waits."""
        for topic, subscription in self._subscriptions.items():
            times = self.times.setdefault(topic, {})
            while (taken := _take(subscription)) is not None:
                message, about = taken
                key = (int(message.data[0]), int(message.data[1]))
                times.setdefault(key, about["source_timestamp"])
                if topic == "reward" and any(message.data[5:7]):
                    self.ends.add(key)
        while _take(self.updates) is not None:
            self.n_updates += 1


def _take(subscription: Any) -> Any:
    with subscription.handle:
        return subscription.handle.take_message(subscription.msg_type, False)


def delays(asked: Times, answered: Times, ends: set[tuple[int, int]]) -> np.ndarray:
    """From each state that asks for an action to the answer [s]; infinite where there was none."""
    return np.array(
        [(answered[key] - at) * 1e-9 if key in answered else np.inf
         for key, at in asked.items() if key not in ends]
    )  # fmt: skip


def memory(process: str) -> float:
    """Of the node of that name among those below this process [MB]."""
    found = subprocess.run(
        ["ps", "-ww", "--ppid", str(os.getpid()), "-o", "rss=,args="],
        capture_output=True,
        text=True,
    )
    rows = [row for row in found.stdout.splitlines() if f"start {process} " in row]
    return sum(int(row.split()[0]) for row in rows) / 1000


def main() -> None:
    """Measure, and print a table."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    prepare()
    graph.isolate()
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("ear")
    ear = Ear(node)
    file = resources.config("pendulum")
    bag = resources.find("demos", "pendulum", "set_5")
    beside = subprocess.Popen([sys.executable, __file__, "echo"])
    try:
        with tempfile.TemporaryDirectory() as folder, graph.Graph(Path(folder)) as nodes:
            nodes.start("simulator", {"mode": "realtime"}, file)
            nodes.start("learner", {"background": True, "vehicle_timeout": 0.0}, file)
            nodes.start("demonstrator", {"bags": [str(bag)]}, file)
            while not (ear.n_updates and ear.times["echo"]):
                ear.take()
                nodes.check()
                time.sleep(0.02)
            for times in ear.times.values():
                times.clear()
            before, begin, shown = memory("learner"), time.monotonic(), 0
            while (gone := time.monotonic() - begin) < 60 * minutes:
                ear.take()
                nodes.check()
                time.sleep(0.02)
                if gone > 60 * (shown + 1):
                    shown += 1
                    print(f"{shown} of {minutes:g} min, {ear.n_updates} updates", flush=True)
            time.sleep(0.1)
            ear.take()
            after = memory("learner")
    finally:
        beside.terminate()
        beside.wait()
    period = 5e-3
    last = max(ear.times["reward"])
    asked = {key: at for key, at in ear.times["reward"].items() if key != last}
    print(f"{len(asked)} states, {ear.n_updates} updates; load {os.getloadavg()}")
    for what, topic in (("learner", "action"), ("echo", "echo")):
        found = delays(asked, ear.times[topic], ear.ends)
        p50, p99, p999, most = 1e3 * np.quantile(found, [0.5, 0.99, 0.999, 1.0], method="higher")
        missed = np.mean(found > period)
        print(
            f"{what}: p50 {p50:.3f} ms, p99 {p99:.2f} ms, p99.9 {p999:.2f} ms, most {most:.1f} ms; "
            f"not within {1e3 * period:.0f} ms {100 * missed:.4f} %, never {np.isinf(found).sum()}"
        )
    print(f"learner's memory {before:.0f} MB at the beginning, {after:.0f} at the end")
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    echo() if sys.argv[1:] == ["echo"] else main()
