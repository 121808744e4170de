"""The bridge as a node of a graph, flying the embedded autopilot faster than real time."""

import math
import signal
import subprocess
import sys
from dataclasses import replace

import pytest
from conftest import DEADLINE, spin_until
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool

from iolspi_ros import qos, runtime, wire
from iolspi_ros.bench.flying import parameters
from iolspi_ros.bench.worlds import FACTOR
from iolspi_ros.core.online import Source
from iolspi_ros.resources import find
from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.node import AUTHORITY, PREFLIGHT, Bridge
from msg_bridge.mavlink.phases import Phase
from sim_nodes.autopilot.firmware import Mode
from sim_nodes.autopilot.server import Sitl

CONFIG = find("config", "slung_load.yaml")


class Actor:
    """Answers every observation with an action, and listens to who commands."""

    def __init__(self, rclpy):
        self.node = rclpy.create_node("actor")
        self.loop = runtime.Loop(self.node)
        self.action, self.states, self.rewards, self.authority = 1.0, [], [], []
        self.rows = wire.Rows("action", wire.ACTION)
        self.out = self.node.create_publisher(Float64MultiArray, "action", qos.OUTGOING)
        self.joy = self.node.create_publisher(Joy, "joy", qos.CONTROL)
        listen = self.node.create_subscription
        listen(JointState, "state", self.states.append, qos.CONTROL)
        listen(Float64MultiArray, "reward", self.answer, qos.CONTROL)
        listen(Float64MultiArray, "authority", self.heard, qos.REPORTS)
        self.status = {}
        listen(DiagnosticArray, "/diagnostics", self.diagnosed, qos.RECORDING)

    def answer(self, message):
        row = dict(zip(wire.REWARD, message.data, strict=True))
        self.rewards.append(row)
        if self.action is not None:
            key = [row[name] for name in wire.KEY]
            self.out.publish(self.rows.message(*key, self.action, Source.SCRIPTED))

    def heard(self, message):
        self.authority.append(dict(zip(AUTHORITY, message.data, strict=True)))

    def diagnosed(self, message):
        for status in message.status:
            self.status[status.name] = {pair.key: pair.value for pair in status.values}

    def until(self, ready):
        spin_until(self.loop, ready)

    def call(self, kind, name, request):
        client = self.node.create_client(kind, name)
        self.until(client.service_is_ready)
        future = client.call_async(request)
        self.until(future.done)
        return future.result()

    def change(self, transition):
        request = ChangeState.Request()
        request.transition.id = transition
        return self.call(ChangeState, "/bridge/change_state", request).success

    @property
    def state(self):
        return self.call(GetState, "/bridge/get_state", GetState.Request()).current_state.label

    def commands(self, authority):
        """Until somebody has begun to command since this was asked last."""
        seen = len(self.authority)
        self.until(lambda: any(row["authority"] == authority for row in self.authority[seen:]))


@pytest.fixture
def sitl():
    with Sitl(
        "px4", ["udpin:127.0.0.1:0"], parameters("px4", SIM_SPEEDUP=FACTOR), ready_after=2.0
    ) as vehicle:
        yield vehicle


@pytest.fixture
def actor(ros):
    return Actor(ros)


def start(nodes, sitl, *arguments):
    host, port = sitl.addresses[0]
    given = {"url": f"udpout:{host}:{port}", "real_time_factor": FACTOR, "action_timeout": 0.4,
             "initial": "narrow"}  # fmt: skip
    pairs = [part for name, value in given.items() for part in ("-p", f"{name}:={value}")]
    nodes.start("bridge", "--params-file", str(CONFIG), *pairs, *arguments)


