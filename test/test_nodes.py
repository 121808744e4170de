"""Single nodes from outside: services, signals, bad input, sticks and clocks."""

import array
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import Peer
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from iolspi_ros import bags, qos, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings
from iolspi_ros.resources import find
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

SET_5 = find("demos", "pendulum", "set_5")
CONFIG = find("config", "pendulum.yaml")
TASK = Pendulum.description
STATES = wire.states(TASK)
AT_ONCE = ("-p", "wait_for_demonstrations:=false")


@pytest.fixture
def peer(ros):
    return Peer(ros)


# ---------------------------------------------------------------- simulator


def test_the_simulator_waits_repeats_and_moves_in_lockstep(nodes, peer):
    peer.listen("state", JointState)
    peer.listen("reward", Float64MultiArray)
    peer.listen("/clock", Clock)
    act = peer.publisher("action", Float64MultiArray)
    nodes.start("simulator", "--params-file", str(CONFIG))
    peer.until(lambda: len(peer.heard["state"]) >= 3)  # it repeats the same state
    first = peer.heard["state"][0]
    assert all(m == first for m in peer.heard["state"])
    rows = wire.Rows("action", wire.ACTION)
    for wrong in ((0, 1, 0, 0, 1, 0), (1, 0, 0, 0, 1, 0), (0, 0, 0, 0, 7, 0)):
        act.publish(rows.message(*wrong))
    act.publish(Float64MultiArray(data=array.array("d", [1.0])))
    peer.until(lambda: "1 ignored" in nodes.log("simulator"))
    act.publish(rows.message(0, 0, 0, 0, 2, Source.HUMAN))
    peer.until(lambda: any(m.data[1] == 1.0 for m in peer.heard["reward"]))
    last = peer.heard["reward"][-1].data
    assert list(last[:2]) == [0.0, 1.0]
    assert last[7] == 2.0
    stamps = [m.clock.sec * 10**9 + m.clock.nanosec for m in peer.heard["/clock"]]
    assert stamps == sorted(stamps)
    assert nodes.end("simulator") == 0


def fly(peer, steps):
    """Answer `steps` observations with no torque; the states seen, by key."""
    rows, states, done = wire.Rows("action", wire.ACTION), {}, {"steps": 0}
    act = peer.publisher("action", Float64MultiArray)
    by_stamp = {}

    def take_state(m):
        by_stamp[m.header.stamp.sec, m.header.stamp.nanosec] = (m.position[0], m.velocity[0])

    def take_reward(m):
        stamp, key = (m.data[2], m.data[3]), (int(m.data[0]), int(m.data[1]))
        if stamp not in by_stamp or key in states or done["steps"] >= steps:
            return
        states[key] = by_stamp[stamp]
        done["steps"] += 1
        act.publish(rows.message(*m.data[:4], 1, Source.HUMAN))

    subscriptions = [
        peer.node.create_subscription(JointState, "state", take_state, qos.CONTROL),
        peer.node.create_subscription(Float64MultiArray, "reward", take_reward, qos.CONTROL),
    ]
    peer.until(lambda: done["steps"] >= steps)
    for subscription in subscriptions:
        peer.node.destroy_subscription(subscription)
    return states


def test_reset_takes_the_seed_and_pause_stops(nodes, peer):
    nodes.start("simulator", "-p", "seed:=5")
    first = fly(peer, 320)
    assert all(result.successful for result in peer.set("simulator", seed=5))
    answer = peer.call(Trigger, "/simulator/reset", Trigger.Request())
    assert answer.success
    assert "seed 5" in answer.message
    second = fly(peer, 320)
    episode = max(key[0] for key in first) + 1
    assert [first[k] for k in sorted(first)] == [second[k] for k in sorted(second)]
    assert min(key[0] for key in second) == episode  # episode numbers only grow
    refused = peer.set("simulator", g=-1.0)[0]
    assert not refused.successful
    assert "g" in refused.reason
    peer.call(SetBool, "/simulator/pause", SetBool.Request(data=True))
    peer.listen("state", JointState)
    end = time.monotonic() + 0.4
    peer.until(lambda: time.monotonic() > end)
    assert peer.heard["state"] == []
    peer.call(SetBool, "/simulator/pause", SetBool.Request(data=False))
    peer.until(lambda: peer.heard["state"])


