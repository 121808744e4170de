"""From the button of a stick to the first action of a person that the vehicle applies, at 200 Hz.

usage: .venv/bin/python benchmarks/takeover.py [TAKEOVERS]

The pendulum in real time, a learner flying and learning, a demonstrator that stands by, each a
process. This one says where a stick is 50 times a second, and presses and lets go at random
moments. What is measured ends when a reward arrives here that says that a person's action was
applied: by the wall clock, and in states that the vehicle showed in between.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros import graph, resources
from iolspi_ros.process import prepare

PERIOD, REPEAT = 0.005, 0.02


def main() -> None:
    """Measure, and print a table."""
    takeovers = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    prepare()
    graph.isolate()
    import rclpy

    folder, file = Path(tempfile.mkdtemp()), resources.config("pendulum")
    rclpy.init()
    stick = Stick(rclpy.create_node("stick"))
    with graph.Graph(folder) as nodes:
        nodes.start("simulator", {"mode": "realtime"}, file)
        nodes.start(
            "demonstrator", {"source": "scripted", "episodes": 1, "takeover_button": 0}, file
        )
        nodes.start("learner", {"background": True}, file)
        stick.until(lambda: stick.learner_flies)
        found = np.array([stick.take_over() for _ in range(takeovers)])
    wall, steps = 1000 * found[:, 0], found[:, 1]
    p50, p90, p99, most = np.percentile(wall, [50, 90, 99, 100])
    goal = 2000 * PERIOD
    print(f"to the action applied: p50 {p50:.1f}, p90 {p90:.1f}, p99 {p99:.1f}, most {most:.1f} ms")
    print(f"later than two sample periods ({goal:g} ms): {(wall > goal).sum()} of {takeovers}")
    print(f"in states of the vehicle: median {np.median(steps):g}, most {steps.max():g}")
    print(f"load {os.getloadavg()}")
    rclpy.try_shutdown()


class Stick:
    """A person's stick, and what they see."""

    def __init__(self, node: Any) -> None:
        from sensor_msgs.msg import Joy
        from std_msgs.msg import Float64MultiArray

        from iolspi_ros import qos, runtime, wire

        self._loop, self._rows, self._joy = runtime.Loop(node), wire.RewardRows(), Joy
        self._out = node.create_publisher(Joy, "joy", qos.CONTROL)
        self._timer = runtime.wall_timer(node, REPEAT, self.say)
        self._rng = np.random.default_rng(0)
        self._button, self.source, self.count, self.since = 0, -1, 0, 0.0
        node.create_subscription(Float64MultiArray, "reward", self._see, qos.CONTROL, raw=True)

    def say(self) -> None:
        """Where it is."""
        self._out.publish(self._joy(axes=[0.0], buttons=[self._button]))

    def _see(self, message: bytes) -> None:
        self.count += 1
        source = int(self._rows.read(message)[8])
        if source >= 0 and source != self.source:
            self.source, self.since = source, time.monotonic()

    @property
    def learner_flies(self) -> bool:
        """Whether it does."""
        return self.source in (0, 1)

    def until(self, ready: Callable[[], bool], seconds: float = 60.0) -> None:
        """Listen until something holds."""
        end = time.monotonic() + seconds
        while not ready():
            if time.monotonic() > end:
                raise SystemExit("what was waited for did not happen")
            self._loop.once(0.02)

    def take_over(self) -> tuple[float, int]:
        """Press at a random moment and let go; seconds and states until it was applied."""
        from iolspi_ros.core.learner import Source

        self._wait(0.2, 0.7)
        pressed, before = time.monotonic(), self.count
        self._press(1)
        self.until(lambda: self.source == Source.HUMAN)
        took, states = self.since - pressed, self.count - before
        self._wait(0.05, 0.3)
        self._press(0)
        self.until(lambda: self.learner_flies)
        return took, states

    def _press(self, button: int) -> None:
        self._button = button
        self.say()

    def _wait(self, least: float, most: float) -> None:
        over = time.monotonic() + self._rng.uniform(least, most)
        while time.monotonic() < over:
            self._loop.once(0.002)


if __name__ == "__main__":
    main()
