"""Recordings of a robot's own topics become samples, and samples get the rewards of a file."""

import json
import math

import numpy as np
import pytest
from test_any_bag import TYPES, write
from test_demos_command import iolspi  # noqa: F401  a fixture
from test_robot import CART

from iolspi_ros import bags
from msg_bridge.ros.description import read_robot

FLOAT = "std_msgs/msg/Float64"


@pytest.fixture
def cart(tmp_path):
    path = tmp_path / "cart.yaml"
    path.write_text(json.dumps(CART | {"episode_steps": 20, "terminated": "next.x > 0.9"}))
    return path


def drive(silent=(1e9, 1e9), steps=400, odd=None):
    """A cart whose speed is its push, heard every 0.01 s; told a new push every 0.1 s."""
    x, push = 0.0, 0.0
    for k in range(steps):
        time = k * 10_000_000
        if k % 10 == 2:
            push = 2.0 if (k // 10) % 2 else 0.0
            yield "/robot/push", FLOAT, time, TYPES[FLOAT](push if odd is None else odd)
        x += 0.01 * push
        if not silent[0] <= k < silent[1]:
            yield "/robot/place", FLOAT, time, TYPES[FLOAT](x)


def test_topics_become_samples(iolspi, cart, tmp_path):  # noqa: F811
    path, out = write(tmp_path / "raw", drive()), tmp_path / "out"
    status, said = iolspi("demos", "relabel", path, "--task", cart, "--out", out)
    assert status == 0, said
    task = read_robot(cart).task
    found = bags.read_demonstration(out, task).samples
    assert len(found) > 20
    assert {s.transition.action for s in found} == {0, 1}
    for s in found:
        t = s.transition
        assert t.reward == pytest.approx(-abs(t.next_state[0]))
        assert t.terminated == (t.next_state[0] > 0.9)
        moved = t.next_state[0] - t.state[0]
        assert moved == pytest.approx(0.2 if t.action == 0 else 0.0, abs=0.045)
    assert any(s.transition.terminated for s in found)


def test_where_a_topic_is_silent_no_transition_spans_it(iolspi, cart, tmp_path):  # noqa: F811
    path, out = write(tmp_path / "raw", drive(silent=(30, 75), steps=110)), tmp_path / "out"
    assert iolspi("demos", "relabel", path, "--task", cart, "--out", out)[0] == 0
    found = bags.read_demonstration(out, read_robot(cart).task).samples
    assert {s.episode for s in found} == {0, 1}
    assert max(abs(s.transition.next_state[0] - s.transition.state[0]) for s in found) < 0.25


def test_commands_that_are_no_action_make_no_sample(iolspi, cart, tmp_path):  # noqa: F811
    path = write(tmp_path / "raw", drive(odd=1.0))
    status, said = iolspi("demos", "relabel", path, "--task", cart, "--out", tmp_path / "out")
    assert status == 2
    assert "no step in which" in said


def test_samples_get_the_rewards_of_the_file(iolspi, cart, tmp_path):  # noqa: F811
    first, out = tmp_path / "first", tmp_path / "out"
    raw = write(tmp_path / "raw", drive())
    assert iolspi("demos", "relabel", raw, "--task", cart, "--out", first)[0] == 0
    other = tmp_path / "other.yaml"
    other.write_text(json.dumps(json.loads(cart.read_text()) | {"reward": "next.x ** 2 + value"}))
    assert iolspi("demos", "relabel", first, "--task", other, "--out", out)[0] == 0
    found = bags.read_demonstration(out, read_robot(other).task).samples
    for s in found:
        value = 1.0 if s.transition.action == 0 else 0.0
        assert s.transition.reward == pytest.approx(s.transition.next_state[0] ** 2 + value)
    assert not math.isnan(sum(s.transition.reward for s in found))
    assert np.isfinite([s.transition.state for s in found]).all()
