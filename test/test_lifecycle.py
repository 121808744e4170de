"""Managed nodes: what each state does, and that a refused transition ends nobody."""

import signal

import numpy as np
import pytest
from conftest import Peer
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from iolspi_ros import qos, wire
from iolspi_ros.resources import find
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

TASK = Pendulum.description
SET_5 = find("demos", "pendulum", "set_5")
AT_ONCE = ("-p", "wait_for_demonstrations:=false")
CONFIGURE, ACTIVATE = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE
DEACTIVATE, CLEANUP = Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP
INACTIVE, ACTIVE = State.PRIMARY_STATE_INACTIVE, State.PRIMARY_STATE_ACTIVE
UNCONFIGURED = State.PRIMARY_STATE_UNCONFIGURED


class Manager(Peer):
    """Asks for transitions."""

    def change(self, node, number):
        request = ChangeState.Request(transition=Transition(id=number))
        return self.call(ChangeState, f"/{node}/change_state", request).success

    def state(self, node):
        return self.call(GetState, f"/{node}/get_state", GetState.Request()).current_state.id

    def ask(self, node, number):
        """Ask for a transition; whether there is an answer is not said."""
        client = self.node.create_client(ChangeState, f"/{node}/change_state")
        self.until(client.service_is_ready)
        client.call_async(ChangeState.Request(transition=Transition(id=number)))
        self.spin(0.2)

    def until_state(self, node, wanted):
        while self.state(node) != wanted:
            self.spin(0.05)

    def silent(self, topic, seconds=0.5):
        """Whether nothing new comes on a topic, once what was under way has come."""
        self.spin(0.2)
        before = len(self.heard[topic])
        self.spin(seconds)
        return len(self.heard[topic]) == before

    def more(self, topic, count=5):
        before = len(self.heard[topic])
        self.until(lambda: len(self.heard[topic]) >= before + count)


@pytest.fixture
def manager(ros):
    return Manager(ros)


def test_a_learner_acts_only_while_it_is_active(nodes, manager):
    manager.listen("action", Float64MultiArray)
    nodes.start("learner", *AT_ONCE, "-p", "autostart:=never")
    nodes.start("simulator")
    manager.until_state("learner", UNCONFIGURED)
    assert manager.change("learner", CONFIGURE)
    assert manager.state("learner") == INACTIVE
    assert manager.silent("action")
    assert manager.heard["action"] == []
    assert manager.change("learner", ACTIVATE)
    manager.more("action")
    assert manager.change("learner", DEACTIVATE)
    assert manager.silent("action")
    assert manager.change("learner", ACTIVATE)
    manager.more("action")
    newest = manager.heard["action"][-1].data[:2]
    assert manager.change("learner", DEACTIVATE)
    assert manager.change("learner", CLEANUP)
    assert manager.state("learner") == UNCONFIGURED
    assert manager.change("learner", CONFIGURE)
    assert manager.change("learner", ACTIVATE)
    manager.more("action")
    assert list(manager.heard["action"][-1].data[:2]) > list(newest)  # the vehicle went on
    assert nodes.end("learner") == 0, nodes.log("learner")


def test_a_simulator_moves_only_while_it_is_active(nodes, manager):
    manager.listen("state", JointState)
    nodes.start("simulator", "-p", "autostart:=configure", "-p", "mode:=realtime")
    manager.until_state("simulator", INACTIVE)
    assert manager.silent("state")
    assert manager.heard["state"] == []
    assert manager.change("simulator", ACTIVATE)
    manager.more("state")
    assert manager.change("simulator", DEACTIVATE)
    assert manager.silent("state")
    where = stamp_of(manager.heard["state"][-1])
    assert manager.change("simulator", ACTIVATE)
    manager.more("state")
    after = [stamp_of(m) for m in manager.heard["state"] if stamp_of(m) > where]
    assert after[0] - where == 5_000_000  # it stood still meanwhile
    assert manager.change("simulator", DEACTIVATE)
    assert manager.change("simulator", CLEANUP)
    assert manager.change("simulator", CONFIGURE)
    assert manager.change("simulator", ACTIVATE)
    manager.more("state")
    assert nodes.end("simulator", signal.SIGTERM) == 0, nodes.log("simulator")


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def test_a_demonstrator_pauses_and_goes_on(nodes, manager, tmp_path):
    manager.listen("sample", Float64MultiArray, qos.SAMPLES)
    nodes.start("simulator")
    nodes.start("demonstrator", "-p", "source:=scripted", "-p", "episodes:=1000")
    manager.more("sample", 20)
    assert manager.change("demonstrator", DEACTIVATE)
    assert manager.silent("sample")
    assert manager.change("demonstrator", ACTIVATE)
    manager.more("sample", 20)
    keys = [tuple(m.data[:2]) for m in manager.heard["sample"]]
    assert keys == sorted(set(keys))  # none twice
    assert manager.change("demonstrator", DEACTIVATE)
    assert manager.change("demonstrator", CLEANUP)
    assert manager.change("demonstrator", CONFIGURE)
    assert manager.change("demonstrator", ACTIVATE)
    manager.more("sample", 20)
    assert nodes.end("demonstrator") == 0, nodes.log("demonstrator")


