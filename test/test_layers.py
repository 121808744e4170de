"""Imports run one way: task, core ← tasks ← nodes, bridges ← experiments, report, bench, cli."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from sim_nodes.tasks import names

ROOT = Path(__file__).parent.parent
PACKAGES = ("iolspi_ros", "sim_nodes", "msg_bridge")

ROOMS = {
    # room: what it is made of; the longest prefix that a module has is its room
    "ground": ("iolspi_ros", "iolspi_ros.errors", "iolspi_ros.settings", "iolspi_ros.registry",
               "iolspi_ros.process", "iolspi_ros.environment", "iolspi_ros.leftovers",
               "iolspi_ros.folders", "iolspi_ros.beside", "iolspi_ros.figures",
               "iolspi_ros.compiling", "sim_nodes", "msg_bridge"),
    "task": ("iolspi_ros.task",),
    "core": ("iolspi_ros.core",),
    "methods": ("iolspi_ros.methods",),
    "saving": ("iolspi_ros.saving",),
    "files": ("iolspi_ros.arguments", "iolspi_ros.resources"),
    "vehicle": ("sim_nodes.quadrotor",),
    "tasks": ("sim_nodes.tasks", "sim_nodes.pilots", "sim_nodes.world", "sim_nodes.pictures"),
    "wire": ("iolspi_ros.wire", "iolspi_ros.cdr", "iolspi_ros.pairing", "iolspi_ros.bags",
             "iolspi_ros.seen", "iolspi_ros.takeover", "iolspi_ros.preview_request"),
    "ros": ("iolspi_ros.qos", "iolspi_ros.parameters", "iolspi_ros.runtime", "iolspi_ros.managed",
            "iolspi_ros.vehicle_topics", "iolspi_ros.unheard", "iolspi_ros.vitals",
            "iolspi_ros.learner_asked"),
    "frames": ("msg_bridge.frames",),
    "autopilot": ("sim_nodes.autopilot",),
    "simulator": ("sim_nodes.simulator", "sim_nodes.markers",
                  "sim_nodes.camera"),
    "nodes": ("iolspi_ros.nodes",),
    "bridge": ("msg_bridge.mavlink",),
    "robot": ("msg_bridge.ros",),
    "environment": ("msg_bridge.gym",),
    "cockpit": ("msg_bridge.cockpit",),
    "graph": ("iolspi_ros.graph",),
    "experiments": ("iolspi_ros.experiments",),
    "report": ("iolspi_ros.report",),
    "bench": ("iolspi_ros.bench",),
    "cli": ("iolspi_ros.cli", "iolspi_ros.__main__"),
}  # fmt: skip

BELOW = {
    "ground": set(),
    "task": {"ground"},
    "core": {"ground", "task"},
    "methods": {"ground", "task", "core"},
    "saving": {"ground", "task", "core"},
    "files": {"ground", "task"},
    "vehicle": {"ground"},
    "tasks": {"ground", "task", "core", "vehicle"},
    "wire": {"ground", "task", "core", "files"},
    "ros": {"ground", "task", "core", "files", "wire"},
    "frames": {"ground"},
    "autopilot": {"ground", "task", "core", "vehicle", "tasks", "frames"},
    "simulator": {"ground", "task", "core", "files", "tasks", "wire", "ros"},
    "nodes": {"ground", "task", "core", "saving", "files", "tasks", "wire", "ros", "simulator"},
    "bridge": {"ground", "task", "core", "files", "tasks", "wire", "ros", "frames"},
    "robot": {"ground", "task", "core", "files", "wire", "ros"},
    "cockpit": {"ground", "task", "core", "files", "wire", "ros"},
    "environment": {"ground", "task", "core", "files", "wire", "ros", "graph"},
    "graph": {"ground", "files", "nodes"},
    "experiments": {"ground", "task", "core", "methods", "files", "tasks", "wire"},
    "report": {"ground", "task", "core", "methods", "files", "tasks", "wire", "experiments"},
}
BELOW["bench"] = {"bench", *BELOW["report"], "report", "saving", "ros", "frames", "vehicle",
                  "autopilot", "bridge", "simulator", "nodes", "graph", "robot",
                  "cockpit"}  # fmt: skip
BELOW["cli"] = {*BELOW["bench"], "bench"}

EXCEPTIONS = {
    # module: what it alone may import from a room beside or above its own, and why
    "iolspi_ros.nodes.monitor": {"iolspi_ros.experiments.history"},  # what a report needs
}

ROS = ("rclpy", "std_msgs", "sensor_msgs", "std_srvs", "rosgraph_msgs", "diagnostic_msgs",
       "geometry_msgs", "visualization_msgs", "lifecycle_msgs", "rcl_interfaces",
       "builtin_interfaces")  # fmt: skip
ROS_FREE = ("ground", "task", "core", "methods", "files", "vehicle", "tasks", "frames", "autopilot",
            "experiments", "report")  # fmt: skip
"""Rooms that no ROS is imported in; elsewhere it is, and in `wire` only where a message is made."""


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


FILES = {
    module_of(path): path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))
}


def room_of(module):
    found = [
        (len(prefix), room) for room, prefixes in ROOMS.items() for prefix in prefixes
        if module == prefix or (module.startswith(f"{prefix}.") and prefix not in PACKAGES)
    ]  # fmt: skip
    return max(found)[1] if found else None


def imported(module, node):
    """Names of ours or others that an import statement brings: modules where they are such."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
        return
    assert node.level == 0, f"{module} imports relatively"
    for alias in node.names:
        whole = f"{node.module}.{alias.name}"
        yield whole if whole in FILES else node.module


