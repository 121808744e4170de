"""A vehicle and a learner of one's own: one file each outside the package, found by name."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Environment in which both are installed, in a folder that nobody else knows."""
    there = tmp_path_factory.mktemp("installed")
    for name in ("vehicle", "learner"):
        source = tmp_path_factory.mktemp(name) / name
        shutil.copytree(EXAMPLES / name, source)
        subprocess.run(
            [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index",
             "--no-build-isolation", "--target", there, source],
            check=True, capture_output=True, text=True,
        )  # fmt: skip
    return os.environ | {"PYTHONPATH": str(there)}


def iolspi(env, *arguments, cwd):
    command = [sys.executable, "-m", "iolspi_ros", *arguments]
    return subprocess.run(command, env=env, cwd=cwd, capture_output=True, text=True, timeout=170)


def summary(folder):
    return json.loads(next(folder.rglob("summary.json")).read_text())


@pytest.mark.parametrize(("learner", "episodes"), [("iolspi", 40), ("q_learning", 40)])
def test_they_learn_by_name_with_checkpoint_and_report(installed, tmp_path, learner, episodes):
    done = iolspi(
        installed, "learn", "--task", "boat", "--learner", learner, "--episodes", str(episodes),
        "--out", "out", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = summary(tmp_path / "out")
    assert (found["task"], found["learner"], found["episodes"]) == ("boat", learner, episodes)
    assert found["near_optimal_return"] is None  # nobody computed one, and it is a report
    page = next((tmp_path / "out").rglob("report.html")).read_text()
    assert "stay afloat" in page
    assert "Learned policy" not in done.stderr
    with np.load(next((tmp_path / "out").rglob("checkpoint.npz"))) as file:
        about = json.loads(str(file["about"]))
    assert about["learner"] == learner
    assert json.loads(about["task"])["name"] == "boat"


def test_they_fly_through_the_graph_and_go_on_from_a_checkpoint(nodes, installed, tmp_path):
    """Three variables that are no joints, five actions, a learner that the nodes never heard of."""
    nodes.env = nodes.env | {"PYTHONPATH": installed["PYTHONPATH"]}
    path = tmp_path / "c.npz"
    mine = ("-p", "learner:=q_learning", "-p", "wait_for_demonstrations:=false",
            "-p", f"checkpoint:={path}", "-p", "update_interval:=100")  # fmt: skip
    steps = []
    for more in ((), ("-p", "resume:=true")):
        nodes.start("learner", *mine, *more)
        nodes.start("simulator", "-p", "task:=boat", "-p", "episodes:=10")
        nodes.wait_for("simulator", "done: 10 episodes")
        assert nodes.end("simulator") == 0
        assert nodes.end("learner") == 0, nodes.log("learner")
        with np.load(path) as file:
            steps.append(json.loads(str(file["about"]))["parts"]["learner"]["step"])
    assert 0 < steps[0] < steps[1]


def test_another_vehicle_is_refused_with_both_sides_named(nodes, installed, tmp_path):
    nodes.env = nodes.env | {"PYTHONPATH": installed["PYTHONPATH"]}
    path = tmp_path / "c.npz"
    assert iolspi(installed, "learn", "--task", "boat", "--episodes", "30", "--out", "out",
                  cwd=tmp_path).returncode == 0  # fmt: skip
    shutil.copy(next((tmp_path / "out").rglob("checkpoint.npz")), path)
    nodes.start("simulator", "-p", "task:=pendulum")
    nodes.wait_for("simulator", "pendulum in lockstep")
    status, said = nodes.finish(
        "learner", "-p", f"checkpoint:={path}", "-p", "resume:=true",
    )  # fmt: skip
    assert status == 2
    assert "name is 'boat' here and 'pendulum' there" in said
    assert "Traceback" not in said
