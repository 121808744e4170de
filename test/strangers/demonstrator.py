"""A demonstrator of made-up pendulum flights, written from docs/interfaces.md alone."""

import argparse
import json
import time
from array import array
from contextlib import suppress

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

STEPS = 100
HUMAN = 2
ZEROS = {"episode": 0, "step": 0, "sec": 0, "nanosec": 0}


def write_row(entries):
    size = len(entries)
    dimension = MultiArrayDimension(label=",".join(entries), size=size, stride=size)
    layout = MultiArrayLayout(dim=[dimension], data_offset=0)
    return Float64MultiArray(layout=layout, data=array("d", entries.values()))


def accelerate(state, volts):
    return 118.0 * np.sin(state[0]) - 1.6 * state[1] + 29.5 * volts


def move(state, volts, dt):
    rate = state[1] + dt * accelerate(state, volts)
    angle = (state[0] + dt * rate + np.pi) % (2.0 * np.pi) - np.pi
    return float(angle), float(rate)


def choose(state):
    """Balance near the upright, pump energy elsewhere."""
    if abs(state[0]) < 0.3:
        push = -(5.0 * state[0] + 0.5 * state[1])
        return 1 if abs(push) < 0.2 else 1 + int(np.sign(push))
    return 2 if state[1] >= 0.0 else 0


def head(episode, step, dt):
    tick = episode * (STEPS + 1) + step
    sec, nanosec = divmod(tick * round(dt * 1e9), 1_000_000_000)
    return {"episode": episode, "step": step, "sec": sec, "nanosec": nanosec}


def sample(task, episode, step, state, action):
    dt, names = task["sampling_time"], [variable["name"] for variable in task["variables"]]
    (volts,) = task["actions"][action]["value"]
    after = move(state, volts, dt)
    reward = -5.0 * after[0] ** 2 - 0.1 * after[1] ** 2 - volts**2
    entries = head(episode, step, dt)
    entries |= dict(zip(names, state, strict=True))
    entries |= {"action": action, "reward": reward}
    entries |= {f"next.{name}": value for name, value in zip(names, after, strict=True)}
    truncated = step == STEPS - 1
    return entries | {"terminated": 0, "truncated": truncated, "source": HUMAN}, after


def flights(task, episodes):
    for episode, angle in enumerate(np.linspace(-3.0, 3.0, episodes)):
        state = float(angle), 0.0
        for step in range(STEPS):
            row, state = sample(task, episode, step, state, choose(state))
            yield row


class Demonstrator(Node):
    """Waits for a learner, tells it everything and waits until that has been heard."""

    def __init__(self):
        super().__init__("stranger_demonstrator")
        every = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.samples = self.create_publisher(Float64MultiArray, "sample", every)
        self.signs = self.create_publisher(Float64MultiArray, "demonstration", latched)
        self.task = None
        self.create_subscription(String, "task", self.on_task, latched)

    def on_task(self, message):
        self.task = json.loads(message.data)

    @property
    def awaited(self):
        return self.task is not None and all(
            topic.get_subscription_count() for topic in (self.samples, self.signs)
        )

    def demonstrate(self, episodes):
        last, sent = ZEROS, 0
        self.signs.publish(write_row({**last, "active": 1, "samples": 0}))
        for row in flights(self.task, episodes):
            self.samples.publish(write_row(row))
            last, sent = {name: row[name] for name in ZEROS}, sent + 1
        self.signs.publish(write_row({**last, "active": 0, "samples": sent}))
        return sent

    def heard(self, seconds):
        """Block until every message was acknowledged, or the seconds are over."""
        wait = Duration(seconds=seconds)
        return self.samples.wait_for_all_acked(wait) and self.signs.wait_for_all_acked(wait)


def wait_for_learner(node, seconds):
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    deadline = time.monotonic() + seconds
    with suppress(ExternalShutdownException, KeyboardInterrupt):
        while rclpy.ok() and not node.awaited and time.monotonic() < deadline:
            executor.spin_once(timeout_sec=0.25)
    return rclpy.ok() and node.awaited


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=4)
    episodes = parser.parse_args(remove_ros_args()[1:]).episodes
    rclpy.init()
    try:
        node = Demonstrator()
        if not wait_for_learner(node, 15.0):
            return 1
        sent = node.demonstrate(episodes)
        heard = node.heard(5.0)
        print(json.dumps({"samples": sent, "heard": heard}), flush=True)
        return 0 if heard else 1
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