def test_in_real_time_nobody_is_waited_for(nodes, peer):
    peer.listen("reward", Float64MultiArray)
    nodes.start("simulator", "-p", "mode:=realtime", "-p", "real_time_factor:=5.0")
    peer.until(lambda: any(m.data[6] for m in peer.heard["reward"]))  # an episode ran out
    actions = {m.data[7] for m in peer.heard["reward"] if m.data[1] > 0}
    assert actions == {1.0}  # neutral all the way


def test_whoever_looks_sees_the_vehicle_and_what_it_drops(nodes, peer):
    peer.listen("state", JointState)
    peer.listen("markers", MarkerArray)
    act = peer.publisher("action", Float64MultiArray)
    config = find("config", "slung_load.yaml")
    nodes.start("simulator", "--params-file", str(config))
    peer.until(lambda: peer.heard["state"] and peer.heard["markers"])
    markers = {marker.ns: marker for marker in peer.heard["markers"][0].markers}
    state, stamp = peer.heard["state"][0], markers["load"].header.stamp
    assert (state.header.stamp, markers["load"].header.frame_id) == (stamp, "world")
    x, angle = state.position
    assert markers["quadrotor"].pose.position.x == x
    load = markers["load"].pose.position
    assert (load.x, load.z) == pytest.approx((x + np.sin(angle), -np.cos(angle)))
    assert [p.x for p in markers["cable"].points] == pytest.approx([x, load.x])
    assert all(m.action == Marker.ADD and m.color.a > 0 and m.scale.x > 0 for m in markers.values())
    assert "fall" not in markers
    act.publish(wire.Rows("action", wire.ACTION).message(0, 0, *stamp_of(state), 3, Source.HUMAN))
    peer.until(lambda: any(m.ns == "fall" for a in peer.heard["markers"] for m in a.markers))
    last = peer.heard["markers"][-1].markers[-1]
    assert last.ns == "fall"
    assert (last.points[0].x, last.points[0].z) == pytest.approx((load.x, load.z))
    assert last.points[-1].z < last.points[0].z


def stamp_of(message):
    return message.header.stamp.sec, message.header.stamp.nanosec


# ---------------------------------------------------------------- learner


def test_learning_in_real_time_with_solves_beside(nodes, peer):
    peer.listen("score", Float64MultiArray, qos.OUTGOING)
    peer.listen("update", Float64MultiArray, qos.OUTGOING)
    peer.listen("/diagnostics", DiagnosticArray, qos.OUTGOING)
    nodes.start("simulator", "-p", "mode:=realtime", "-p", "real_time_factor:=2.0")
    nodes.start(
        "learner", *AT_ONCE, "-p", "background:=true", "-p", "update_interval:=100",
        "-p", "delta:=1.0", "-p", "centers:=[11,11]",
    )  # fmt: skip
    peer.until(lambda: len(peer.heard["score"]) >= 2 and len(peer.heard["update"]) >= 3)
    rows = wire.Rows("update", wire.UPDATE)
    updates = [rows.read_all(m) for m in peer.heard["update"]]
    first = updates[0]["number"]
    assert [u["number"] for u in updates] == [first + k for k in range(len(updates))]
    assert all(u["status"] == 0 and u["rank"] == 363 and u["residual"] < 1e-6 for u in updates)
    assert all(u["epsilon"] == 0.2 and u["weights_norm"] > 0 for u in updates)

    def phase():
        found = [s for m in peer.heard["/diagnostics"] for s in m.status]
        said = [{v.key: v.value for v in s.values} for s in found if s.name.startswith("learner")]
        return said and said[-1]["phase"] == "learning"

    peer.until(phase)
    assert nodes.end("learner", signal.SIGTERM) == 0