def imports(module, top_only=False):
    """What a module imports anywhere, also inside functions and for types alone."""
    tree = ast.parse(FILES[module].read_text())
    nodes = tree.body if top_only else ast.walk(tree)
    for node in nodes:
        if isinstance(node, ast.Import | ast.ImportFrom):
            yield from imported(module, node)


def test_every_module_is_in_a_room():
    assert [module for module in FILES if room_of(module) is None] == []
    for prefixes in ROOMS.values():
        assert [prefix for prefix in prefixes if prefix not in FILES] == []
    assert set(BELOW) == set(ROOMS)
    assert set(EXCEPTIONS) <= set(FILES)


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_imports_only_what_lies_below_it(room):
    wrong = []
    for module in FILES:
        if room_of(module) != room:
            continue
        for name in imports(module):
            if name.partition(".")[0] not in PACKAGES or name in EXCEPTIONS.get(module, ()):
                continue
            if room_of(name) != room and room_of(name) not in BELOW[room]:
                wrong.append(f"{module} imports {name} ({room_of(name)})")
    assert wrong == []


def test_what_lies_below_is_not_above():
    """The matrix itself has no circle."""
    for room, below in BELOW.items():
        for lower in below - {room}:
            assert room not in BELOW[lower], f"{room} and {lower} lie below each other"


def test_no_exception_is_left_over():
    for module, allowed in EXCEPTIONS.items():
        assert allowed <= set(imports(module)), module


def circles(edges):
    """Circles among modules, each once, by depth-first search."""
    found, done = [], set()

    def walk(module, path):
        if module in path:
            circle = path[path.index(module) :]
            if set(circle) not in [set(other) for other in found]:
                found.append(circle)
            return
        if module in done:
            return
        for other in edges[module]:
            walk(other, [*path, module])
        done.add(module)

    for module in edges:
        walk(module, [])
    return found


def test_no_modules_import_each_other_not_even_for_types():
    edges = {
        module: {name for name in imports(module) if name in FILES and name != module}
        for module in FILES
    }
    assert circles(edges) == []


@pytest.mark.parametrize("room", ROS_FREE)
def test_no_ros_where_none_is_needed(room):
    wrong = [
        f"{module} imports {name}"
        for module in FILES if room_of(module) == room
        for name in imports(module) if name.partition(".")[0] in ROS
    ]  # fmt: skip
    assert wrong == []


def test_reading_bags_and_the_wire_needs_no_ros_to_be_imported():
    wrong = [
        f"{module} imports {name}"
        for module in FILES if room_of(module) == "wire"
        for name in imports(module, top_only=True) if name.partition(".")[0] in ROS
    ]  # fmt: skip
    assert wrong == []


def ros_names(tree):
    """Names in a file that come from rclpy: modules, classes and functions."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            from_ros = [
                alias for alias in node.names
                if (getattr(node, "module", None) or alias.name).partition(".")[0] == "rclpy"
            ]  # fmt: skip
            found |= {(alias.asname or alias.name).partition(".")[0] for alias in from_ros}
    return found


def private(name):
    return name.startswith("_") and not name.startswith("__")


@pytest.mark.parametrize("module", FILES)
def test_nothing_private_of_rclpy_is_used(module):
    tree = ast.parse(FILES[module].read_text())
    ours = ros_names(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("rclpy"):
            parts = [*node.module.split("."), *(alias.name for alias in node.names)]
            assert not any(map(private, parts)), ast.unparse(node)
        if isinstance(node, ast.Attribute) and private(node.attr):
            root = node.value
            while isinstance(root, ast.Attribute):
                root = root.value
            assert not (isinstance(root, ast.Name) and root.id in ours), ast.unparse(node)


@pytest.mark.parametrize("module", [m for m in FILES if room_of(m) in (
    "task", "core", "methods", "wire", "ros", "nodes", "report")])  # fmt: skip
def test_no_task_is_named_where_any_task_is_meant(module):
    text = FILES[module].read_text()
    assert [name for name in names() if name in text] == []


PROBE = """
import json, os, sys
before = dict(os.environ)
import signal
handlers = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
{imports}
after = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)]
print(json.dumps([dict(os.environ) == before, handlers == after,
                  sorted(name for name in sys.modules if name.partition(".")[0] in {ros!r})]))
"""


def test_importing_changes_nothing_in_the_process():
    """The core stands alone: no variable, no signal handler, and no ROS comes with it."""
    modules = [m for m in FILES if room_of(m) in ("ground", "task", "core", "tasks")]
    code = PROBE.format(imports="\n".join(f"import {m}" for m in modules), ros=ROS)
    environment = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout) == [True, True, []]
