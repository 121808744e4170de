"""A lockstep simulator of a made-up vehicle, written from docs/interfaces.md alone."""

import argparse
import json
from array import array
from collections import Counter
from contextlib import suppress

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

SAMPLING_TIME = 0.005
NANOSECONDS = 5_000_000
TORQUE = (-20.0, 0.0, 20.0)
STEPS = 50
FIRST_EPISODE, EPISODE_STRIDE = 7, 3
EXPLORE, HOLD = 1, 5
TASK = {
    "name": "wheel",
    "variables": [
        {"name": "shaft.position", "unit": "rad", "low": -np.pi, "high": np.pi, "periodic": True},
        {"name": "shaft.velocity", "unit": "rad/s", "low": -20.0, "high": 20.0},
    ],
    "actions": [{"name": f"{torque} Nm", "value": [torque]} for torque in TORQUE],
    "neutral": 1,
    "sampling_time": SAMPLING_TIME,
    "episode_steps": STEPS,
    "gamma": 0.95,
    "endings": [{"name": "time-out"}, {"name": "upright", "success": True}],
}


def write_row(entries):
    size = len(entries)
    dimension = MultiArrayDimension(label=",".join(entries), size=size, stride=size)
    layout = MultiArrayLayout(dim=[dimension], data_offset=0)
    return Float64MultiArray(layout=layout, data=array("d", entries.values()))


def read_row(message):
    return dict(zip(message.layout.dim[0].label.split(","), message.data, strict=True))


def wrap(angle):
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


class Vehicle:
    """A double integrator; every second episode ends when it comes near the upright."""

    def __init__(self):
        self.episode = FIRST_EPISODE - EPISODE_STRIDE
        self.tick = 0
        self.number = -1
        self.begin()

    def begin(self):
        self.number += 1
        self.episode += EPISODE_STRIDE
        self.short = self.number % 2 == 1
        self.angle, self.rate = (0.6, -8.0) if self.short else (-np.pi, 0.0)
        self.step, self.reward, self.action = 0, 0.0, -1
        self.tick += 1
        self.terminated = self.truncated = False

    def move(self, action):
        self.rate += SAMPLING_TIME * TORQUE[action]
        self.angle = wrap(self.angle + SAMPLING_TIME * self.rate)
        self.step += 1
        self.tick += 1
        self.action = action
        self.reward = -5.0 * self.angle**2 - 0.1 * self.rate**2
        self.terminated = self.short and abs(self.angle) < 0.3
        self.truncated = not self.terminated and self.step == STEPS

    @property
    def ended(self):
        return self.terminated or self.truncated

    @property
    def key(self):
        return self.episode, self.step

    @property
    def stamp(self):
        return divmod(self.tick * NANOSECONDS, 1_000_000_000)


class Simulator(Node):
    """Publishes one observation, waits for its answer, and counts what it hears."""

    def __init__(self, episodes):
        super().__init__("stranger_simulator")
        self.left = episodes
        self.vehicle = Vehicle()
        self.answers = {}
        self.counts = Counter()
        self.scores = []
        self.score = 0.0
        self.explored = 0
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.task = self.create_publisher(String, "task", latched)
        self.task.publish(String(data=json.dumps(TASK)))
        self.states = self.create_publisher(JointState, "state", 10)
        self.rewards = self.create_publisher(Float64MultiArray, "reward", 10)
        self.clock_publisher = self.create_publisher(Clock, "/clock", 10)
        self.create_subscription(Float64MultiArray, "action", self.on_action, 10)
        self.timer = self.create_timer(0.05, self.publish)
        self.publish()

    @property
    def done(self):
        return self.left == 0

    def publish(self):
        if self.done:
            return
        self.timer.reset()
        sec, nanosec = self.vehicle.stamp
        stamp = Time(sec=sec, nanosec=nanosec)
        state = JointState(name=["shaft"])
        state.header.stamp = stamp
        state.position = array("d", [self.vehicle.angle])
        state.velocity = array("d", [self.vehicle.rate])
        self.clock_publisher.publish(Clock(clock=stamp))
        self.rewards.publish(self.reward_row(sec, nanosec))
        self.states.publish(state)

    def reward_row(self, sec, nanosec):
        """Everything by name: in an order of its own and with an entry nobody asked for."""
        vehicle = self.vehicle
        return write_row(
            {
                "episode": vehicle.episode,
                "step": vehicle.step,
                "sec": sec,
                "nanosec": nanosec,
                "action": vehicle.action,
                "truncated": vehicle.truncated,
                "temperature": 21.5,
                "terminated": vehicle.terminated,
                "reward": vehicle.reward,
            }
        )

    def on_action(self, message):
        answer = read_row(message)
        key = int(answer["episode"]), int(answer["step"])
        if key in self.answers:
            self.counts["repeated"] += 1
            self.counts["changed"] += self.answers[key] != answer
        elif self.done or key != self.vehicle.key:
            self.counts["wrong_keys"] += 1
        elif answer["action"] not in range(len(TORQUE)):
            self.counts["wrong_actions"] += 1
        else:
            self.accept(key, answer)

    def accept(self, key, answer):
        self.answers[key] = answer
        self.counts["answers"] += 1
        self.counts["wrong_stamps"] += (answer["sec"], answer["nanosec"]) != self.vehicle.stamp
        if self.vehicle.ended:
            self.end(answer)
        else:
            self.explored += answer["source"] == EXPLORE
            self.vehicle.move(int(answer["action"]))
            self.score += self.vehicle.reward
        self.publish()
        if self.vehicle.step % 10 == 3:
            self.publish()

    def end(self, answer):
        kind = "terminated" if self.vehicle.terminated else "truncated"
        self.counts[kind] += 1
        self.counts["episodes"] += 1
        self.counts["holds"] += answer["source"] == HOLD
        self.scores.append([self.vehicle.episode, self.score, int(self.explored)])
        self.score, self.explored = 0.0, 0
        self.left -= 1
        self.vehicle.begin()

    def report(self):
        names = ["answers", "episodes", "wrong_keys", "wrong_actions", "wrong_stamps"]
        names += ["repeated", "changed", "terminated", "truncated", "holds"]
        counts = {name: int(self.counts[name]) for name in names}
        print(json.dumps({**counts, "scores": self.scores}), flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=4)
    episodes = parser.parse_args(remove_ros_args()[1:]).episodes
    rclpy.init()
    try:
        node = Simulator(episodes)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        with suppress(ExternalShutdownException, KeyboardInterrupt):
            while rclpy.ok() and not node.done:
                executor.spin_once(timeout_sec=0.25)
        node.report()
        return 0 if node.done else 1
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    raise SystemExit(main())
