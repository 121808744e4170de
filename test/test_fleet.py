"""Several vehicles and one learner, which flies all of them and learns from all."""

import pytest
from conftest import spin_until
from diagnostic_msgs.msg import DiagnosticArray

from iolspi_ros import runtime

FLEET = ["-r", "__ns:=/v1", "-p", "other_vehicles:=[/v2,/v3]"]


@pytest.fixture
def told(ros):
    """What the learner says of itself, by name; the newest."""
    node, values = ros.create_node("peer"), {}
    loop = runtime.Loop(node)

    def take(message):
        values.update({pair.key: pair.value for s in message.status for pair in s.values})

    node.create_subscription(DiagnosticArray, "/diagnostics", take, 100)
    values["wait"] = lambda ready: spin_until(loop, ready)
    return values


def start(nodes, number, *more):
    nodes.start("simulator", "-r", f"__ns:=/v{number}", "-p", f"seed:={number}", *more,
                name=f"simulator {number}")  # fmt: skip


def test_one_learner_flies_three_pendulums_and_says_who_taught_what(nodes, told):
    for number in (1, 2, 3):
        start(nodes, number, "-p", "episodes:=4")
    nodes.start("learner", *FLEET, "-p", "wait_for_demonstrations:=false")
    for number in (1, 2, 3):
        nodes.wait_for(f"simulator {number}", "done: 4 episodes")
    wait = told.pop("wait")
    wait(lambda: (told.get("samples of /v2"), told.get("samples of /v3")) == ("1200", "1200"))


def test_a_vehicle_of_another_task_is_not_flown(nodes, told):
    start(nodes, 1, "-p", "episodes:=4")
    start(nodes, 2, "-p", "task:=slung_load")
    nodes.start("learner", *FLEET, "-p", "wait_for_demonstrations:=false")
    nodes.wait_for("simulator 1", "done: 4 episodes")
    nodes.wait_for("learner", "the task of /v2 is another one")
    wait = told.pop("wait")
    wait(lambda: "updates" in told)
    assert "samples of /v2" not in told
