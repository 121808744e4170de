"""What a learner says of an episode: its sums, from whatever it saw of it."""

import numpy as np
import pytest
from conftest import Peer
from hypothesis import given
from hypothesis import strategies as st
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.experiments.headless import make_learner
from iolspi_ros.nodes.reports import Reports
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum.description
STEPS = 40
BEGINNINGS = st.lists(st.tuples(st.booleans(), st.integers(0, STEPS - 1)), min_size=1, max_size=5)


@pytest.fixture(scope="module")
def learner():
    return make_learner("iolspi", TASK, {}, "test", 0)


class Said:
    """A node that keeps what is published."""

    def __init__(self):
        self.rows = []

    def create_publisher(self, kind, topic, profile):
        return self

    def publish(self, message):
        self.rows.append(wire.ScoreRows().read(message))

    def get_clock(self):
        return self

    now = get_clock
    nanoseconds = 0


def observation(episode, step, source, reward):
    return Observation(
        episode, step, np.zeros(TASK.n_dims), reward, 0 if step else -1, False,
        step == STEPS, 0, source if step else -1,
    )  # fmt: skip


@given(BEGINNINGS, st.booleans(), st.randoms(use_true_random=False))
def test_each_score_is_of_its_own_episode(learner, beginnings, resumed, random):
    """Also when its first observations were missed, or the learner began again in its middle."""
    said = Said()
    reports, expected = Reports(said, learner), []
    for episode, (whole, first) in enumerate(beginnings):
        score, discounted, taken, before = 0.0, 0.0, 0, False
        for step in range(0 if whole else first, STEPS + 1):
            source = random.choice([Source.EXPLOIT, Source.HUMAN, Source.HOLD])
            reward = random.uniform(-1.0, 0.0) if step else 0.0
            reports.answered(observation(episode, step, source, reward), Source.EXPLOIT)
            score += reward
            if step:
                discounted += TASK.gamma ** (step - 1) * reward
                if source != Source.HOLD:
                    taken += source == Source.HUMAN and not before
                    before = source == Source.HUMAN
            if resumed and step == STEPS // 2:
                reports, memory = Reports(said, learner), reports.memory()
                reports.recall(memory)
        expected.append((episode, STEPS, score, discounted, taken))
    for row, (episode, step, score, discounted, taken) in zip(said.rows, expected, strict=True):
        assert tuple(row[:2]) == (episode, step)
        assert np.allclose(row[4:6], (score, discounted))
        assert row[7] == taken


def test_a_score_reaches_who_comes_late(ros, learner):
    peer = Peer(ros)
    reports = Reports(peer.node, learner)
    reports.answered(observation(3, STEPS, Source.HUMAN, -2.0), Source.HOLD)
    peer.listen("score", Float64MultiArray, qos.REPORTS)
    peer.until(lambda: peer.heard["score"])
    assert list(peer.heard["score"][0].data[:2]) == [3.0, STEPS]
