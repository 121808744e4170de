"""A graph that is watched, and a machine that is looked at."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from iolspi_ros import leftovers

IOLSPI = [sys.executable, "-m", "iolspi_ros"]


def wait_for(ready, deadline=120.0):
    end = time.monotonic() + deadline
    while not (found := ready()):
        assert time.monotonic() < end
        time.sleep(0.1)
    return found


def children(pid):
    found = {}
    for place in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = place.read_text().rsplit(")", 1)[1].split()
            command = (place.parent / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if int(fields[1]) == pid and b"iolspi_ros.nodes.start" in command:
            found[command[command.index(b"iolspi_ros.nodes.start") + 1].decode()] = int(
                place.parent.name
            )
    return found


def test_a_killed_learner_is_started_again_and_goes_on(tmp_path, domain):
    out, env = tmp_path / "out", os.environ | {"ROS_DOMAIN_ID": str(domain)}
    command = [*IOLSPI, "up", "--mode", "lockstep", "--out", str(out)]
    process = subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL)
    try:
        wait_for(lambda: (out / "checkpoint.npz").exists())
        os.kill(children(process.pid)["learner"], signal.SIGKILL)
        wait_for(lambda: "resumed from" in (out / "learner.log").read_text())
        process.send_signal(signal.SIGTERM)
        assert process.wait(60.0) == 0
    finally:
        process.kill()


def test_what_is_wrong_with_the_environment_is_said(tmp_path):
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "__init__.py").write_text("raise ImportError('made for another Python')")
    path = f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"
    for env, words in (
        ({"PYTHONPATH": path}, "another ROS stands before"),
        ({"ROS_DOMAIN_ID": "abc"}, "'abc'; allowed: 0 to 232"),
    ):
        for command in (["doctor", "--offline"], ["run", "simulator"]):
            done = subprocess.run(
                [*IOLSPI, *command], env=os.environ | env, capture_output=True, text=True
            )
            said = " ".join((done.stdout + done.stderr).split())
            assert words in said, said
            assert "Traceback" not in said
            assert done.returncode == (1 if command[0] == "doctor" else 2)


def test_only_what_nobody_holds_is_swept(tmp_path):
    segment, port = "fastrtps_0123456789abcdef", "fastrtps_port7411"
    left = {"other_el", "mine", port, f"{port}_el", f"sem.{port}_mutex"}
    for name in (segment, f"{segment}_el", f"sem.{segment}_mutex", *left):
        (tmp_path / name).write_bytes(b"x" * 100)
    assert leftovers.sweep(tmp_path) == 0  # too young
    for path in tmp_path.iterdir():
        os.utime(path, (0, 0))
    hold = "import fcntl, sys, time; f = open(sys.argv[1]); fcntl.flock(f, 1); print(1, flush=True)"
    command = [sys.executable, "-c", f"{hold}; time.sleep(60)", str(tmp_path / f"{segment}_el")]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as holder:
        holder.stdout.readline()
        assert leftovers.sweep(tmp_path) == 0
        holder.kill()
    assert leftovers.sweep(tmp_path) == 300
    assert {path.name for path in tmp_path.iterdir()} == left