@pytest.mark.parametrize("node", ["simulator", "learner", "demonstrator"])
def test_a_refused_transition_ends_nobody(nodes, manager, node):
    if node != "simulator":
        manager.be_vehicle(TASK)
    nodes.start(node, *{"demonstrator": ["-p", f"bags:=[{SET_5}]"]}.get(node, AT_ONCE))
    manager.until_state(node, ACTIVE)
    for wrong in (CONFIGURE, ACTIVATE, CLEANUP, 77):
        manager.ask(node, wrong)
        assert manager.state(node) == ACTIVE
    assert nodes.processes[node].poll() is None
    assert "Traceback" not in nodes.log(node)
    assert manager.change(node, DEACTIVATE)
    assert nodes.end(node) == 0, nodes.log(node)


def test_a_configuration_that_is_refused_can_be_mended(nodes, manager, tmp_path):
    taken, free = tmp_path / "c.npz", tmp_path / "d.npz"
    taken.mkdir()
    nodes.start("learner", "-p", "autostart:=never", "-p", f"checkpoint:={taken}")
    manager.until_state("learner", UNCONFIGURED)
    assert not manager.change("learner", CONFIGURE)
    nodes.wait_for("learner", f"checkpoint {taken}")
    assert manager.state("learner") == UNCONFIGURED
    assert manager.set("learner", checkpoint=str(free))[0].successful
    assert manager.change("learner", CONFIGURE)
    assert manager.state("learner") == INACTIVE
    assert nodes.end("learner") == 0


# ---------------------------------------------------------------- one task, one vehicle


def diagnosed(manager):
    """What the learner says of itself, newest last: level, message, values."""
    return [
        (s.level, s.message, {v.key: v.value for v in s.values})
        for m in manager.heard["/diagnostics"] for s in m.status
        if s.name == "learner: learning"
    ]  # fmt: skip


def test_two_vehicles_that_contradict_each_other_teach_nothing(nodes, manager):
    manager.listen("action", Float64MultiArray)
    manager.listen("update", Float64MultiArray, qos.REPORTS)
    manager.listen("/diagnostics", DiagnosticArray, qos.OUTGOING)
    nodes.start("simulator")
    nodes.start("learner", *AT_ONCE, "-p", "update_interval:=20")
    manager.more("action", 50)
    manager.be_vehicle(SlungLoad.description)
    manager.until(lambda: diagnosed(manager)[-1:] and diagnosed(manager)[-1][0] == b"\x02")
    text = diagnosed(manager)[-1][1]
    assert "name is 'pendulum' here and 'slung_load' there" in text
    assert "sampling_time is 0.005 here and 0.1 there" in text
    assert "here: the vehicle; there: another message on /task" in text
    assert manager.silent("action")
    assert manager.silent("update")
    assert nodes.processes["learner"].poll() is None
    assert nodes.end("learner") == 0


def test_a_description_that_is_none_is_told(nodes, manager):
    manager.listen("/diagnostics", DiagnosticArray, qos.OUTGOING)
    publisher = manager.be_vehicle(TASK)
    message = wire.task_message(TASK)
    message.data = "{'name': "
    publisher.publish(message)
    nodes.start("learner", *AT_ONCE)
    manager.until(lambda: diagnosed(manager)[-1:] and diagnosed(manager)[-1][0] == b"\x02")
    assert "topic /task is no YAML" in diagnosed(manager)[-1][1]
    assert nodes.end("learner") == 0


def test_the_same_task_from_two_vehicles_is_one_task(nodes, manager):
    manager.listen("action", Float64MultiArray)
    manager.be_vehicle(TASK)
    nodes.start("simulator")
    nodes.start("learner", *AT_ONCE)
    manager.more("action", 20)


# ---------------------------------------------------------------- namespaces


def clocks(manager, seconds=1.0):
    manager.listen("/clock", Clock)
    manager.spin(seconds)
    return len(manager.heard["/clock"])


