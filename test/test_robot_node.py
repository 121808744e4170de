"""The vehicle node with a robot of plain rclpy: from its file alone to a policy, and bad cases."""

import json
import re
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from conftest import DEADLINE, spin_until
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String

from iolspi_ros import bags, qos, runtime, wire
from iolspi_ros.task import load

ROOT = Path(__file__).parent.parent
EXAMPLE = ROOT / "examples" / "robot"
FAST = ["-p", "use_sim_time:=true"]


@pytest.fixture
def example(nodes):
    """Start a file of the example in the nodes' domain."""

    def start(name, *arguments):
        log = (nodes.folder / f"{name}.log").open("wb")
        command = [sys.executable, str(EXAMPLE / f"{name}.py"), *map(str, arguments)]
        nodes.processes[name] = subprocess.Popen(command, stdout=log, stderr=log, env=nodes.env)

    return start


@pytest.fixture
def node(ros):
    made = ros.create_node("peer")
    loop = runtime.Loop(made)
    made.wait = lambda ready, deadline=DEADLINE: spin_until(loop, ready, deadline)
    return made


def rows(node, topic):
    heard = []

    def take(message):
        heard.append(dict(zip(message.layout.dim[0].label.split(","), message.data, strict=True)))

    node.create_subscription(Float64MultiArray, topic, take, qos.RECORDING)
    return heard


def heard(node, kind, topic, profile=10):
    got = []
    node.create_subscription(kind, topic, got.append, profile)
    return got


def start_vehicle(nodes, path=EXAMPLE / "park.yaml", *more):
    return nodes.start("vehicle", "-p", f"task:={path}", *more)


def test_it_says_its_task_and_publishes_rows_and_the_robot_moves(nodes, node, example):
    example("robot", "--speed", 10)
    start_vehicle(nodes, EXAMPLE / "park.yaml", *FAST)
    tasks, states = heard(node, String, "task", qos.TASK), rows(node, "state")
    rewards, commands = rows(node, "reward"), heard(node, Twist, "cmd_vel")
    actions = node.create_publisher(Float64MultiArray, "action", qos.OUTGOING)
    pack = wire.Rows("action", wire.ACTION)

    def answer():
        if states:
            last = states[-1]
            key = (last["episode"], last["step"], last["sec"], last["nanosec"])
            actions.publish(pack.message(*key, 1, 0))
        return len(states) > 20

    node.wait(answer)
    assert load(tasks[0].data, "task").name == "park"
    applied = [r["action"] for r in rewards if r["step"] > 0]
    assert applied.count(1.0) > len(applied) / 2
    assert any(c.linear.x == 0.5 for c in commands)
    assert any(
        a["episode"] == b["episode"] and b["step"] == a["step"] + 1 for a, b in pairwise(states)
    )


def test_a_signal_leaves_the_robot_standing(nodes, node, example):
    example("robot")
    commands = heard(node, Twist, "cmd_vel")
    start_vehicle(nodes)
    node.wait(lambda: commands)
    assert nodes.end("vehicle", signal.SIGINT) == 0
    node.wait(lambda: commands and commands[-1] == Twist())


def test_a_topic_of_another_type_ends_it_with_both_types(nodes, node):
    node.create_publisher(Float64, "odom", 10)
    status, said = nodes.finish("vehicle", "-p", f"task:={EXAMPLE / 'park.yaml'}")
    assert status == 2
    assert re.search(r"/odom is published by (peer|a node) as std_msgs/msg/Float64", said)
    assert "nav_msgs/msg/Odometry is listened for" in said


def test_a_quality_of_service_that_cannot_be_heard_is_named_as_that(nodes, node, tmp_path):
    text = (EXAMPLE / "park.yaml").read_text()
    path = tmp_path / "park.yaml"
    for old in ("field: pose.pose.position.x}", "field: pose.pose.position.y}",
                "yaw: pose.pose.orientation}"):  # fmt: skip
        text = text.replace(old, old[:-1] + ", qos: reliable}")
    path.write_text(text)
    from rclpy.qos import qos_profile_sensor_data

    node.create_publisher(Odometry, "odom", qos_profile_sensor_data)
    status, said = nodes.finish("vehicle", "-p", f"task:={path}")
    assert status == 2
    assert "cannot be heard: its quality of service does not suit" in said
    assert "RELIABLE" in said.upper()


