"""The launch file: which nodes it starts, and with what.

`launch` comes with a ROS installation only; where there is none, stand-ins with the same names take
its place here, so that what is tested is the file and not how ROS runs it.
"""

import importlib.util
import sys
import types
from dataclasses import fields
from pathlib import Path

import pytest

from iolspi_ros.core.learner import learner_class
from iolspi_ros.managed import Autostart
from iolspi_ros.nodes.demonstrator import DemonstratorSettings
from iolspi_ros.nodes.learning import LearningSettings
from iolspi_ros.nodes.player import PlayerSettings
from iolspi_ros.nodes.saving import SavingSettings
from iolspi_ros.settings import from_mapping
from msg_bridge.mavlink.arbiter import Timeouts
from msg_bridge.mavlink.node import Bridge
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from sim_nodes.simulator import SimulatorSettings, TaskChoice
from sim_nodes.tasks.pendulum import Pendulum

FOLDER = Path(__file__).parent.parent / "launch"
CLASSES = {
    "simulator": (Autostart, TaskChoice, SimulatorSettings),
    "demonstrator": (Autostart, DemonstratorSettings, PlayerSettings),
    "learner": (Autostart, LearningSettings, SavingSettings, learner_class("iolspi").Settings),
    "bridge": (Bridge.Autostart, LinkSettings, FlightSettings, Timeouts),
}
LEARNING = ("simulator", "demonstrator", "learner")
FLYING = ("bridge", "demonstrator", "learner")


class Recorded:
    """Whatever it is made with, as attributes."""

    def __init__(self, *places, **names):
        self.places = places
        self.__dict__ |= names


class Configuration(Recorded):
    def perform(self, context):
        return context[self.places[0]]


@pytest.fixture
def launched(stand_ins):
    """Call with the arguments of the graph that learns from a simulator; the nodes by name."""
    return load("learn")


@pytest.fixture
def flown(stand_ins):
    """The same with that of a bridge."""
    return load("fly")


@pytest.fixture
def stand_ins(monkeypatch):
    stand_ins = {
        "launch": {"LaunchDescription": Recorded},
        "launch.actions": {"DeclareLaunchArgument": Recorded, "OpaqueFunction": Recorded},
        "launch.substitutions": {"LaunchConfiguration": Configuration},
        "launch_ros": {},
        "launch_ros.actions": {"Node": Recorded},
        "ament_index_python": {},
        "ament_index_python.packages": {"get_package_share_directory": lambda name: "share"},
    }
    for name, members in stand_ins.items():
        module = types.ModuleType(name)
        module.__dict__.update(members)
        monkeypatch.setitem(sys.modules, name, module)


def load(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.launch.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    declared = {a.places[0]: a.default_value
                for a in module.generate_launch_description().places[0][:-1]}  # fmt: skip

    def launch(**arguments):
        assert set(arguments) <= set(declared)
        found = module.nodes(declared | arguments)
        if "vehicles" in arguments:
            return {f"{node.namespace}/{node.executable}": node for node in found}
        return {node.executable: node for node in found}

    return launch


def parameters(node):
    return {name: value for part in node.parameters if isinstance(part, dict)
            for name, value in part.items()}  # fmt: skip


def check(found):
    """Every parameter is one of its node, and allowed."""
    for name, node in found.items():
        values = parameters(node)
        known = {field.name for cls in CLASSES[name] for field in fields(cls)}
        assert set(values) <= known
        for cls in CLASSES[name]:
            from_mapping(cls, values, name)  # raises when a value is not allowed


def test_a_bridge_is_checked_and_does_not_take_off_by_itself(flown):
    found = flown(url="tcp:127.0.0.1:5760", autopilot="ardupilot", speed_up="5.0", system="3",
                  load="estimate", checkpoint="c.npz")  # fmt: skip
    assert set(found) == set(FLYING)
    check(found)
    bridge = parameters(found["bridge"])
    assert (bridge["autostart"], bridge["autopilot"], bridge["system"]) == (
        "configure", "ardupilot", 3,
    )  # fmt: skip
    assert parameters(found["learner"])["wait_for_demonstrations"]
    none = flown(demonstration="0", autostart="activate")
    assert set(none) == {"bridge", "learner"}
    assert not parameters(none["learner"])["wait_for_demonstrations"]


@pytest.mark.parametrize("task", ["pendulum", "slung_load", "cart_pole", "boat:Boat"])
@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_every_parameter_is_one_of_its_node(launched, task, mode):
    found = launched(task=task, mode=mode, seed="3", checkpoint="c.npz")
    assert set(found) == set(LEARNING)
    check(found)
    assert parameters(found["simulator"])["task"] == task
    assert parameters(found["learner"])["background"] == (mode == "realtime")
    files = [part for part in found["learner"].parameters if isinstance(part, str)]
    assert [Path(file).name for file in files] == ([f"{task}.yaml"] if ":" not in task else [])


def test_a_namespace_is_that_of_all(launched):
    assert {node.namespace for node in launched(namespace="v1").values()} == {"v1"}


def test_a_person_with_a_joystick_takes_the_place_of_a_shipped_set(launched):
    shown = parameters(launched(joystick="true", record="mine")["demonstrator"])
    assert shown == {"source": "joy", "record": "mine"}
    none = launched(demonstration="0")
    assert set(none) == {"simulator", "learner"}
    assert not parameters(none["learner"])["wait_for_demonstrations"]


def test_or_a_page_in_the_browser_does(launched):
    found = launched(cockpit="true", mode="realtime", record="mine", demonstration="0")
    assert set(found) == {*LEARNING, "cockpit"}
    assert found["cockpit"].parameters == []
    shown, n = parameters(found["demonstrator"]), Pendulum.description.n_actions
    assert (shown["source"], shown["record"], shown["review"]) == ("joy", "mine", True)
    assert (shown["joy_buttons"], shown["takeover_button"]) == (list(range(n)), n)
    assert parameters(found["learner"])["wait_for_demonstrations"]


def test_each_of_several_vehicles_has_its_own(launched):
    found = launched(vehicles="2", seed="5", checkpoint="out/c.npz", namespace="lab")
    assert set(found) == {f"/lab/v{n}/{node}" for n in (1, 2) for node in LEARNING}
    learners = [parameters(found[f"/lab/v{n}/learner"]) for n in (1, 2)]
    assert [learner["seed"] for learner in learners] == [5, 6]
    assert [learner["checkpoint"] for learner in learners] == ["out/c_v1.npz", "out/c_v2.npz"]


def test_or_one_learner_flies_them_all(launched):
    found = launched(vehicles="3", learners="one")
    assert set(found) == {"/v1/simulator", "/v2/simulator", "/v3/simulator",
                          "/v1/learner", "/v1/demonstrator"}  # fmt: skip
    assert parameters(found["/v1/learner"])["other_vehicles"] == ["/v2", "/v3"]
    for wrong in ({"vehicles": "0"}, {"vehicles": "2", "learners": "two"}):
        with pytest.raises(ValueError, match="allowed"):
            launched(**wrong)
