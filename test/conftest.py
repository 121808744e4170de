"""What every test has: a numba cache of this run, hypothesis' profiles, nodes, and a graph."""

import contextlib
import importlib
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import pytest
from chromium import LACKING
from hypothesis import HealthCheck, settings

from iolspi_ros.graph import own_domain
from iolspi_ros.nodes.start import NODES
from iolspi_ros.process import prepare

MADE_CACHE = "PYTEST_XDIST_WORKER" not in os.environ and "NUMBA_CACHE_DIR" not in os.environ
if MADE_CACHE:  # empty at first: what was compiled before the code changed is in nobody's way
    os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp(prefix="iolspi-numba-")

prepare()  # none of these imports has loaded numpy or numba

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"

# The machine may be busy with anything, so no example has a deadline.
SLOW_ONES = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture]
settings.register_profile("quick", deadline=None, suppress_health_check=SLOW_ONES)
settings.register_profile("thorough", parent=settings.get_profile("quick"), max_examples=500)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "quick"))


DEADLINE = 120.0  # of what takes a second or two; a busy machine may take many times as long

ENDS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
for _number in ENDS:  # a shell's background job ignores some, and every child would inherit that
    signal.signal(
        _number, signal.SIG_DFL if _number != signal.SIGINT else signal.default_int_handler
    )


@pytest.fixture(autouse=True)
def as_it_was():
    """A ROS domain for each test, and no variable and no signal changed by those before it."""
    environment, handlers = dict(os.environ), [signal.getsignal(number) for number in ENDS]
    with own_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        yield
    os.environ.clear()
    os.environ.update(environment)
    for number, handler in zip(ENDS, handlers, strict=True):
        signal.signal(number, handler)


def pytest_terminal_summary(terminalreporter):
    if LACKING:
        terminalreporter.write_line(f"The cockpit's page was not tested in a browser: {LACKING}")


def pytest_unconfigure():
    if MADE_CACHE:
        shutil.rmtree(os.environ["NUMBA_CACHE_DIR"], ignore_errors=True)


class Nodes:
    """Our nodes as processes of one domain."""

    def __init__(self, folder, domain):
        own = {"ROS_DOMAIN_ID": str(domain), "XDG_CACHE_HOME": str(folder / "cache"),
               "XDG_STATE_HOME": str(folder / "state")}  # fmt: skip
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

    def logs(self):
        """The end of what each has said, for messages."""
        return "\n".join(
            f"--- {path.stem}:\n{path.read_text()[-2000:]}" for path in self.folder.glob("*.log")
        )

    def wait_for(self, name, text, deadline=DEADLINE):
        """Until a node has said `text`."""
        end = time.monotonic() + deadline
        while text not in self.log(name):
            assert time.monotonic() < end, f"{name} never said {text!r}:\n{self.logs()}"
            assert self.processes[name].poll() is None or text in self.log(name), self.log(name)
            time.sleep(0.02)

    def end(self, name, number=signal.SIGINT, deadline=30.0):
        """Exit status, which it must have soon."""
        process = self.processes.pop(name)
        process.send_signal(number)
        try:
            return process.wait(deadline)
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()
            if process.returncode:
                print(f"{name} ended with {process.returncode}")

    def finish(self, node, *arguments, deadline=DEADLINE):
        """Run a node to its own end; exit status and what it said."""
        process = self.start(node, *arguments)
        status = process.wait(deadline)
        del self.processes[node]
        return status, self.log(node)

    def close(self):
        for process in self.processes.values():
            process.kill()
            process.wait()
        print(self.logs())  # shown with a test that failed


@pytest.fixture
def domain():
    """A ROS domain of this test's own."""
    return int(os.environ["ROS_DOMAIN_ID"])


@pytest.fixture
def nodes(tmp_path, domain):
    running = Nodes(tmp_path, domain)
    yield running
    running.close()


@pytest.fixture
def ros(domain, monkeypatch):
    """rclpy in this process, in the domain of the nodes; no node made there outlives the test."""
    import rclpy

    from iolspi_ros import runtime

    made, loops, create, begin = [], [], rclpy.create_node, runtime.Loop.__init__
    monkeypatch.setattr(
        rclpy, "create_node", lambda *a, **k: made.append(create(*a, **k)) or made[-1]
    )
    monkeypatch.setattr(
        runtime.Loop, "__init__", lambda loop, *a, **k: loops.append(loop) or begin(loop, *a, **k)
    )
    rclpy.init(domain_id=domain)
    yield rclpy
    for loop in loops:  # first: what wakes an executor must not come from a node that is gone
        with contextlib.suppress(Exception):
            loop.close()
    for node in made:
        with contextlib.suppress(Exception):
            node.destroy_node()
    with contextlib.suppress(Exception):
        rclpy.try_shutdown()


def spin_until(loop, ready, deadline=DEADLINE):
    end = time.monotonic() + deadline
    while not ready():
        assert time.monotonic() < end, "deadline"
        loop.once(0.05)


class Peer:
    """A node in this process that listens and talks; also in a vehicle's place."""

    def __init__(self, rclpy):
        from iolspi_ros import runtime

        self.node = rclpy.create_node("peer")
        self.loop = runtime.Loop(self.node)
        self.heard = {}

    def listen(self, topic, kind, profile=10):
        self.heard[topic] = []
        self.node.create_subscription(kind, topic, self.heard[topic].append, profile)

    def publisher(self, topic, kind, profile=10):
        return self.node.create_publisher(kind, topic, profile)

    def be_vehicle(self, task):
        """Say what the task is; the publisher lives as long as the peer."""
        from std_msgs.msg import String

        from iolspi_ros import qos, wire

        publisher = self.publisher("task", String, qos.LATCHED)
        publisher.publish(wire.task_message(task))
        return publisher

    def until(self, ready, deadline=DEADLINE):
        try:
            spin_until(self.loop, ready, deadline)
        except AssertionError:
            for topic, heard in self.heard.items():
                print(f"heard on {topic}: {len(heard)}, last {heard[-3:]}")
            raise

    def spin(self, seconds):
        """Listen for so long, whatever comes."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.loop.once(0.05)

    def call(self, kind, name, request):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def set(self, node, **values):
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        request = SetParameters.Request()
        request.parameters = [Parameter(k, value=v).to_parameter_msg() for k, v in values.items()]
        return self.call(SetParameters, f"/{node}/set_parameters", request).results


@pytest.fixture
def run_here(domain, monkeypatch, capfd):
    """Run a node in this process to its own end; its exit status and what it said."""

    def run(node, *arguments):
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setattr(sys, "argv", [node, "--ros-args", *map(str, arguments)])
        capfd.readouterr()
        status = importlib.import_module(NODES[node]).main()
        said = capfd.readouterr()
        return status, said.out + said.err

    return run


@pytest.fixture
def vehicle(domain):
    """Say in the domain what a vehicle's task is, on a node that nobody has to spin."""
    import rclpy
    from rclpy.node import Node
    from std_msgs.msg import String

    from iolspi_ros import qos, wire

    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    node = Node("vehicle", context=context, use_global_arguments=False)

    def say(task, topic="task"):
        publisher = node.create_publisher(String, topic, qos.LATCHED)
        publisher.publish(wire.task_message(task))
        return publisher

    yield say
    node.destroy_node()
    rclpy.try_shutdown(context=context)
