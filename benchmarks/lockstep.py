"""Lockstep steps per second of simulator and learner, against bare rclpy.

In turns in one run: a bare ping-pong of the four messages (state, reward and clock one way, action
the other) between two processes on the same executor, which computes nothing; our simulator and
learner in two processes; and both composed in one. docs/benchmarks.md keeps what this prints.
"""

from __future__ import annotations

import contextlib
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from iolspi_ros import graph, resources

STEPS = 12_000
ROUNDS = 5


def messages() -> tuple[Any, Any, Any, Any]:
    """The four messages of a step, as the nodes send them."""
    import numpy as np
    from rclpy.serialization import deserialize_message
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import Float64MultiArray

    from iolspi_ros import wire
    from iolspi_ros.core.samples import Observation

    observation = Observation(0, 1, np.array([1.0, 2.0]), -3.0, 1, stamp=5_000_000)
    states = wire.JointStates(("shaft",))
    state = deserialize_message(states.of(observation), states.type)
    reward = deserialize_message(wire.RewardRows().of(observation), Float64MultiArray)
    action = wire.Rows("action", wire.ACTION).message(0, 1, 0, 5_000_000, 1, 0)
    return state, reward, Clock(), action


def play(role: str) -> None:
    """One side of the ping-pong."""
    import rclpy
    from rclpy.executors import ExternalShutdownException

    from iolspi_ros import qos, runtime

    rclpy.init()
    node, loop = rclpy.create_node(role), runtime.executor()
    loop.add_node(node)
    state, reward, clock, action = messages()
    if role == "pong":
        answer = node.create_publisher(type(action), "action", qos.OUTGOING)

        def reply(message: Any) -> None:
            action.data[1] = message.data[1]
            answer.publish(action)

        node.create_subscription(type(state), "state", lambda m: None, qos.CONTROL)
        node.create_subscription(type(reward), "reward", reply, qos.CONTROL)
        with contextlib.suppress(ExternalShutdownException):
            while rclpy.ok():
                loop.spin_once(timeout_sec=0.25)
        return
    outs = [
        (node.create_publisher(type(m), topic, qos.OUTGOING), m)
        for topic, m in (("state", state), ("reward", reward), ("/clock", clock))
    ]
    count, begin = 0, 0.0

    def send() -> None:
        reward.data[1] = count
        for out, message in outs:
            out.publish(message)

    def step(message: Any) -> None:
        nonlocal count, begin
        if message.data[1] != count:
            return  # one exchange at a time
        begin = begin or time.monotonic()
        count += 1
        send()

    node.create_subscription(type(action), "action", step, qos.CONTROL)
    while not count:
        send()
        loop.spin_once(timeout_sec=0.2)
    while count < STEPS:
        loop.spin_once(timeout_sec=0.25)
    print(count / (time.monotonic() - begin))
    rclpy.try_shutdown()


def ping_pong() -> float:
    """Steps per second of the bare exchange."""
    me = [sys.executable, __file__]
    pong = subprocess.Popen([*me, "pong"])
    try:
        result = subprocess.run([*me, "ping"], capture_output=True, text=True, check=True)
    finally:
        pong.terminate()
        pong.wait()
    return float(result.stdout)


def ours(composed: bool) -> float:
    """Steps per second of simulator and learner of config/pendulum.yaml, in one process or two."""
    config = resources.find("config", "pendulum.yaml")
    learner = {"wait_for_demonstrations": False, "vehicle_timeout": 60.0}
    simulator = {"episodes": STEPS // 300}
    with tempfile.TemporaryDirectory() as folder, graph.Graph(Path(folder)) as nodes:
        if composed:
            both = {f"learner:{name}": value for name, value in learner.items()}
            both |= {f"simulator:{name}": value for name, value in simulator.items()}
            nodes.start("graph", both, config)
        else:
            nodes.start("learner", learner, config)
            nodes.start("simulator", simulator, config)
        log = Path(folder) / ("graph.log" if composed else "simulator.log")
        while not (found := re.search(r"([\d.]+) steps/s", log.read_text())):
            nodes.check()
            time.sleep(0.2)
        return float(found[1])


def slung_load(episodes: int = 1000) -> str:
    """What the simulator says of so many episodes with the learner of config/slung_load.yaml."""
    config = resources.find("config", "slung_load.yaml")
    bag = resources.find("demos", "slung_load", "set_5")
    with tempfile.TemporaryDirectory() as folder, graph.Graph(Path(folder)) as nodes:
        nodes.start("simulator", {"episodes": episodes}, config)
        nodes.start("learner", {"vehicle_timeout": 60.0}, config)
        nodes.start("demonstrator", {"bags": [str(bag)]}, config)
        log = Path(folder) / "simulator.log"
        while not (found := re.search(r"done: (.*)", log.read_text())):
            nodes.check()
            time.sleep(0.2)
        return found[1]


def main() -> None:
    """Measure in turns, and print medians and their ratio; then the slung load."""
    print(f"domain {graph.isolate()}, {os.cpu_count()} cores, {STEPS} steps a run")
    rounds = [(ping_pong(), ours(composed=False), ours(composed=True)) for _ in range(ROUNDS)]
    for bare, two, one in rounds:
        print(f"bare {bare:.0f}, two processes {two:.0f}, composed {one:.0f} steps/s")
    for name, column in (("two processes", 1), ("composed", 2)):
        ratios = sorted(row[column] / row[0] for row in rounds)
        middle, low, high = statistics.median(ratios), ratios[0], ratios[-1]
        print(f"{name}: {middle:.2f} of bare ({low:.2f} to {high:.2f}; goal of two: 0.6)")
    print(f"slung load: {slung_load()} (goal: 1000 episodes in 60 s)")


if __name__ == "__main__":
    main() if len(sys.argv) == 1 else play(sys.argv[1])