@pytest.mark.parametrize("volatile", [True, False])
def test_a_vehicle_that_others_cannot_hear_is_told_so(nodes, node, volatile):
    from rclpy.qos import qos_profile_sensor_data

    if volatile:
        node.create_publisher(String, "task", 10)
    else:
        from sim_nodes.tasks.pendulum import Pendulum

        said = node.create_publisher(String, "task", qos.LATCHED)
        said.publish(wire.task_message(Pendulum.description))
        node.create_publisher(JointState, "state", qos_profile_sensor_data)
    status, said = nodes.finish(
        "learner", "-p", "vehicle_timeout:=6.0", "-p", "wait_for_demonstrations:=false"
    )
    assert status == 2
    topic = "/task" if volatile else "/state"
    assert f"topic {topic} of peer cannot be heard: its quality of service" in said


@pytest.mark.parametrize(
    ("task", "says"),
    [
        ("", "parameter task is empty"),
        ("nowhere.yaml", "nowhere.yaml does not exist"),
    ],
)
def test_without_a_file_it_ends_with_status_2(run_here, task, says):
    status, said = run_here("vehicle", *(["-p", f"task:={task}"] if task else []))
    assert status == 2
    assert says in said


def test_a_reward_that_cannot_be_computed_stops_it_and_diagnostics_say_so(nodes, node, tmp_path):
    from diagnostic_msgs.msg import DiagnosticArray

    path = tmp_path / "zero.yaml"
    described = {
        "name": "zero", "sampling_time": 0.05, "variables": [{"name": "x"}], "neutral": 0,
        "actions": [{"name": "rest", "value": 0.0}, {"name": "go", "value": 1.0}],
        "reward": "1 / next.x",
        "state": {"x": {"topic": "place", "type": "std_msgs/msg/Float64", "field": "data"}},
        "command": {"topic": "push", "type": "std_msgs/msg/Float64", "fields": {"data": "value"}},
    }  # fmt: skip
    path.write_text(json.dumps(described))
    start_vehicle(nodes, path)
    nodes.start("learner", "-p", "wait_for_demonstrations:=false", "-p", "low:=[-1.0]",
                "-p", "high:=[1.0]")  # fmt: skip
    place = node.create_publisher(Float64, "place", 10)
    pushed, told = heard(node, Float64, "push"), heard(node, DiagnosticArray, "/diagnostics", 100)
    node.create_timer(0.01, lambda: place.publish(Float64(data=0.0)))

    def stopped():
        return any(
            "reward (1 / next.x) cannot be computed: float division by zero" in status.message
            and status.level == b"\x02"
            for message in told
            for status in message.status
        )

    node.wait(stopped)
    del pushed[:]
    node.wait(lambda: len(pushed) > 5)
    assert {p.data for p in pushed} == {0.0}


def test_a_person_teaches_it_by_joystick_and_it_is_a_bag(nodes, example, tmp_path):
    example("robot", "--speed", 10, "--seed", 3)
    example("teacher")
    start_vehicle(nodes, EXAMPLE / "park.yaml", *FAST)
    bag = tmp_path / "parking"
    nodes.start(
        "demonstrator", "-p", "source:=joy", "-p", "joy_buttons:=[0,1,2,3,4]",
        "-p", f"record:={bag}", "-p", "episodes:=5",
    )  # fmt: skip
    nodes.wait_for("demonstrator", "demonstration ended")
    from msg_bridge.ros.description import read_robot

    task = read_robot(EXAMPLE / "park.yaml").task
    found = bags.read_demonstration(bag, task)
    assert sum(s.transition.reward == 10.0 for s in found.samples) >= 3
    assert all(s.transition.terminated for s in found.samples if s.transition.reward == 10.0)


def test_it_learns_to_park(nodes, node, example, tmp_path):
    """From its file, five episodes with a joystick, and some forty of its own."""
    test_a_person_teaches_it_by_joystick_and_it_is_a_bag(nodes, example, tmp_path)
    for name in ("demonstrator", "teacher"):
        nodes.end(name)
    rewards = rows(node, "reward")
    nodes.start("learner", "--params-file", str(EXAMPLE / "learner.yaml"))
    nodes.start("demonstrator", "-p", f"bags:=[{tmp_path / 'parking'}]", name="player")

    def parks():
        ends = [r["reward"] for r in rewards if r["terminated"] or r["truncated"]]
        return len(ends) >= 20 and ends[-10:].count(10.0) >= 9

    node.wait(parks, 150.0)
