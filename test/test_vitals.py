"""/diagnostics of every node: company, silence, what came while flying."""

import numpy as np
import pytest
from conftest import spin_until
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.samples import Sample, Transition
from sim_nodes.tasks.pendulum import Pendulum

AT_ONCE = ["-p", "wait_for_demonstrations:=false"]


class Listener:
    def __init__(self, ros):
        self.node = ros.create_node("listener")
        self.loop = runtime.Loop(self.node)
        self.said = {}
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._hear, qos.OUTGOING)

    def _hear(self, message):
        for status in message.status:
            self.said[status.name] = status

    def until(self, name, words, level=DiagnosticStatus.WARN):
        def heard():
            status = self.said.get(name)
            return status and status.level == level and words in status.message

        try:
            spin_until(self.loop, heard)
        except AssertionError:
            raise AssertionError(f"{name} never said {words!r}; heard: {self.said}") from None
        status = self.said[name]
        assert status.hardware_id
        return {pair.key: pair.value for pair in status.values}


@pytest.fixture
def listener(ros):
    made = Listener(ros)
    yield made
    made.node.destroy_node()


def test_every_node_says_how_it_is(nodes, listener):
    nodes.start("simulator")
    nodes.start("learner", *AT_ONCE)
    nodes.start("demonstrator", "-p", "source:=joy")
    for name in ("simulator: simulating", "learner: learning", "demonstrator: demonstrating"):
        values = listener.until(name, "", DiagnosticStatus.OK)
        assert float(values["memory [MB]"]) > 10.0
        assert int(values["open files"]) > 3
    values = listener.until("learner: learning", "learning", DiagnosticStatus.OK)
    assert values["checkpoint"] == "none"
    assert "seconds since the last observation" in values


def test_a_vehicle_that_falls_silent_is_said(nodes, listener):
    nodes.start("simulator")
    nodes.start("learner", *AT_ONCE)
    listener.until("learner: learning", "learning", DiagnosticStatus.OK)
    nodes.end("simulator")
    listener.until("learner: learning", "the vehicle has been silent for 3 s")


@pytest.mark.parametrize(
    ("node", "what", "topic", "arguments"),
    [
        ("simulator", "simulating", "/state", []),
        ("learner", "learning", "/update", AT_ONCE),
        ("demonstrator", "demonstrating", "/sample", ["-p", "source:=joy"]),
    ],
)
def test_two_where_one_belongs_are_said_by_each(nodes, listener, node, what, topic, arguments):
    if node == "learner":
        nodes.start("simulator")
    nodes.start(node, *arguments)
    nodes.start(node, *arguments, "-r", "__node:=other", name="other")
    words = f"2 publish on {topic}, where only one may: /{node}, /other"
    for name in sorted((node, "other"), key=lambda name: f"/{name}"):
        text = ", ".join(sorted((f"/{node}", "/other")))
        listener.until(f"{name}: {what}", f"{topic}, where only one may: {text}")
        nodes.wait_for(name, "where only one may")
    assert words.startswith("2 publish")


def test_samples_that_come_while_flying_are_said(nodes, listener):
    nodes.start("simulator")
    nodes.start("learner", *AT_ONCE)
    nodes.wait_for("learner", "acting on")
    out = listener.node.create_publisher(Float64MultiArray, "sample", qos.SAMPLES)
    spin_until(listener.loop, out.get_subscription_count)
    t = Transition(np.zeros(2), 1, 0.0, np.zeros(2))
    out.publish(wire.SampleRows(Pendulum.description.names).of(Sample(0, 0, 0, t, 4)))
    values = listener.until("learner: learning", "1 samples came while flying")
    assert values["samples that came while flying"] == "1"
