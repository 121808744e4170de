"""The `iolspi` command from outside."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from iolspi_ros import cli
from iolspi_ros.bags import read_demonstration
from iolspi_ros.cli import progress
from iolspi_ros.resources import find
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

COMMANDS = ("bench", "demo", "fly", "learn", "record", "run")


def iolspi(*arguments, cwd=None, deadline=170.0):
    command = [sys.executable, "-P", "-m", "iolspi_ros", *map(str, arguments)]
    return subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, timeout=deadline, check=False
    )


@pytest.fixture
def command(tmp_path, monkeypatch, capfd):
    """The command in this process: its exit status, and all that it said."""

    def run(*arguments):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["iolspi", *map(str, arguments)])
        capfd.readouterr()
        try:
            status = cli.main()
        except SystemExit as end:
            status = end.code
        said = capfd.readouterr()
        return status, said.out + said.err

    return run


@pytest.mark.parametrize("name", COMMANDS)
def test_help_teaches_by_example(command, name):
    status, said = command(name, "--help")
    assert status == 0
    assert f"Example: iolspi {name}" in " ".join(said.split())


def test_help_and_version():
    assert all(command in iolspi("--help").stdout for command in COMMANDS)
    assert re.match(r"iolspi_ros \d+\.\d+\.\d+", iolspi("--version").stdout)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("learn", "--task", "pendulm"), "task is 'pendulm'; allowed: cart_pole, pendulum"),
        (("bench", "tempo"), "subject is 'tempo'; allowed: learner, speed, scale"),
        (("learn", "--demos", "/nowhere"), "bag /nowhere does not exist"),
        (("learn", "--seconds", "0"), "nothing would be learned"),
        (("learn", "--config", "/nowhere.yaml"), "/nowhere.yaml does not exist"),
        (("learn", "--out", "/proc/no"), "--out /proc/no cannot be made"),
        (("demo", "--task", "pendulm"), "task is 'pendulm'; allowed: cart_pole, pendulum"),
        (("demo", "--set", "6"), "--set is 6; allowed: 1 to 5"),
        (("learn", "--seed", "-1"), "Invalid value for '--seed'"),
        (("record", "--out", "/proc/no"), "--out /proc/no cannot be made"),
        (("run", "learner", "-p", "seed:=1"), "would do nothing; allowed: --ros-args"),
        (("demo", "--seconds", "-1"), "--seconds is -1.0; allowed"),
        (("demo", "--episodes", "0"), "--episodes is 0; allowed"),
        (("learn", "--episodes", "9", "--seconds", "9"), "both given; allowed: one of them"),
        (("demo", "--task", "cart_pole", "--demos", "/nowhere"), "bag /nowhere does not exist"),
        (
            ("demo", "--demos", find("demos", "pendulum", "set_5"), "--vehicle", "/v9"),
            "has no vehicle /v9 ; allowed: vehicle / run 1",
        ),
        (("demo", "--out", "/proc/no"), "--out /proc/no cannot be made"),
        (("fly", "--autopilot", "betaflight"), "allowed: embedded, px4, ardupilot, paparazzi"),
        (("fly", "--autopilot", "paparazzi"), "cannot be flown over MAVLink"),
        (("fly", "--checkpoint", "/nowhere"), "--checkpoint /nowhere is not there"),
        (("fly", "--out", "/proc/no"), "--out /proc/no cannot be made"),
        (("record", "--set", "7", "--out", "x"), "--set is 7; allowed: 1 to 5"),
        (("record", "--mode", "sleep", "--out", "x"), "mode is 'sleep'; allowed: perform, explore"),
        (
            ("run", "simulator", "--task", "kite"),
            "task is 'kite'; allowed: cart_pole, pendulum, slung_load",
        ),
        (("run", "pilot"), "node is 'pilot'; allowed: simulator, demonstrator, learner"),
    ],
)
def test_bad_input_is_one_line_with_status_2(command, arguments, words):
    status, said = command(*arguments)
    assert words in said
    assert (status, "Traceback" in said) == (2, False), said


def test_bad_input_ends_the_process_as_it_ends_main(tmp_path):
    result = iolspi("demo", "--set", "6", cwd=tmp_path)
    assert result.returncode == 2
    assert result.stderr == "iolspi: --set is 6; allowed: 1 to 5\n"


def test_learn_leaves_a_policy_and_a_report(tmp_path):
    out = tmp_path / "out"
    arguments = ("--demos", find("demos", "pendulum", "set_5"), "--seconds", 30, "--out", out)
    result = iolspi("learn", *arguments)
    assert result.returncode == 0, result.stderr
    summary = json.loads((out / "summary.json").read_text())
    assert summary["vehicle_seconds"] == 30.0
    assert summary["demonstrated_samples"] == 6300
    assert 1.0 <= summary["ratio_to_near_optimal"] < 1.1
    assert summary["offline"].startswith("offline LSPI: ")
    page = (out / "report.html").read_text()
    assert page.count("<img") >= 5
    assert (out / "checkpoint.npz").is_file()
    again = iolspi("learn", *arguments[:-1], tmp_path / "again")
    assert again.returncode == 0
    files = [np.load(folder / "checkpoint.npz") for folder in (out, tmp_path / "again")]
    np.testing.assert_array_equal(files[0]["learner.weights"], files[1]["learner.weights"])


@pytest.mark.slow
def test_the_cart_pole_is_learned_from_nothing_and_has_no_ratio(tmp_path):
    """Nobody falls at best: a return of zero."""
    out = tmp_path / "out"
    result = iolspi("learn", "--task", "cart_pole", "--episodes", 60, "--out", out)
    assert "the near-optimal one is 0, 100% of the starts never fall" in result.stdout
    summary = json.loads((out / "summary.json").read_text())
    assert summary["ratio_to_near_optimal"] is None
    assert summary["near_optimal_return"] == summary["discounted_return"] == 0.0
    assert summary["ends_while_learning"]["fall"] > 0.5
    assert "the near-optimal one is 0" in (out / "report.html").read_text()


def test_without_a_terminal_progress_is_a_line_now_and_then_with_an_eta(monkeypatch, capsys):
    now = [0.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    show = progress._lines("flying", 100)
    for done in range(101):
        now[0] = 100.0 + done
        show(done)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 22
    assert lines[-1] == "flying: 100 of 100"
    assert "flying: 50 of 100, 50 s left" in lines  # what came before the first is done once


def graph_processes():
    """Nodes of ours that are running, by their command lines."""
    lines = []
    for file in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            lines.append(file.read_bytes().replace(b"\0", b" ").decode(errors="replace"))
    return [line for line in lines if "--params-file" in line]


@pytest.mark.timeout(300)
def test_the_demo_leaves_everything_and_no_graph(tmp_path):
    out = tmp_path / "demo"
    result = iolspi("demo", "--seconds", 15, "--out", out, deadline=240)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "learning online [episodes]: 10 of 10" in result.stdout
    summary = json.loads((out / "summary.json").read_text())
    assert summary["vehicle_seconds"] == 15.0
    assert summary["wall_seconds"] > 0
    assert summary["lockstep_steps_per_second"] > 0
    assert summary["near_optimal_return"] < 0
    assert summary["discounted_return"] <= summary["near_optimal_return"]
    assert 0 <= summary["success_fraction"] <= 1
    assert summary["shown_success_fraction"] == summary["success_fraction"]  # graph and headless
    assert (summary["ros_distro"], summary["rmw"]) == ("jazzy", "rmw_fastrtps_cpp")
    assert (out / "checkpoint.npz").is_file()
    page = (out / "report.html").read_text()
    assert page.count("<img") >= 6
    assert "<canvas" in page
    recorded = read_demonstration(out / "bag", Pendulum.description)
    assert len(recorded.samples) == 6300
    assert not [line for line in graph_processes() if str(out) in line]


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_demo_of_another_task_with_a_bag_of_the_user_s(tmp_path):
    """A vehicle that the project has never seen, without picture, baseline or parameter file."""
    boat = find("package.xml").parent / "examples" / "vehicle" / "boat.py"
    (tmp_path / "boat.py").write_text(boat.read_text())
    env = os.environ | {"PYTHONPATH": f"{tmp_path}:{find('package.xml').parent}"}
    command = (sys.executable, "-P", "-m", "iolspi_ros")

    def run(*given):
        return subprocess.run(
            [*command, *map(str, given)], cwd=tmp_path, env=env, capture_output=True, text=True,
            timeout=300, check=False,
        )  # fmt: skip

    first = run("demo", "--task", "boat:Boat", "--episodes", 20, "--out", "first")
    assert first.returncode == 0, first.stdout + first.stderr
    assert "from nothing" in first.stdout
    again = run("demo", "--task", "boat:Boat", "--demos", "first/bag", "--episodes", 5,
                "--out", "again")  # fmt: skip
    assert again.returncode == 0, again.stdout + again.stderr
    for folder, demos in (("first", None), ("again", "first/bag")):
        summary = json.loads((tmp_path / folder / "summary.json").read_text())
        assert summary.get("demos") == demos
        assert 0 <= summary["shown_success_fraction"] <= 1
        assert (tmp_path / folder / "report.html").is_file()


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_demo_of_the_slung_load_counts_what_breaks(tmp_path):
    out = tmp_path / "demo"
    result = iolspi("demo", "--task", "slung_load", "--episodes", 30, "--out", out, deadline=380)
    assert result.returncode == 0, result.stdout + result.stderr
    assert "learning online [episodes]: 30 of 30" in result.stdout
    assert "near-optimal policy [%]: 100 of 100" in result.stdout
    summary = json.loads((out / "summary.json").read_text())
    ways = summary["ends_shown"]
    assert set(ways) == {"time-out", "dunk", "miss", "crash: cable", "crash: wall"}
    assert sum(ways.values()) == pytest.approx(1.0, abs=0.001)
    assert summary["shown_success_fraction"] == summary["success_fraction"]  # graph and headless
    assert ways["dunk"] == pytest.approx(summary["success_fraction"], abs=1e-4)
    assert sum(summary["ends_while_learning"].values()) == pytest.approx(1.0, abs=0.001)
    assert summary["discounted_return"] < summary["near_optimal_return"]
    page = (out / "report.html").read_text()
    assert page.count("<img") >= 8
    assert "<canvas" in page
    words = page.lower()
    assert "end with a dunk" in words
    assert "upright" not in words
    recorded = read_demonstration(out / "bag", SlungLoad.description)
    assert len(recorded.samples) == summary["demonstrated_samples"]


def test_the_demo_cleans_up_after_ctrl_c(tmp_path):
    out = tmp_path / "demo"
    process = subprocess.Popen(
        [sys.executable, "-m", "iolspi_ros", "demo", "--out", str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    end = time.monotonic() + 60
    while not (out / "learner.log").is_file() or "offline" not in (out / "learner.log").read_text():
        assert time.monotonic() < end
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130, said
    assert "Traceback" not in said
    assert not [line for line in graph_processes() if str(out) in line]
    assert (out / "checkpoint.npz").is_file()


def test_a_node_runs_with_the_parameters_of_a_task(tmp_path):
    command = ["run", "simulator", "--task", "slung_load", "--ros-args", "-p", "initial:=narrow"]
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(
            [sys.executable, "-m", "iolspi_ros", *command], stdout=log, stderr=log
        )
    end = time.monotonic() + 30
    while "slung_load in lockstep" not in (tmp_path / "log").read_text():
        assert time.monotonic() < end
        assert process.poll() is None, (tmp_path / "log").read_text()
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    assert process.wait(60) == 0


def test_a_folder_that_is_called_like_the_package_is_in_nobodys_way(tmp_path):
    (tmp_path / "iolspi_ros").mkdir()  # as in the folder that holds a clone
    (tmp_path / "sim_nodes").mkdir()
    result = iolspi("record", "--out", "bag", cwd=tmp_path)
    assert result.returncode == 0, result.stderr


@pytest.mark.slow
def test_a_set_is_recorded_with_the_settings_of_a_file(tmp_path):
    """The pilot's model is the vehicle's, also where that is not as by default."""
    shipped = find("config", "slung_load_3d.yaml").read_text()
    file, bag = tmp_path / "mine.yaml", tmp_path / "mine"
    file.write_text(shipped.replace("vertical: false", "vertical: true"))
    task = SlungLoad3D(vertical=True).description
    assert task.n_actions == SlungLoad3D().description.n_actions + 2
    made = iolspi("record", "--task", "slung_load_3d", "--config", file, "--out", bag)
    assert made.returncode == 0, made.stderr
    assert read_demonstration(bag, task).notes == []


@pytest.mark.slow
def test_a_recorded_set_can_be_learned_from(tmp_path):
    bag = tmp_path / "mine"
    result = iolspi("record", "--mode", "explore", "--corruption", 0.2, "--out", bag)
    assert result.returncode == 0, result.stderr
    found = read_demonstration(bag, Pendulum.description)
    assert len(found.samples) == 6300
    assert found.notes == []
    assert [p.name for p in tmp_path.iterdir()] == ["mine"]
    assert "exists already" in iolspi("record", "--out", bag).stderr