def test_it_is_managed_from_preflight_to_landing(nodes, sitl, actor):
    start(nodes, sitl)
    assert actor.state == "unconfigured"
    assert actor.change(Transition.TRANSITION_CONFIGURE)
    assert sitl.autopilot.parameters["COM_OBL_RC_ACT"] == 5
    actor.until(lambda: actor.status.get(PREFLIGHT, {}).get("result") == "passed")
    assert list(actor.status[PREFLIGHT]) == [
        "autopilot", "signed", "identity", "COM_OF_LOSS_T", "COM_OBL_RC_ACT", "position estimate",
        "clock", "release", "load", "result",
    ]  # fmt: skip
    assert actor.status[PREFLIGHT]["load"] == "reported by system 2"
    actor.until(lambda: actor.status.get("bridge", {}).get("phase") == "idle")
    assert not sitl.autopilot.commander.armed
    assert actor.change(Transition.TRANSITION_ACTIVATE)
    actor.until(lambda: len(actor.rewards) > 60)
    first = next(row for row in actor.rewards if row["step"] == 0.0)
    assert (first["reward"], first["action"]) == (0.0, -1.0)
    assert all(row["action"] == 1.0 for row in actor.rewards if row["step"] > 1.0)
    assert list(actor.states[0].name) == ["quadrotor", "load"]
    stamps = [(row["sec"], row["nanosec"]) for row in actor.rewards]
    assert stamps == sorted(set(stamps))
    assert actor.change(Transition.TRANSITION_DEACTIVATE)
    assert not actor.change(Transition.TRANSITION_CLEANUP)  # in the air
    actor.until(lambda: actor.authority[-1]["phase"] == Phase.DOWN)
    assert not sitl.autopilot.commander.armed
    assert actor.change(Transition.TRANSITION_CLEANUP)
    assert sitl.autopilot.parameters["COM_OBL_RC_ACT"] == 0
    assert nodes.end("bridge") == 0


@pytest.mark.slow
def test_a_restarted_autopilot_is_checked_and_flown_again_without_ros2(nodes, sitl, actor, capfd):
    """By `iolspi manage bridge fly`; what it needs set is set again, and given back in the end."""
    start(nodes, sitl, "-p", "autostart:=activate")
    actor.commands(Authority.ACTOR)

    def bridge(what):
        command = [sys.executable, "-m", "iolspi_ros", "manage", "bridge", what]
        run = subprocess.Popen(command, env=nodes.env, stdout=subprocess.PIPE,
                               stderr=subprocess.STDOUT, text=True)  # fmt: skip
        actor.until(lambda: run.poll() is not None)
        return run.returncode, run.stdout.read()

    status, said = bridge("fly")
    assert (status, "in flight" in said) == (2, True), said
    with sitl.lock:
        autopilot = sitl.autopilot
        autopilot.firmware = replace(autopilot.firmware, rates={"HEARTBEAT": 1.0})
        autopilot.parameters["COM_OBL_RC_ACT"] = 0  # as if it had not been written down
        autopilot.boot()
    actor.until(lambda: actor.authority[-1]["phase"] == Phase.DOWN)
    assert bridge("fly") == (0, "bridge: checked; it takes off\n")
    assert autopilot.parameters["COM_OBL_RC_ACT"] == 5
    actor.commands(Authority.ACTOR)
    assert bridge("land")[0] == 0
    actor.until(lambda: actor.authority[-1]["phase"] == Phase.DOWN)
    assert nodes.end("bridge") == 0
    assert autopilot.parameters["COM_OBL_RC_ACT"] == 0


@pytest.mark.slow
def test_in_flight_a_signal_lands_and_gives_the_parameters_back(nodes, sitl, actor):
    start(nodes, sitl, "-p", "autostart:=activate")
    actor.commands(Authority.ACTOR)
    status = nodes.end("bridge")
    assert status == 0
    assert sitl.autopilot.commander.mode is Mode.LAND
    assert sitl.autopilot.parameters["COM_OF_LOSS_T"] == 1.0


@pytest.mark.slow
def test_actions_that_are_none_change_nothing(nodes, sitl, actor):
    """They are as good as silence: neutral, then hold, and on again when one comes that is."""
    start(nodes, sitl, "-p", "autostart:=activate")
    actor.commands(Authority.ACTOR)
    for nonsense in (math.nan, math.inf, 4.0, -1.0, 1.5):
        actor.action = nonsense
        actor.commands(Authority.HOLD)
        actor.action = 1.0
        actor.commands(Authority.ACTOR)
    nodes.wait_for("bridge", "ignored")


