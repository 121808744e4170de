"""A learner that acts at random and counts transitions, written from docs/interfaces.md alone."""

import argparse
import json
import time
from array import array
from collections import Counter
from contextlib import suppress

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

EXPLORE, HOLD = 1, 5
PATIENCE = 2.0


def write_row(entries):
    size = len(entries)
    dimension = MultiArrayDimension(label=",".join(entries), size=size, stride=size)
    layout = MultiArrayLayout(dim=[dimension], data_offset=0)
    return Float64MultiArray(layout=layout, data=array("d", entries.values()))


def read_row(message):
    return dict(zip(message.layout.dim[0].label.split(","), message.data, strict=True))


def key_of(row):
    return int(row["episode"]), int(row["step"])


def nanoseconds(row):
    return int(row["sec"]) * 1_000_000_000 + int(row["nanosec"])


class Task:
    """What the vehicle says of itself; a state's variables are a joint's position and velocity."""

    def __init__(self, text):
        said = json.loads(text)
        self.variables = [variable["name"] for variable in said["variables"]]
        self.joint = self.variables[0].removesuffix(".position")
        assert self.variables == [f"{self.joint}.position", f"{self.joint}.velocity"]
        self.low, self.high = said["variables"][0]["low"], said["variables"][0]["high"]
        self.n_actions = len(said["actions"])
        self.neutral = said.get("neutral", 0)
        self.sampling_time = round(said["sampling_time"] * 1e9)


class Flight:
    """Pairs states with rewards, answers each key once and forms the transitions."""

    def __init__(self, task):
        self.task = task
        self.counts = Counter()
        self.states, self.rewards = {}, {}
        self.observations, self.answers = {}, {}
        self.random = np.random.default_rng(0)
        self.last_action = task.neutral
        self.last_stamp = None

    def on_state(self, message):
        stamp = message.header.stamp
        shaft = message.name.index(self.task.joint)
        state = message.position[shaft], message.velocity[shaft]
        return self.pair(self.states, state, (stamp.sec, stamp.nanosec))

    def on_reward(self, message):
        row = read_row(message)
        return self.pair(self.rewards, row, (int(row["sec"]), int(row["nanosec"])))

    def pair(self, where, what, stamp):
        """Return the answer when this was the missing half of an observation."""
        where[stamp] = what
        if stamp not in self.states or stamp not in self.rewards:
            return None
        return self.observe(self.states.pop(stamp), self.rewards.pop(stamp))

    def observe(self, state, row):
        key = key_of(row)
        if key in self.answers:
            self.counts["repeated"] += 1
            self.counts["changed"] += self.observations[key] != (state, row)
        else:
            self.observations[key] = state, row
            self.note(key, state, row)
            self.answers[key] = self.answer(state, row)
        return self.answers[key]

    def note(self, key, state, row):
        self.counts["observations"] += 1
        self.counts["outside"] += not self.task.low <= state[0] < self.task.high
        stamp = nanoseconds(row)
        if self.last_stamp is not None:
            self.counts["wrong_stamps"] += stamp - self.last_stamp != self.task.sampling_time
        self.last_stamp = stamp
        if key[1] == 0:
            self.counts["begun"] += 1
            self.counts["wrong_begins"] += (row["reward"], row["action"]) != (0.0, -1.0)
        self.form((key[0], key[1] - 1), state, row)

    def form(self, before, state, row):
        if before not in self.observations:
            return
        numbers = *self.observations[before][0], *state, row["reward"]
        if np.isfinite(numbers).all():
            self.counts["transitions"] += 1
            self.counts["not_applied"] += row["action"] != self.answers[before]["action"]

    def answer(self, state, row):
        ended = row["terminated"] or row["truncated"]
        if ended or not np.isfinite(state).all():
            source = HOLD
        else:
            source = EXPLORE
            self.last_action = int(self.random.integers(self.task.n_actions))
        self.counts["terminated"] += int(row["terminated"])
        self.counts["truncated"] += int(row["truncated"])
        head = {name: row[name] for name in ("episode", "step", "sec", "nanosec")}
        return {**head, "action": self.last_action, "source": source}


