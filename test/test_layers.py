"""Imports run one way: core ← tasks ← nodes, bridge, experiments."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ALLOWED = {
    "iolspi_ros/core": ("iolspi_ros.core", "iolspi_ros.errors", "iolspi_ros.settings"),
    "sim_nodes/tasks": (
        "sim_nodes.tasks", "iolspi_ros.core", "iolspi_ros.errors", "iolspi_ros.settings",
    ),
    "sim_nodes/autopilot": ("sim_nodes.autopilot", "iolspi_ros.errors"),
    "msg_bridge/frames.py": (),
}  # fmt: skip
HIGHER = ("iolspi_ros.nodes", "iolspi_ros.experiments", "iolspi_ros.report", "iolspi_ros.bench",
          "iolspi_ros.cli", "iolspi_ros.graph", "msg_bridge")  # fmt: skip
"""Rooms above the vehicles and what every node stands on."""
GROUND = ["sim_nodes", "iolspi_ros/wire.py", "iolspi_ros/pairing.py", "iolspi_ros/runtime.py",
          "iolspi_ros/vehicle_topics.py", "iolspi_ros/parameters.py",
          "iolspi_ros/bags"]  # fmt: skip
ROS = ("rclpy", "std_msgs", "sensor_msgs", "std_srvs", "rosgraph_msgs", "diagnostic_msgs",
       "geometry_msgs", "visualization_msgs")  # fmt: skip
ROS_FREE = ["iolspi_ros/core", "sim_nodes/tasks", "sim_nodes/world.py", "sim_nodes/pilots.py",
            "sim_nodes/pictures.py", "sim_nodes/autopilot", "iolspi_ros/experiments",
            "iolspi_ros/report",
            "iolspi_ros/bags"]  # fmt: skip

ROS_FREE += [
    f"msg_bridge/mavlink/{path.name}"
    for path in (ROOT / "msg_bridge/mavlink").glob("*.py")
    if path.name != "node.py"
]


def imports(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def files(place):
    path = ROOT / place
    return [path] if path.is_file() else sorted(path.rglob("*.py"))


@pytest.mark.parametrize("place", ALLOWED)
def test_a_room_imports_only_what_lies_below_it(place):
    for path in files(place):
        for name in imports(path):
            if name.startswith(("iolspi_ros", "sim_nodes", "msg_bridge")):
                assert name.startswith(ALLOWED[place]), f"{path} imports {name}"


@pytest.mark.parametrize("place", GROUND)
def test_no_room_imports_what_stands_on_it(place):
    for path in files(place):
        for name in imports(path):
            assert not name.startswith(HIGHER), f"{path} imports {name}"


@pytest.mark.parametrize("place", ROS_FREE)
def test_no_ros_outside_nodes(place):
    for path in files(place):
        for name in imports(path):
            assert not name.startswith(ROS), f"{path} imports {name}"