@pytest.mark.slow
def test_a_person_takes_over_and_gives_back(nodes, sitl, actor):
    start(nodes, sitl, "-p", "autostart:=activate", "-p", "takeover_button:=0",
          "-p", "deadman_button:=1")  # fmt: skip

    def hold(*buttons, axis=0.0):
        message = Joy(buttons=list(buttons), axes=[axis])
        return actor.node.create_timer(0.05, lambda: actor.joy.publish(message))

    held = hold(0, 1)
    actor.commands(Authority.ACTOR)
    held.cancel()
    actor.commands(Authority.HOLD)  # the deadman's button
    held = hold(1, 1, axis=-1.0)  # to the right
    actor.commands(Authority.PILOT)
    actor.until(lambda: sitl.autopilot.body.truth[1][1] > 1.0)  # east
    held.cancel()
    held = hold(0, 1)
    actor.commands(Authority.ACTOR)


@pytest.mark.slow
def test_it_waits_while_paused(nodes, sitl, actor):
    start(nodes, sitl, "-p", "autostart:=activate")
    actor.commands(Authority.ACTOR)
    assert actor.call(SetBool, "/bridge/pause", SetBool.Request(data=True)).success
    actor.commands(Authority.HOLD)
    assert actor.call(SetBool, "/bridge/pause", SetBool.Request(data=False)).success
    actor.commands(Authority.ACTOR)


@pytest.mark.slow
def test_a_learner_that_is_killed_and_started_again_flies_on(nodes, sitl, actor):
    actor.action = None
    start(nodes, sitl, "-p", "autostart:=activate")
    learner = ("--params-file", str(CONFIG), "-p", "background:=true",
               "-p", "wait_for_demonstrations:=false")  # fmt: skip
    process = nodes.start("learner", *learner)
    actor.commands(Authority.ACTOR)
    process.send_signal(signal.SIGSTOP)
    actor.commands(Authority.HOLD)
    process.send_signal(signal.SIGCONT)
    actor.commands(Authority.ACTOR)
    process.kill()
    process.wait()
    actor.commands(Authority.HOLD)
    nodes.start("learner", *learner)
    actor.commands(Authority.ACTOR)


@pytest.fixture
def finish(monkeypatch, domain):
    """Run the bridge in this process to its own end; its status."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    return lambda *arguments: runtime.main(Bridge, "bridge", ["bridge", "--ros-args", *arguments])


@pytest.mark.parametrize(
    ("argument", "words"),
    [
        ("url:=nowhere", "url is 'nowhere'; allowed:"),
        ("box:=[3.0, -3.0]", "the least first"),
        ("task:=pendulum", "task is 'pendulum'"),
        ("signing_key:=/not/there", "signing key"),
    ],
)
def test_bad_input_is_said_in_one_line(finish, capfd, argument, words):
    assert finish("-p", "autostart:=configure", "-p", argument) == 2
    said = capfd.readouterr().err
    assert words in said.splitlines()[-1]
    assert "Traceback" not in said


def iolspi(nodes, *arguments):
    command = [sys.executable, "-m", "iolspi_ros", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, env=nodes.env, timeout=DEADLINE, check=False
    )


def test_it_says_what_it_waits_for_and_is_managed_without_ros2(nodes, sitl):
    start(nodes, sitl)
    nodes.wait_for("bridge", "waiting for somebody to configure it: iolspi manage bridge configure")
    assert "bridge: unconfigured" in iolspi(nodes, "manage", "bridge").stdout
    done = iolspi(nodes, "manage", "bridge", "configure")
    assert "bridge: inactive" in done.stdout, done.stderr
    nodes.wait_for("bridge", "iolspi manage bridge activate")
    done = iolspi(nodes, "manage", "bridge", "cleanup")
    assert "bridge: unconfigured" in done.stdout, done.stderr
    assert sitl.autopilot.parameters["COM_OF_LOSS_T"] == 1.0
    refused = iolspi(nodes, "manage", "nobody", "activate")
    assert (refused.returncode, "nobody answers /nobody/change_state" in refused.stderr) == (
        2,
        True,
    )