class Demonstration:
    """Keeps each sample once and knows when no more of them are to come."""

    def __init__(self, task):
        self.task = task
        self.counts = Counter()
        self.samples = {}
        self.promised = None
        self.heard = time.monotonic()

    def on_demonstration(self, message):
        row = read_row(message)
        self.heard = time.monotonic()
        self.counts["begins" if row["active"] else "ends"] += 1
        self.promised = None if row["active"] else int(row["samples"])

    def on_sample(self, message):
        row = read_row(message)
        self.heard = time.monotonic()
        key = key_of(row)
        if key in self.samples:
            self.counts["duplicates"] += 1
            return
        self.samples[key] = row
        self.counts["samples"] += 1
        self.counts["finite"] += bool(np.isfinite(list(row.values())).all())
        self.counts["sample_ends"] += bool(row["terminated"] or row["truncated"])
        self.counts["wrong_actions"] += row["action"] not in range(self.task.n_actions)
        self.check((key[0], key[1] - 1), row)

    def check(self, before, row):
        if before not in self.samples:
            self.counts["runs"] += 1
            return
        last = self.samples[before]
        names = self.task.variables
        self.counts["breaks"] += any(last[f"next.{name}"] != row[name] for name in names)
        since = nanoseconds(row) - nanoseconds(last)
        self.counts["sample_stamps"] += since != self.task.sampling_time

    @property
    def over(self):
        if self.promised is None:
            return False
        quiet = time.monotonic() - self.heard > PATIENCE
        return quiet or len(self.samples) >= self.promised


class Learner(Node):
    """The graph around a flight and a demonstration."""

    def __init__(self, episodes):
        super().__init__("stranger_learner")
        self.episodes = episodes
        self.flight = self.demonstration = None
        self.clocks = set()
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(String, "task", self.on_task, latched)

    def on_task(self, message):
        """Begin: there is a vehicle."""
        if self.flight is not None:
            return
        task = Task(message.data)
        self.flight, self.demonstration = Flight(task), Demonstration(task)
        every = QoSProfile(history=HistoryPolicy.KEEP_ALL)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.actions = self.create_publisher(Float64MultiArray, "action", 10)
        self.create_subscription(Clock, "/clock", self.on_clock, 10)
        self.create_subscription(JointState, "state", self.on_state, 10)
        self.create_subscription(Float64MultiArray, "reward", self.on_reward, 10)
        self.create_subscription(Float64MultiArray, "sample", self.demonstration.on_sample, every)
        on_demonstration = self.demonstration.on_demonstration
        self.create_subscription(Float64MultiArray, "demonstration", on_demonstration, latched)

    def on_clock(self, message):
        self.clocks.add((message.clock.sec, message.clock.nanosec))

    def on_state(self, message):
        self.send(self.flight.on_state(message))

    def on_reward(self, message):
        self.send(self.flight.on_reward(message))

    def send(self, answer):
        if answer is not None and not self.done:
            self.actions.publish(write_row(answer))

    @property
    def done(self):
        """After the episodes, once the next one shows that the last end was acknowledged."""
        if self.flight is None:
            return False
        flown = self.episodes and self.flight.counts["begun"] > self.episodes
        return bool(flown) or self.demonstration.over

    def report(self):
        flight, demonstration = self.flight.counts, self.demonstration.counts
        names = [
            "observations",
            "transitions",
            "terminated",
            "truncated",
            "repeated",
            "changed",
            "outside",
        ]
        names += ["wrong_stamps", "wrong_begins", "not_applied"]
        counts = {name: int(flight[name]) for name in names}
        names = [
            "samples",
            "duplicates",
            "finite",
            "sample_ends",
            "runs",
            "breaks",
            "sample_stamps",
        ]
        names += ["wrong_actions", "begins", "ends"]
        counts |= {name: int(demonstration[name]) for name in names}
        print(json.dumps({**counts, "clocks": len(self.clocks)}), flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=0)
    episodes = parser.parse_args(remove_ros_args()[1:]).episodes
    rclpy.init()
    try:
        node = Learner(episodes)
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