def test_learning_can_be_turned_off_saved_and_loaded(nodes, peer, tmp_path):
    path = tmp_path / "c.npz"
    peer.listen("action", Float64MultiArray)
    peer.listen("score", Float64MultiArray, qos.OUTGOING)
    nodes.start("learner", *AT_ONCE, "-p", f"checkpoint:={path}", "-p", "epsilon:=1.0")
    nodes.start("simulator")
    both = {Source.EXPLORE, Source.HOLD}
    peer.until(lambda: {m.data[5] for m in peer.heard["action"]} >= both)
    assert {m.data[5] for m in peer.heard["action"]} == both
    assert peer.call(SetBool, "/learner/learn", SetBool.Request(data=False)).success
    n = len(peer.heard["score"])
    peer.until(lambda: len(peer.heard["score"]) >= n + 2)
    episode = peer.heard["score"][-1].data[0]
    sources = {m.data[5] for m in peer.heard["action"] if m.data[0] == episode}
    assert sources - {Source.HOLD} == {Source.EXPLOIT}
    assert peer.call(Trigger, "/learner/save", Trigger.Request()).success
    assert path.is_file()
    assert peer.call(Trigger, "/learner/load", Trigger.Request()).success
    path.write_bytes(b"nonsense")
    answer = peer.call(Trigger, "/learner/load", Trigger.Request())
    assert not answer.success
    assert "damaged" in answer.message
    assert not peer.set("learner", epsilon=2.0)[0].successful
    assert not peer.set("learner", gamma=1.0)[0].successful
    assert not peer.set("learner", seed=4)[0].successful  # read-only
    assert peer.set("learner", epsilon=0.5)[0].successful


def test_states_that_are_no_numbers_are_counted_and_the_graph_goes_on(nodes, peer):
    peer.listen("action", Float64MultiArray)
    peer.listen("/diagnostics", DiagnosticArray, qos.OUTGOING)
    state_out = peer.publisher("state", JointState)
    reward_out = peer.publisher("reward", Float64MultiArray)
    peer.be_vehicle(TASK)
    nodes.start("learner", *AT_ONCE)
    peer.until(lambda: state_out.get_subscription_count() and reward_out.get_subscription_count())
    rows = wire.RewardRows()
    observations = [
        Observation(0, 0, np.array([1.0, 0.0])),
        Observation(0, 1, np.array([np.nan, 0.0]), -1.0, 2),
        Observation(0, 2, np.array([1.0, 0.0]), np.inf, 0),
        Observation(0, 3, np.array([1.0, 0.0]), -1.0, 0),
    ]
    for k, o in enumerate(observations):
        stamp = (k + 1) * 5_000_000

        def answered(k=k, o=o, stamp=stamp):
            state_out.publish(STATES.of(o._replace(stamp=stamp)))
            reward_out.publish(rows.of(o._replace(stamp=stamp)))
            return any(m.data[1] == k for m in peer.heard["action"])

        peer.until(answered)
    answers = {m.data[1]: (m.data[4], m.data[5]) for m in peer.heard["action"]}
    assert answers[1] == (2.0, Source.HOLD)  # the action before goes on
    assert answers[2][1] in (Source.EXPLOIT, Source.EXPLORE)

    def counted():
        values = [v for m in peer.heard["/diagnostics"] for v in m.status[0].values]
        found = {v.key: v.value for v in values}
        dropped = found.get("transitions dropped")
        return dropped == "2" and int(found["messages ignored"]) >= 2

    peer.until(counted)


