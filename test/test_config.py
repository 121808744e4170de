"""The parameter files say what their tasks are, and settings refuse what is no number."""

import importlib
import math
import pkgutil
from dataclasses import fields

import numpy as np
import pytest

import iolspi_ros.methods
import iolspi_ros.nodes
import msg_bridge
import sim_nodes.tasks
from iolspi_ros import resources
from iolspi_ros.core.learner import learner_class
from iolspi_ros.errors import InputError
from iolspi_ros.managed import Autostart
from iolspi_ros.nodes.demonstrator import DemonstratorSettings
from iolspi_ros.nodes.joystick import JoystickSettings
from iolspi_ros.nodes.learning import LearningSettings
from iolspi_ros.nodes.player import PlayerSettings
from iolspi_ros.nodes.saving import SavingSettings
from iolspi_ros.nodes.teleop import TeleopSettings
from iolspi_ros.settings import Settings, from_mapping
from sim_nodes import tasks
from sim_nodes.pilots import PilotSettings
from sim_nodes.simulator import SimulatorSettings, TaskChoice
from sim_nodes.tasks.base import Stateful
from sim_nodes.world import WorldSettings

LSPI = learner_class("iolspi").Settings


def read(task):
    file = resources.find("config", f"{task}.yaml")
    return file, {node: resources.parameters(file, node) for node in
                  ("simulator", "demonstrator", "learner", "beside")}  # fmt: skip


@pytest.mark.parametrize("task", tasks.names())
def test_every_parameter_is_one_that_its_node_has(task):
    classes = {
        "simulator": (Autostart, TaskChoice, SimulatorSettings, WorldSettings,
                      tasks.task_class(task)),
        "demonstrator": (Autostart, DemonstratorSettings, TeleopSettings, PlayerSettings,
                         JoystickSettings, PilotSettings),
        "learner": (Autostart, LearningSettings, SavingSettings, LSPI),
        "beside": (LearningSettings, SavingSettings, LSPI),
    }  # fmt: skip
    file, sections = read(task)
    assert sections["beside"].pop("label")
    sections["beside"] = sections["learner"] | sections["beside"]
    for node, values in sections.items():
        known = {field.name for cls in classes[node] for field in fields(cls)}
        assert set(values) <= known
        for cls in classes[node]:
            from_mapping(cls, values, str(file))  # raises when a value is not allowed
    assert sections["simulator"]["task"] == task


@pytest.mark.parametrize("task", tasks.names())
def test_the_learner_fits_the_task_and_repeats_nothing_of_it(task):
    about, (file, sections) = tasks.task_class(task).description, read(task)
    repeated = {"task", "joints", "neutral", "n_actions", "gamma", "sampling_time"}
    assert not repeated & set(sections["learner"])
    settings = from_mapping(LSPI, sections["learner"], str(file)).resolve(about)
    assert settings.features().n_dims == about.n_dims


def test_the_slung_load_learns_with_the_numbers_of_the_thesis():
    learner = read("slung_load")[1]["learner"]
    np.testing.assert_allclose(learner["low"], [-6, -4, -np.pi / 2, -np.pi])  # T Table 11-1
    np.testing.assert_allclose(learner["high"], [0, 4, np.pi / 2, np.pi])
    assert learner["epsilon"] == 0.01  # T 11-1
    assert read("slung_load")[1]["beside"]["centers"] == [9, 1, 9, 1]  # T IV-B


def each_by_itself(vehicle, action):
    """Reward and end of one step of an episode that this step may begin."""
    vehicle.begin(int(action))
    return vehicle.advance(int(action))[1:3]


@pytest.mark.parametrize("task", tasks.names())
def test_every_task_says_its_own_words(task):
    vehicle, rng = tasks.task_class(task)(), np.random.default_rng(0)
    about = vehicle.description
    assert len(about.joints) * 2 == about.n_dims
    assert all("[" in variable.axis for variable in about.variables)
    actions = rng.integers(about.n_actions, size=500)
    if isinstance(vehicle, Stateful):
        reward, terminated = np.array([each_by_itself(vehicle, action) for action in actions]).T
    else:
        states = rng.uniform(about.low, about.high, (500, about.n_dims))
        _, reward, terminated = vehicle.step(states, actions)
    ends = about.ending(reward, terminated)
    assert (ends < len(about.endings)).all()
    np.testing.assert_array_equal(ends > 0, terminated)  # the first ending is the clock's


def _known(kind=Settings):
    return [each for sub in kind.__subclasses__() for each in (sub, *_known(sub))]


@pytest.mark.parametrize("number", [math.inf, -math.inf, math.nan])
def test_a_setting_is_finite_unless_its_default_is_not(number):
    for package in (iolspi_ros.nodes, iolspi_ros.methods, sim_nodes.tasks, msg_bridge):
        for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            if module.name.split(".")[-1] not in ("__main__", "server", "page", "session"):
                importlib.import_module(module.name)
    for kind in _known():
        for field in fields(kind):
            many = isinstance(field.default, tuple)
            entries = field.default if many else (field.default,)
            if not entries or not all(type(entry) is float for entry in entries):
                continue
            if any(map(math.isinf, entries)):
                continue
            for value in ((number,) * len(entries), (*entries[:-1], number)) if many else (number,):
                with pytest.raises(InputError, match=field.name):
                    kind(**{field.name: value})