@pytest.mark.parametrize(
    ("arguments", "ticks"),
    [((), True), (("-r", "__ns:=/v1"), False), (("-p", "mode:=realtime"), False),
     (("-r", "__ns:=/v1", "-p", "publish_clock:=always"), True),
     (("-p", "publish_clock:=never"), False)],
)  # fmt: skip
def test_only_a_lockstep_vehicle_of_the_root_namespace_gives_the_time(
    nodes, manager, arguments, ticks
):
    nodes.start("simulator", *arguments)
    nodes.wait_for("simulator", "actions are heard on")
    manager.listen("/clock", Clock)
    manager.listen("v1/state" if "__ns:=/v1" in arguments else "state", JointState)
    manager.more("v1/state" if "__ns:=/v1" in arguments else "state", 5)
    if ticks:
        manager.more("/clock", 2)
    assert bool(manager.heard["/clock"]) == ticks


RENAMES = [("/v1", None), ("/a/b", "quad"), ("", "quad")]


@pytest.mark.parametrize(("namespace", "name"), RENAMES)
def test_the_shipped_file_flies_its_task_in_any_namespace_under_any_name(
    nodes, manager, namespace, name
):
    config = find("config", "slung_load.yaml")
    more = ["-r", f"__ns:={namespace}"] if namespace else []

    def renamed(node):
        return more + (["-r", f"__node:={name}_{node}"] if name else [])

    for topic in ("state", "weights"):
        kind = JointState if topic == "state" else Float64MultiArray
        manager.listen(f"{namespace}/{topic}", kind, qos.REPORTS if topic == "weights" else 10)
    nodes.start("simulator", "--params-file", str(config), *renamed("simulator"))
    nodes.start("learner", "--params-file", str(config), *AT_ONCE, *renamed("learner"))
    manager.until(lambda: manager.heard[f"{namespace}/state"])
    manager.until(lambda: manager.heard[f"{namespace}/weights"])
    assert list(manager.heard[f"{namespace}/state"][0].name) == ["quadrotor", "load"]
    weights, _ = wire.read_weights(manager.heard[f"{namespace}/weights"][0])
    assert weights.shape == (4, 5 * 4 * 7 * 4)  # the file's centres
    assert f"slung_load in lockstep; actions are heard on {namespace}/action" in nodes.log(
        "simulator"
    )


# ---------------------------------------------------------------- services while it learns


def test_while_it_learns_offline_nothing_is_loaded_or_saved(nodes, manager, tmp_path):
    path = tmp_path / "c.npz"
    manager.be_vehicle(TASK)
    nodes.start("learner", "-p", "centers:=[21, 21]", "-p", "algorithm:=literal", "-p", "chi:=0.0",
                "-p", "max_iterations:=100000", "-p", f"checkpoint:={path}",
                "-p", "vehicle_timeout:=0.0")  # fmt: skip
    nodes.start("demonstrator", "-p", f"bags:=[{SET_5}]")
    nodes.wait_for("learner", "learning offline from 6300")
    for service in ("load", "save", "learn_offline"):
        answer = manager.call(Trigger, f"/learner/{service}", Trigger.Request())
        assert not answer.success
        assert answer.message == (
            "it is learning from demonstrations; allowed: when that has ended"
        )
    assert not path.exists()
    assert nodes.end("learner") == 0


def test_it_learns_offline_again_when_asked(nodes, manager):
    manager.listen("update", Float64MultiArray, qos.REPORTS)
    samples = manager.publisher("sample", Float64MultiArray, qos.SAMPLES)
    nodes.start("learner", *AT_ONCE, "-p", "vehicle_timeout:=0.0")
    answer = manager.call(Trigger, "/learner/learn_offline", Trigger.Request())
    assert (answer.success, answer.message) == (False, "no vehicle was heard yet on /task")
    manager.be_vehicle(TASK)
    nodes.wait_for("learner", "acting on")
    answer = manager.call(Trigger, "/learner/learn_offline", Trigger.Request())
    assert (answer.success, "brought no sample" in answer.message) == (False, True)
    manager.until(samples.get_subscription_count)
    rows = wire.Rows("sample", wire.sample_names(TASK.names))
    rng = np.random.default_rng(0)
    for k in range(30):
        a, b, c, d = rng.uniform(-1.0, 1.0, 4)
        samples.publish(rows.message(0, k, 0, k, a, b, k % 3, -1.0, c, d, 0, 0, 2))
    counted = 0

    def learned():
        nonlocal counted
        reply = manager.call(Trigger, "/learner/learn_offline", Trigger.Request())
        counted = max(counted, int(reply.message.split()[0]) if reply.success else 0)
        return any(m.data[4] == 0.0 and m.data[10] >= 30 for m in manager.heard["update"])

    manager.until(learned)
    assert counted == 30
    assert nodes.end("learner") == 0