def test_a_demonstration_of_no_numbers_is_refused_and_another_awaited(nodes, peer):
    sample_out = peer.publisher("sample", Float64MultiArray, qos.SAMPLES)
    demonstration_out = peer.publisher("demonstration", Float64MultiArray, qos.LATCHED)
    peer.be_vehicle(TASK)
    nodes.start("learner", "-p", "vehicle_timeout:=0.0")
    peer.until(lambda: sample_out.get_subscription_count())
    rows, ends = wire.SampleRows(TASK.names), wire.Rows("demonstration", wire.DEMONSTRATION)
    for k, reward in enumerate([np.nan] * 5 + [-1.0] * 5):
        t = Transition(np.array([0.1 * k, 0.0]), 1, reward, np.zeros(2))
        sample_out.publish(rows.of(Sample(0, k, k, t, 4)))
        if k == 4:
            demonstration_out.publish(ends.message(0, k, 0, 0, False, 5))
            nodes.wait_for("learner", "none of 5 demonstrated transitions is usable")
    demonstration_out.publish(ends.message(0, 9, 0, 0, False, 5))
    nodes.wait_for("learner", "acting on")


def test_a_learner_interrupted_while_learning_offline_ends_soon_and_saves(nodes, peer, tmp_path):
    path = tmp_path / "c.npz"
    peer.be_vehicle(TASK)
    nodes.start(
        "learner", "-p", "centers:=[21, 21]", "-p", "chi:=0.0", "-p", "max_iterations:=100000",
        "-p", f"checkpoint:={path}",
    )  # fmt: skip
    nodes.start("demonstrator", "-p", f"bags:=[{SET_5}]")
    nodes.wait_for("learner", "learning offline from 6300")
    status = nodes.end("learner", signal.SIGINT)
    assert (status, path.is_file()) == (0, True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_waiting_nodes_end_at_once(nodes, number):
    nodes.start("simulator")
    nodes.start("learner")
    nodes.start("demonstrator", "-p", f"bags:=[{SET_5}]", "-p", "learner_timeout:=0.0",
                "-r", "sample:=nobody/listens")  # fmt: skip
    nodes.wait_for("demonstrator", "6300 samples")
    for name in list(nodes.processes):
        status = nodes.end(name, number)
        assert status == 0, nodes.log(name)
        assert "Traceback" not in nodes.log(name)


@pytest.mark.parametrize("delay", [0.4, 0.7, 1.0, 1.4])
def test_signals_twice_and_at_any_time_end_a_node_quietly(nodes, delay):
    """As `ros2 launch` sends them: to the process group, and once more itself."""
    nodes.start("simulator")
    nodes.start("learner", *AT_ONCE)
    nodes.wait_for("learner", "")
    time.sleep(delay)  # not a wait for anything: the moment is what is tried
    for process in nodes.processes.values():
        process.send_signal(signal.SIGINT)
    for name in list(nodes.processes):
        status = nodes.end(name, signal.SIGINT)
        said = nodes.log(name)
        assert "Traceback" not in said
        assert status == 0 or (status, said) == (-signal.SIGINT, "")  # before our first line


def test_what_cannot_change_while_it_runs_is_refused_and_says_so(nodes, peer):
    nodes.start("simulator")
    for name, value in (("task", "slung_load"), ("mode", "realtime"), ("episodes", -1)):
        result = peer.set("simulator", **{name: value})[0]
        assert not result.successful, name
        assert name in result.reason or "read" in result.reason.lower(), result.reason
    assert peer.set("simulator", episodes=3)[0].successful


def test_a_simulator_that_starts_anew_is_answered_again(nodes, peer):
    peer.listen("score", Float64MultiArray, qos.REPORTS)
    nodes.start("learner", *AT_ONCE)
    nodes.start("simulator", "-p", "seed:=1")
    peer.until(lambda: len(peer.heard["score"]) >= 3)
    nodes.end("simulator", signal.SIGKILL)
    nodes.start("simulator", "-p", "seed:=2")
    nodes.wait_for("learner", "the vehicle has started anew")
    peer.until(lambda: [m.data[0] for m in peer.heard["score"]].count(0.0) >= 2)  # of both runs
    peer.until(lambda: peer.heard["score"][-1].data[0] >= 2.0)


# ---------------------------------------------------------------- demonstrator


def test_a_stopped_learner_makes_the_demonstrator_wait_and_nothing_is_lost(nodes, peer):
    peer.be_vehicle(TASK)
    learner = nodes.start("learner", "-p", "vehicle_timeout:=0.0")
    nodes.start("demonstrator", "-p", f"bags:=[{SET_5}, {SET_5}]")
    nodes.wait_for("demonstrator", "6300 samples")
    learner.send_signal(signal.SIGSTOP)
    try:
        time.sleep(3.0)  # far longer than DDS itself would wait
    finally:
        learner.send_signal(signal.SIGCONT)
    nodes.wait_for("learner", "learning offline from 12600 demonstrated samples")
    assert "lost" not in nodes.log("learner")


def test_a_stick_makes_samples_of_a_person(nodes, peer, tmp_path):
    peer.listen("sample", Float64MultiArray, qos.SAMPLES)
    peer.listen("reward", Float64MultiArray, qos.RECORDING)
    joy_out = peer.publisher("joy", Joy)
    nodes.start("simulator")
    nodes.start(
        "demonstrator", "-p", "source:=joy", "-p", "episodes:=1", "-p", "joy_buttons:=[-1, 1]",
        "-p", f"record:={tmp_path / 'bag'}", "-p", "joy_timeout:=60.0", "-p", "countdown:=0.0",
    )  # fmt: skip
    rows, sent = wire.SampleRows(TASK.names), []

    def steer():
        step = max((m.data[1] for m in peer.heard["reward"]), default=0.0)
        left = len(sent) % 2 if step == 0.0 else step < 100
        sent.append(Joy(axes=[1.0 if left else -1.0], buttons=[0, int(step >= 200)]))
        joy_out.publish(sent[-1])
        return len(peer.heard["sample"]) >= 300

    peer.until(steer)
    nodes.wait_for("demonstrator", "demonstration ended: 300 samples")
    assert "waiting for a joystick" in nodes.log("demonstrator")
    found = [rows.sample(m) for m in peer.heard["sample"]]
    assert {s.source for s in found} == {Source.HUMAN}
    assert {s.transition.action for s in found} >= {0, 2}
    assert found[-1].transition.truncated
    card = bags.read_card(tmp_path / "bag")
    assert card["pilot"] == "a person with a joystick"


def test_a_killed_demonstrator_leaves_what_it_recorded(nodes, peer, tmp_path):
    peer.listen("sample", Float64MultiArray, qos.SAMPLES)
    nodes.start("simulator")
    flown = ("-p", "source:=scripted", "-p", "episodes:=500")  # longer than any discovery
    nodes.start("demonstrator", *flown, "-p", f"record:={tmp_path / 'bag'}")
    peer.until(lambda: len(peer.heard["sample"]) >= 500)
    nodes.end("demonstrator", signal.SIGKILL)
    found = bags.read_demonstration(tmp_path / "bag", TASK)
    assert len(found.samples) >= 500
    assert "was not closed" in found.notes[0]


def test_a_stopped_demonstrator_closes_its_bag(nodes, peer, tmp_path):
    peer.listen("sample", Float64MultiArray, qos.SAMPLES)
    nodes.start("simulator")
    flown = ("-p", "source:=scripted", "-p", "episodes:=500")  # longer than any discovery
    nodes.start("demonstrator", *flown, "-p", f"record:={tmp_path / 'bag'}")
    peer.until(lambda: len(peer.heard["sample"]) >= 100)
    status = nodes.end("demonstrator", signal.SIGTERM)
    assert status == 0
    found = bags.read_demonstration(tmp_path / "bag", TASK)
    assert found.notes == []
    assert found.card["samples"] == len(found.samples) >= 100


def test_a_replay_can_keep_the_recorded_time(nodes, peer):
    """31.6 s of vehicle time at twenty times the speed: never faster than that."""
    peer.be_vehicle(TASK)
    peer.listen("sample", Float64MultiArray, qos.SAMPLES)
    peer.listen("demonstration", Float64MultiArray, qos.LATCHED)
    nodes.start("demonstrator", "-p", f"bags:=[{SET_5}]", "-p", "rate:=20.0")
    peer.until(lambda: peer.heard["sample"])
    start = time.monotonic()
    peer.until(lambda: len(peer.heard["sample"]) == 6300)
    assert time.monotonic() - start > 1.4
    peer.until(lambda: len(peer.heard["demonstration"]) == 2)
    assert list(peer.heard["demonstration"][-1].data[-2:]) == [0.0, 6300.0]


def test_an_axis_may_leave_the_last_action_to_a_button():
    """As for the slung load: -3, 0, +3 m/s² on the stick, the release on the first button."""
    stick = Joystick(
        JoystickSettings(joy_actions=3, joy_buttons=(3,)), SlungLoad.description.actions, 1
    )
    chosen = []
    for axis, button in ((1.0, 0), (0.0, 0), (-1.0, 0), (-1.0, 1), (0.9, 0)):
        stick.take([axis], [button])
        chosen.append(stick.action())
    assert chosen == [0, 1, 2, 3, 0]
    everything = Joystick(JoystickSettings(), SlungLoad.description.actions, 1)
    everything.take([-1.0], [])
    assert everything.action() == 3


def test_without_a_joystick_nothing_is_recorded(nodes, peer, tmp_path):
    peer.listen("state", JointState)
    nodes.start("simulator")
    bag = tmp_path / "bag"
    nodes.start("demonstrator", "-p", "source:=joy", "-p", f"record:={bag}")
    nodes.wait_for("demonstrator", "waiting for a joystick on /joy")
    peer.until(lambda: len(peer.heard["state"]) >= 10)  # asked again and again
    assert len({m.header.stamp.nanosec for m in peer.heard["state"]}) == 1
    assert not bag.exists()


def test_a_checkpoint_of_before_is_never_overwritten(nodes, peer, tmp_path):
    path = tmp_path / "policy.npz"
    path.write_bytes(b"what another learner learned")
    peer.be_vehicle(TASK)
    nodes.start("learner", *AT_ONCE, "-p", f"checkpoint:={path}")
    nodes.wait_for("learner", "acting on")
    assert nodes.end("learner") == 0
    assert path.read_bytes() == b"what another learner learned"  # nothing was learned
    for k in (1, 2):
        nodes.start("simulator", "-p", "episodes:=1")
        nodes.start("learner", *AT_ONCE, "-p", "update_interval:=100", "-p",
                    f"checkpoint:={path}", name="again")  # fmt: skip
        nodes.wait_for("simulator", "done: 1 episodes")
        assert nodes.end("again") == 0
        assert nodes.end("simulator") == 0
        assert (tmp_path / f"policy.{k}.npz").is_file()
    assert (tmp_path / "policy.1.npz").read_bytes() == b"what another learner learned"


# ---------------------------------------------------------------- bad input


def yaml_file(folder, node, text):
    path = folder / "bad.yaml"
    path.write_text(f"{node}:\n  ros__parameters:\n    {text}\n")
    return str(path)


@pytest.mark.parametrize(
    ("node", "text", "words"),
    [
        ("simulator", "task: pendulm", "task is 'pendulm'; allowed: cart_pole, pendulum"),
        ("simulator", "g: -9.81", "parameter g is -9.81; allowed: a double such as 1.0 from 0.0"),
        ("simulator", "g: 10", "parameter g is 10; allowed: a double"),
        ("simulator", "mode: sometimes", "mode is 'sometimes'; allowed: lockstep, realtime"),
        ("simulator", "sensor_noise: [0.1, 0.2, 0.3]", "sensor_noise has 3 entries"),
        ("learner", "gamma: 1.5", "gamma is 1.5 in what the learner was given, and 0.98 in the"),
        ("learner", "task: kite", "task is 'kite' in what the learner was given, and 'pendulum'"),
        (
            "demonstrator",
            f"task: kite\n    bags: [{SET_5}]",
            "task is 'kite' in what the demonstrator was given",
        ),
        ("learner", "epsilon_decay: 1.5", "parameter epsilon_decay is 1.5; allowed"),
        ("learner", "forget_factor: 0.0", "forget_factor is 0.0; allowed: (0.0, 1.0]"),
        ("learner", "learner: genius", "learner is 'genius'; allowed: apprentice"),
        ("learner", "update_interval: 0", "parameter update_interval is 0; allowed"),
        ("learner", "update_interval: often", "update_interval is 'often'; allowed: an integer"),
        ("learner", "centers: [0, 3]", "centers is 0; allowed: [1, inf]"),
        ("learner", "centers: [3]", "centers has 1 entries; allowed: 2, one for each of shaft"),
        ("learner", "low: [9.0, 90.0]", "allowed: low < high"),
        ("learner", "checkpoint: /proc/1/c.npz", "checkpoint /proc/1/c.npz cannot be written"),
        ("learner", "resume: true", "parameter checkpoint is empty"),
        ("demonstrator", "bags: [/nowhere/bag]", "bag /nowhere/bag does not exist"),
        ("demonstrator", "source: bag", "parameter bags is empty"),
        ("demonstrator", "corruption: 1.1", "parameter corruption is 1.1; allowed"),
        ("demonstrator", "source: scripted\n    vehicle_timeout: 0.3", "no vehicle: nothing"),
        ("demonstrator", f"bags: [{SET_5}]\n    learner_timeout: 0.3", "nobody listens on"),
        ("demonstrator", "source: scripted\n    model_file: /no.yaml", "/no.yaml does not exist"),
        ("learner", "vehicle_timeout: 0.3", "no vehicle: nothing on"),
    ],
)
def test_bad_input_is_named_in_one_line_with_status_2(
    run_here, vehicle, tmp_path, node, text, words
):
    if "vehicle_timeout" not in text:
        vehicle(TASK)
    status, said = run_here(node, "--params-file", yaml_file(tmp_path, node, text))
    assert words in said
    assert (status, "Traceback" in said) == (2, False), said


@pytest.mark.parametrize("node", ["simulator", "demonstrator", "learner"])
def test_bad_input_ends_the_process_as_it_ends_main(nodes, tmp_path, node):
    bad = yaml_file(tmp_path, node, "seed: -1")
    status, said = nodes.finish(node, "--params-file", bad)
    assert (status, "Traceback" in said) == (2, False), said
    assert "parameter seed is -1; allowed" in said


def test_a_parameter_file_that_is_none_is_named(run_here, tmp_path):
    status, said = run_here("simulator", "--params-file", str(tmp_path / "none.yaml"))
    assert (status, "Traceback" in said) == (2, False), said
    assert "none.yaml" in said
    (tmp_path / "junk.yaml").write_text("]: [")
    status, said = run_here("simulator", "--params-file", str(tmp_path / "junk.yaml"))
    assert (status, "Traceback" in said) == (2, False), said


def test_a_misspelt_parameter_is_pointed_out(nodes):
    nodes.start("learner", "-p", "epsilom:=0.5")
    nodes.wait_for("learner", "parameter epsilom is not known here and does nothing; did you mean")


def test_a_cut_off_bag_is_replayed_as_far_as_it_goes(nodes, peer, tmp_path):
    path = Path(tmp_path / "cut")
    path.mkdir()
    whole = next(SET_5.glob("*.mcap")).read_bytes()
    (path / "cut.mcap").write_bytes(whole[: len(whole) // 2])
    peer.listen("demonstration", Float64MultiArray, qos.LATCHED)
    peer.be_vehicle(TASK)
    nodes.start("demonstrator", "-p", f"bags:=[{path}]", "-p", "learner_timeout:=0.0")
    nodes.wait_for("demonstrator", "was cut off: it was not closed, and its last")
    nodes.start("learner")
    nodes.wait_for("learner", "learning offline from")
    samples = peer.heard["demonstration"]
    peer.until(lambda: samples and samples[-1].data[4] == 0.0)
    assert 500 < samples[-1].data[5] < 6300
