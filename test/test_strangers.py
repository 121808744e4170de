"""Nodes written from docs/interfaces.md alone take the place of each of ours."""

import json
import math
import os
import signal
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String

ROOT = Path(__file__).resolve().parents[1]
STRANGERS = ROOT / "test" / "strangers"
LEARNER = "-m", "iolspi_ros.nodes.start", "learner", "--ros-args"
SIMULATOR = "-m", "iolspi_ros.nodes.start", "simulator", "--ros-args", "-p", "mode:=lockstep"
DEMONSTRATOR = "-m", "iolspi_ros.nodes.start", "demonstrator", "--ros-args", "-p", "source:=bag"


PENDULUM = {
    "name": "pendulum",
    "variables": [
        {"name": "shaft.position", "unit": "rad", "low": -math.pi, "high": math.pi,
         "periodic": True},
        {"name": "shaft.velocity", "unit": "rad/s", "low": -47.0, "high": 47.0},
    ],
    "actions": [{"name": name} for name in ("left", "none", "right")],
    "neutral": 1,
    "sampling_time": 0.005,
    "episode_steps": 300,
}  # fmt: skip


# The first episodes may have ended before anybody is found who listens.
LATCHED = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def read_row(message):
    return dict(zip(message.layout.dim[0].label.split(","), message.data, strict=True))


class Child:
    """A process whose output goes to files."""

    def __init__(self, arguments, folder, environment):
        self.out = folder / f"{len(list(folder.iterdir()))}.out"
        self.err = self.out.with_suffix(".err")
        with self.out.open("w") as out, self.err.open("w") as err:
            self.process = subprocess.Popen(
                [sys.executable, *map(str, arguments)],
                cwd=ROOT,
                env=environment,
                stdout=out,
                stderr=err,
            )

    def __str__(self):
        return f"{self.process.args}\n{self.out.read_text()}\n{self.err.read_text()}"

    def counts(self, seconds=90.0):
        """Wait until it ends by itself and return the counts it printed."""
        try:
            code = self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            pytest.fail(f"still running: {self}")
        assert code == 0, str(self)
        return json.loads(self.out.read_text().splitlines()[-1])

    def stop(self):
        """End one of ours: it has to be running still, and to exit with 0."""
        assert self.process.poll() is None, str(self)
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(30.0) == 0, str(self)

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


class Graph:
    """Children in a domain and a namespace of their own, and a listener to what they publish."""

    def __init__(self, folder, domain):
        self.folder = folder
        self.namespace = f"/strangers_{uuid.uuid4().hex}"
        self.environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_PYTHON_CHECK_FIELDS": "1",
        }
        self.children = []
        self.heard = {}
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = Node("listener", namespace=self.namespace, context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)

    def start(self, *arguments):
        remapped = *arguments, "--ros-args", "-r", f"__ns:={self.namespace}"
        child = Child(remapped, self.folder, self.environment)
        self.children.append(child)
        return child

    def stranger(self, name, *arguments):
        return self.start(STRANGERS / f"{name}.py", *arguments)

    def listen(self, topic, kind=Float64MultiArray, profile=1000):
        messages = self.heard[topic] = []
        self.node.create_subscription(kind, topic, messages.append, profile)
        return messages

    def rows(self, topic):
        return [read_row(message) for message in self.heard[topic]]

    def wait(self, condition, what, seconds=90.0):
        deadline = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > deadline:
                pytest.fail("\n".join([f"waited in vain for {what}", *map(str, self.children)]))
            self.executor.spin_once(timeout_sec=0.1)

    def say_task(self):
        """Be a pendulum that stands still: as much of a vehicle as a replay needs."""
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.task = self.node.create_publisher(String, "task", latched)
        self.task.publish(String(data=json.dumps(PENDULUM)))

    def wait_for_publisher(self, topic):
        self.wait(lambda: self.node.count_publishers(topic) > 0, f"a publisher of {topic}")

    def close(self):
        for child in self.children:
            child.kill()
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.try_shutdown(context=self.context)


@pytest.fixture
def graph(tmp_path, monkeypatch, domain):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    made = Graph(tmp_path, domain)
    try:
        yield made
    finally:
        made.close()


def assert_none(counts, *names):
    assert {name: counts[name] for name in names} == dict.fromkeys(names, 0)


def test_learner_with_a_strange_simulator(graph):
    scores, updates = (graph.listen(topic, profile=LATCHED) for topic in ("score", "update"))
    learner = graph.start(
        *LEARNER, "-p", "wait_for_demonstrations:=false", "-p", "update_interval:=50"
    )
    counts = graph.stranger("simulator", "--episodes", "6").counts()
    graph.wait(lambda: len(scores) >= 6, "six scores")
    graph.wait(lambda: updates, "an update")
    learner.stop()
    assert_none(counts, "wrong_keys", "wrong_actions", "wrong_stamps", "changed")
    assert counts["terminated"] == counts["truncated"] == 3
    assert counts["episodes"] == counts["holds"] == 6
    assert_scores(graph.rows("score"), counts["scores"])
    assert graph.rows("update")[0]["number"] >= 1


def assert_scores(rows, expected):
    assert [row["episode"] for row in rows] == [episode for episode, _, _ in expected]
    assert [row["score"] for row in rows] == pytest.approx([score for _, score, _ in expected])
    assert [row["explored"] for row in rows] == [explored for _, _, explored in expected]


def test_simulator_with_a_strange_learner(graph):
    simulator = graph.start(*SIMULATOR, "-p", "publish_clock:=always")
    counts = graph.stranger("learner", "--episodes", "2").counts()
    simulator.stop()
    assert counts["transitions"] == 600
    assert counts["truncated"] == 2
    assert counts["clocks"] >= 602
    assert_none(counts, "terminated", "changed", "outside")
    assert_none(counts, "wrong_stamps", "wrong_begins", "not_applied")


def test_demonstrator_with_a_strange_learner(graph):
    graph.say_task()
    demonstrator = graph.start(*DEMONSTRATOR, "-p", "bags:=[demos/pendulum/set_5]")
    counts = graph.stranger("learner").counts()
    demonstrator.stop()
    assert counts["samples"] == counts["finite"] == 6300
    assert counts["sample_ends"] == counts["runs"] == 21
    assert counts["ends"] == 1
    assert_none(counts, "duplicates", "breaks", "sample_stamps", "wrong_actions")


def test_learner_and_simulator_with_a_strange_demonstrator(graph):
    states = graph.listen("state", JointState)
    actions, updates, weights = map(graph.listen, ("action", "update", "weights"))
    learner = graph.start(*LEARNER, "-p", "centers:=[11,11]")
    simulator = graph.start(*SIMULATOR)
    graph.wait_for_publisher("action")
    graph.wait(lambda: len(states) >= 5, "the first state, repeated")
    assert len({message.header.stamp.nanosec for message in states}) == 1
    assert not actions
    sent = graph.stranger("demonstrator").counts()
    graph.wait(lambda: updates and weights, "the update from the demonstration")
    graph.wait(lambda: len(keys_of(graph.rows("action"))) >= 50, "fifty answers")
    learner.stop()
    simulator.stop()
    update = graph.rows("update")[0]
    assert (update["number"], update["accepted"], update["samples"]) == (0, 1, sent["samples"])
    assert weights[0].data[0] == 0
    assert len(weights[0].data) == 1 + 3 * 11 * 11


def keys_of(rows):
    return {(row["episode"], row["step"]) for row in rows}
