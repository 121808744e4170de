"""The graph in lockstep: the same as without a graph, whatever is lost on the way."""

import random
import signal
from dataclasses import fields, replace

import numpy as np
import pytest
from conftest import spin_until
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from iolspi_ros import bags, qos, runtime
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transitions
from iolspi_ros.experiments.headless import Listener, prepare, train
from iolspi_ros.resources import find
from iolspi_ros.saving import checkpoint
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.world import World, WorldSettings

EPISODES = 3
SETTINGS = LSPISettings(update_interval=250)
SET_5 = find("demos", "pendulum", "set_5")


def new_learner(seed):
    return OnlineLSPI(Pendulum.description, SETTINGS, np.random.default_rng([seed, 1]))


def headless(seed, informed):
    learner = new_learner(seed)
    if informed:
        found = bags.read_demonstration(SET_5, Pendulum.description)
        learner.pretrain(found.transitions())
    world = World(Pendulum(), WorldSettings(), np.random.default_rng([seed, 0]))
    train(world, learner, EPISODES, Listener())
    return learner


def assert_same(learner, other):
    """Weights, the samples kept, and what came after the last update."""
    np.testing.assert_array_equal(learner.weights, other.weights)
    np.testing.assert_array_equal(learner.buffer.born, other.buffer.born)
    for part in (lambda x: x.buffer.transitions, lambda x: x.state().batch):
        for field in fields(Transitions):
            a, b = (getattr(part(x), field.name) for x in (learner, other))
            np.testing.assert_array_equal(a, b)


def start_learner(nodes, path, seed, informed=False):
    nodes.start(
        "learner", "-p", f"wait_for_demonstrations:={str(informed).lower()}",
        "-p", "update_interval:=250", "-p", f"checkpoint:={path}", "-p", f"seed:={seed}",
    )  # fmt: skip


def start_simulator(nodes, seed, *more):
    arguments = ["-p", f"episodes:={EPISODES}", "-p", f"seed:={seed}", *more]
    nodes.start("simulator", *arguments)


def finish(nodes, path, seed):
    """End the nodes once all episodes are done; what the learner saved."""
    for name in list(nodes.processes):
        status = nodes.end(name, signal.SIGTERM)
        assert status == 0, nodes.log(name)
    learner = new_learner(seed)
    checkpoint.load(path, learner, "iolspi")
    return learner


@pytest.mark.parametrize("informed", [False, True])
def test_graph_and_headless_are_bit_identical(nodes, tmp_path, informed):
    path = tmp_path / "c.npz"
    start_learner(nodes, path, 3, informed)
    start_simulator(nodes, 3)
    if informed:
        nodes.start("demonstrator", "-p", f"bags:=[{SET_5}]")
    nodes.wait_for("simulator", "done: 3 episodes")
    learner = finish(nodes, path, 3)
    assert learner.step == EPISODES * 300
    assert_same(learner, headless(3, informed))
    other = headless(4, informed)
    assert not np.array_equal(learner.weights, other.weights)


@pytest.mark.slow
def test_the_slung_load_is_the_same_too(nodes, tmp_path):
    """Episodes of many lengths, a fourth action, demonstrations; as the task's file says."""
    config, bag = find("config", "slung_load.yaml"), find("demos", "slung_load", "set_5")
    path, episodes = tmp_path / "c.npz", 60
    file = ("--params-file", str(config), "-p")
    nodes.start(
        "learner", *file, f"checkpoint:={path}", "-p", "seed:=3", "-p", "update_interval:=200",
    )  # fmt: skip
    nodes.start("simulator", *file, f"episodes:={episodes}", "-p", "seed:=3")
    nodes.start("demonstrator", *file, f"bags:=[{bag}]")
    nodes.wait_for("simulator", f"done: {episodes} episodes", 300.0)
    assert nodes.end("simulator") == nodes.end("demonstrator") == 0
    assert nodes.end("learner", signal.SIGTERM) == 0, nodes.log("learner")
    world, alone, _ = prepare("slung_load", config, 3)
    settings = replace(alone.settings, update_interval=200)
    flown = OnlineLSPI(world.task.description, settings, np.random.default_rng([3, 1]))
    checkpoint.load(path, flown, "iolspi")
    alone = OnlineLSPI(world.task.description, settings, np.random.default_rng([3, 1]))
    alone.pretrain(bags.read_demonstration(bag, world.task.description).transitions())
    train(world, alone, episodes, Listener())
    assert flown.step == alone.step >= 3 * 200
    assert_same(flown, alone)


