"""The parameter files say what their tasks are."""

from dataclasses import fields

import numpy as np
import pytest
from iolspi_ros.nodes.flight import FlightSettings
from iolspi_ros.nodes.stick import StickSettings

from iolspi_ros import resources
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.nodes.demonstrator import DemonstratorSettings
from iolspi_ros.nodes.learner import NodeSettings
from iolspi_ros.nodes.player import PlayerSettings
from iolspi_ros.settings import from_mapping
from sim_nodes.pilots import PilotSettings
from sim_nodes.simulator import SimulatorSettings
from sim_nodes.tasks import TASKS
from sim_nodes.world import WorldSettings


def read(task):
    file = resources.find("config", f"{task}.yaml")
    return file, {node: resources.parameters(file, node) for node in
                  ("simulator", "demonstrator", "learner", "literal")}  # fmt: skip


@pytest.mark.parametrize("task", TASKS)
def test_every_parameter_is_one_that_its_node_has(task):
    classes = {
        "simulator": (SimulatorSettings, WorldSettings, TASKS[task]),
        "demonstrator": (
            DemonstratorSettings, FlightSettings, PlayerSettings, StickSettings, PilotSettings,
        ),
        "learner": (NodeSettings, LSPISettings),
        "literal": (NodeSettings, LSPISettings),
    }  # fmt: skip
    file, sections = read(task)
    sections["literal"] = sections["learner"] | sections["literal"]
    for node, values in sections.items():
        known = {field.name for cls in classes[node] for field in fields(cls)} | {"task"}
        assert set(values) <= known
        for cls in classes[node]:
            from_mapping(cls, values, str(file))  # raises when a value is not allowed
    assert {sections[node]["task"] for node in ("simulator", "demonstrator", "learner")} == {task}


@pytest.mark.parametrize("task", TASKS)
def test_the_learner_is_the_tasks(task):
    vehicle, (file, sections) = TASKS[task](), read(task)
    learner = sections["learner"]
    settings = from_mapping(LSPISettings, learner, str(file))
    assert tuple(learner["joints"]) == vehicle.description.joints
    assert settings.n_actions == vehicle.description.n_actions == len(vehicle.action_names)
    assert learner["neutral"] == vehicle.description.neutral
    assert (settings.sampling_time, settings.gamma) == (
        vehicle.description.sampling_time,
        vehicle.description.gamma,
    )
    assert settings.features().n_dims == vehicle.description.n_dims == len(vehicle.axes)
    assert len(settings.low) == 2 * len(vehicle.description.joints)


def test_the_slung_load_learns_with_the_numbers_of_the_thesis():
    learner = read("slung_load")[1]["learner"]
    np.testing.assert_allclose(learner["low"], [-6, -4, -np.pi / 2, -np.pi])  # T Table 11-1
    np.testing.assert_allclose(learner["high"], [0, 4, np.pi / 2, np.pi])
    assert learner["epsilon"] == 0.01  # T 11-1
    assert read("slung_load")[1]["literal"]["centers"] == [9, 1, 9, 1]  # T IV-B


@pytest.mark.parametrize("task", TASKS)
def test_every_task_says_its_own_words(task):
    vehicle, rng = TASKS[task](), np.random.default_rng(0)
    n = vehicle.description.n_actions
    assert len(vehicle.axes) == vehicle.description.n_dims == 2 * len(vehicle.description.joints)
    assert all("[" in axis for axis in vehicle.axes)
    assert max(vehicle.pictured) < len(vehicle.axes)
    assert len(vehicle.action_names) == n
    states = rng.uniform(
        vehicle.description.low, vehicle.description.high, (500, vehicle.description.n_dims)
    )
    _, reward, terminated = vehicle.step(states, rng.integers(n, size=500))
    ends = vehicle.ending(reward, terminated)
    assert (ends < len(vehicle.description.endings)).all()
    np.testing.assert_array_equal(ends > 0, terminated)  # the first ending is the clock's
