"""A learner that asks for help where it is unsure; the vehicle goes on."""

import math
from dataclasses import asdict

import numpy as np
import pytest
from conftest import Peer
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, wire
from iolspi_ros.core.learner import Source, learner_class
from iolspi_ros.nodes.unsure import HelpSettings, Unsure, Visits
from iolspi_ros.saving import checkpoint
from iolspi_ros.task import Action, TaskDescription, Variable
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.terminal import line_of
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum.description
ASKING = HelpSettings(ask_for_help=True)
HERE, ELSEWHERE = np.array([0.1, 0.2]), np.array([2.0, 30.0])


def feed(unsure, state, count, source=Source.EXPLOIT):
    for _ in range(count):
        unsure.take(state, source)


def test_it_asks_in_new_places_until_it_knows_them():
    unsure = Unsure(TASK, ASKING)
    window = round(0.5 / TASK.sampling_time)
    unsure.known([HERE, ELSEWHERE] * 3)
    feed(unsure, HERE, window)
    assert not unsure.asks
    places = [ELSEWHERE - [0.4 * (k % 2), 3.2 * (1 + k // 2)] for k in range(window // 2)]
    for place in places:
        feed(unsure, place, 1)
    assert unsure.asks
    assert "hardly been" in unsure.reason
    feed(unsure, HERE, window // 4 - 2)  # better, and not yet half as bad
    feed(unsure, HERE, window)
    assert not unsure.asks
    assert unsure.reason == ""


def test_it_asks_where_its_shield_steps_in_often():
    unsure = Unsure(TASK, ASKING)
    unsure.known([HERE, ELSEWHERE] * 3)
    feed(unsure, HERE, 200)
    assert not unsure.asks
    feed(unsure, HERE, 40, Source.SHIELD)
    assert unsure.asks
    assert "vetoed 40%" in unsure.reason
    feed(unsure, HERE, 100)
    assert not unsure.asks


def test_where_it_has_been_outlives_a_restart(tmp_path):
    """Through a checkpoint on disk; from then on it asks as one that was never stopped."""
    rng = np.random.default_rng(0)
    walk = np.cumsum(rng.normal(0.0, (0.3, 1.0), (400, 2)), axis=0)
    one, other = Unsure(TASK, ASKING), Unsure(TASK, ASKING)
    for state in walk:
        one.take(state, Source.EXPLOIT)
    learner = learner_class("iolspi")
    core = learner(TASK, learner.Settings(), rng)
    path = tmp_path / "c.npz"
    checkpoint.write(path, checkpoint.snapshot(core, "iolspi", help=one.memory())())
    other.recall(checkpoint.part(checkpoint.read(path), "help", Visits, "here"))
    shares = set()
    for n, state in enumerate(walk[::-1] + rng.normal(0.0, 0.5, walk.shape)):
        for unsure in (one, other):
            unsure.take(state, Source.EXPLOIT)
        if n > 100:  # the last half second is looked at anew
            assert other.unsure == one.unsure
            shares.add(one.unsure)
    assert len(shares) > 3
    both = asdict(one.memory()).values(), asdict(other.memory()).values()
    for mine, its in zip(*both, strict=True):
        np.testing.assert_array_equal(mine, its)
    other.recall(Visits(np.zeros((3, 5), int), np.ones(3, int), np.zeros(5, int)))
    assert other.memory().boxes.shape == one.memory().boxes.shape


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=2, max_size=2))
def test_no_state_breaks_it(numbers):
    free = TaskDescription(
        "free", (Variable("x"), Variable("y", low=-1.0, high=1.0)), (Action("a"),),
        sampling_time=0.1,
    )  # fmt: skip
    unsure = Unsure(free, ASKING)
    feed(unsure, np.array(numbers), 4)
    assert unsure.unsure == (1.0 if all(map(math.isfinite, numbers)) else 0.0)


def listen(ros):
    peer = Peer(ros)
    for topic in ("help", "score"):
        peer.listen(topic, Float64MultiArray, qos.RECORDING)
    return peer


def test_a_new_learner_asks_and_flies_on(nodes, ros):
    peer, rows = listen(ros), wire.Rows("help", wire.HELP)
    nodes.start(
        "learner", "-p", "wait_for_demonstrations:=false", "-p", "ask_for_help:=true",
        "-p", "epsilon:=0.2",
    )  # fmt: skip
    nodes.start("simulator")  # as long as it takes to discover who listens

    def ends():
        said.extend(rows.read_all(m) for m in peer.heard["help"][len(said) :])
        return [int(row["episode"]) for row in said if row["step"] == TASK.episode_steps]

    said = []
    peer.until(lambda: len(ends()) >= 5)
    assert ends()[:5] == list(range(ends()[0], ends()[0] + 5))
    assert all(0.0 <= row["unsure"] <= 1.0 for row in said)
    nodes.wait_for("learner", "asks for help: it has hardly been")


def test_by_default_it_asks_nobody(nodes, ros):
    peer = listen(ros)
    nodes.start("learner", "-p", "wait_for_demonstrations:=false")
    nodes.start("simulator")  # as long as it takes to discover who listens
    peer.until(lambda: len(peer.heard["score"]) >= 2)
    assert peer.heard["help"] == []
    assert peer.node.count_publishers("help") == 0


@pytest.mark.parametrize("asks", [0.0, 1.0])
def test_the_terminal_says_so(asks):
    board = Board()
    board.put("task", {"name": "pendulum"})
    board.put("help", {"asks": asks, "unsure": 0.6, "vetoes": 0.0})
    assert ("asks for help" in line_of(board)) == bool(asks)