def test_two_runs_with_one_seed_are_bit_identical(nodes, tmp_path):
    learners = []
    for run in ("a", "b"):
        path = tmp_path / f"{run}.npz"
        start_learner(nodes, path, 8)
        start_simulator(nodes, 8)
        nodes.wait_for("simulator", "done: 3 episodes")
        learners.append(finish(nodes, path, 8))
    assert_same(*learners)


class Lossy:
    """Passes messages on: a tenth is lost, some are doubled, some come late."""

    def __init__(self, rclpy, seed=0):
        self.random = random.Random(seed)
        self.node = rclpy.create_node("lossy")
        self.late, self.counts = [], {"lost": 0, "doubled": 0, "late": 0, "passed": 0}
        for topic, kind, there, here in (
            ("state", JointState, "sim/state", "state"),
            ("reward", Float64MultiArray, "sim/reward", "reward"),
            ("action", Float64MultiArray, "action", "sim/action"),
        ):
            out = self.node.create_publisher(kind, here, qos.CONTROL)
            self.node.create_subscription(kind, there, self.relay(out), qos.CONTROL)
            assert topic

    def relay(self, out):
        def take(message):
            chance = self.random.random()
            for publisher, old in self.late:
                publisher.publish(old)
            self.late.clear()
            if chance < 0.1:
                self.counts["lost"] += 1
                return
            if chance < 0.2:
                self.late.append((out, message))  # after the next one
                self.counts["late"] += 1
                return
            out.publish(message)
            self.counts["passed"] += 1
            if chance > 0.9:
                out.publish(message)
                self.counts["doubled"] += 1

        return take


@pytest.mark.slow
def test_losses_change_nothing_but_the_time(nodes, tmp_path, ros):
    path = tmp_path / "c.npz"
    relay = Lossy(ros)
    loop = runtime.Loop(relay.node)
    start_learner(nodes, path, 5)
    start_simulator(
        nodes, 5, "-p", "resend_after:=0.01",
        "-r", "state:=sim/state", "-r", "reward:=sim/reward", "-r", "action:=sim/action",
    )  # fmt: skip
    spin_until(loop, lambda: "done: 3 episodes" in nodes.log("simulator"))
    assert min(relay.counts.values()) > 50
    assert_same(finish(nodes, path, 5), headless(5, informed=False))


def test_a_demonstration_through_the_graph_is_the_shipped_one(nodes, tmp_path):
    """Set 1 was made so: the recording is reproducible, sample by sample."""
    path = tmp_path / "set_1"
    nodes.start("simulator", "-p", "order:=sweep", "-p", "seed:=1")
    nodes.start(
        "demonstrator", "-p", "source:=scripted", "-p", "seed:=1", "-p", "episodes:=2",
        "-p", f"record:={path}",
    )  # fmt: skip
    nodes.wait_for("demonstrator", "demonstration ended")
    assert nodes.end("demonstrator") == 0
    shipped = bags.read_demonstration(find("demos", "pendulum", "set_1"), Pendulum.description)
    mine = bags.read_demonstration(path, Pendulum.description)
    assert len(mine.samples) == mine.card["samples"] == 600
    a, b = (d.transitions() for d in (mine, replace(shipped, samples=shipped.samples[:600])))
    for x, y in zip(a, b, strict=True):
        assert x.action == y.action
        np.testing.assert_allclose(x.next_state, y.next_state, atol=1e-9)
