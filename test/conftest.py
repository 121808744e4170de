import contextlib
import os
import signal
import subprocess
import sys
import time

import pytest

from iolspi_ros.graph import free_domain
from iolspi_ros.process import prepare

prepare()  # none of these imports has loaded numpy

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"


class Nodes:
    """Our nodes as processes of one domain."""

    def __init__(self, folder, domain):
        own = {"ROS_DOMAIN_ID": str(domain), "XDG_CACHE_HOME": str(folder / "cache")}
        self.folder, self.env = folder, os.environ | own
        self.processes = {}

    def start(self, node, *arguments, name=None):
        log = (self.folder / f"{name or node}.log").open("wb")
        command = [sys.executable, "-m", "iolspi_ros.nodes.start", node, "--ros-args", *arguments]
        process = subprocess.Popen(command, stdout=log, stderr=log, env=self.env)
        self.processes[name or node] = process
        return process

    def log(self, name):
        return (self.folder / f"{name}.log").read_text()

    def wait_for(self, name, text, deadline=30.0):
        """Until a node has said `text`."""
        end = time.monotonic() + deadline
        while text not in self.log(name):
            assert time.monotonic() < end, f"{name} never said {text!r}:\n{self.log(name)}"
            assert self.processes[name].poll() is None or text in self.log(name), self.log(name)
            time.sleep(0.02)

    def end(self, name, number=signal.SIGINT, deadline=10.0):
        """Exit status, which it must have soon."""
        process = self.processes.pop(name)
        process.send_signal(number)
        try:
            return process.wait(deadline)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()

    def finish(self, node, *arguments, deadline=30.0):
        """Run a node to its own end; exit status and what it said."""
        process = self.start(node, *arguments)
        status = process.wait(deadline)
        del self.processes[node]
        return status, self.log(node)

    def close(self):
        for process in self.processes.values():
            if process.poll() is None:
                process.kill()
            process.wait()


@pytest.fixture
def domain():
    """A ROS domain of this test's own."""
    return free_domain()


@pytest.fixture
def nodes(tmp_path, domain):
    running = Nodes(tmp_path, domain)
    yield running
    running.close()


@pytest.fixture
def ros(domain):
    """rclpy in this process, in the domain of the nodes."""
    import rclpy

    rclpy.init(domain_id=domain)
    yield rclpy
    with contextlib.suppress(Exception):
        rclpy.try_shutdown()


def spin_until(executor, ready, deadline=20.0):
    end = time.monotonic() + deadline
    while not ready():
        assert time.monotonic() < end, "deadline"
        executor.spin_once(timeout_sec=0.05)
