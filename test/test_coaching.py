"""What a person is told of their demonstrations: what would be learned, what helps most now."""

import math
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.bags import coaching, survey
from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.core.samples import Transitions
from iolspi_ros.experiments import preview
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import make_learner, prepare
from iolspi_ros.experiments.samplesets import samples
from iolspi_ros.nodes import foresight
from iolspi_ros.nodes.coach import foretold
from iolspi_ros.preview_request import Request
from iolspi_ros.task import Action, TaskDescription, Variable
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum.description
BOX = np.array([TASK.high[d] - TASK.low[d] for d in range(2)]) / survey.BOXES


def batch_of(states, actions=None, terminated=None, task=TASK):
    states = np.asarray(states, float).reshape(-1, task.n_dims)
    n = len(states)
    actions = np.arange(n) % task.n_actions if actions is None else np.asarray(actions)
    ended = np.zeros(n, bool) if terminated is None else np.asarray(terminated)
    return Transitions(states, actions, np.zeros(n), states, ended, np.zeros(n, bool))


places = st.tuples(st.floats(-math.pi, math.pi), st.floats(-47.1, 47.1))


@given(st.lists(places, min_size=20, max_size=60))
def test_what_is_named_was_not_seen_and_is_near_what_was(states):
    text = coaching.hint(batch_of(states), TASK)
    numbers = [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", text)]
    assert text.startswith("Explore: angle [rad] between")
    assert "rate [rad/s] between" in text
    low, high = np.array(numbers[0::2]), np.array(numbers[1::2])
    slack = np.abs([low, high]).max(axis=0) * 0.05 + 1e-9  # two digits are said
    seen = np.array(states)
    assert (low < high).all()
    assert not ((seen > low + slack) & (seen < high - slack)).all(axis=1).any()
    gap = np.maximum(np.maximum(low - seen, seen - high), 0.0)
    gap[:, 0] = np.minimum(gap[:, 0], 2 * math.pi - np.abs(seen[:, 0] - (low + high)[0] / 2))
    assert (gap <= 1.01 * BOX + slack).all(axis=1).any()


def test_an_action_that_is_hardly_taken_is_named_first():
    states = np.random.default_rng(0).uniform(TASK.low, TASK.high, (500, 2))
    actions = np.where(np.arange(500) % 100 == 0, 1, 2 * (np.arange(500) % 2))
    assert coaching.hint(batch_of(states, actions), TASK).startswith("Explore: 0 V is hardly")


def test_one_that_ends_the_task_is_not_missed():
    """A release comes once in an episode at most."""
    from sim_nodes.tasks.slung_load import SlungLoad

    task = SlungLoad.description
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (300, 4))
    actions, ended = np.arange(300) % 3, np.zeros(300, bool)
    actions[::100], ended[::100] = 3, True
    assert "release" not in coaching.hint(batch_of(states, actions, ended, task), task)


def test_words_follow_what_would_be_learned():
    states = np.random.default_rng(0).uniform(TASK.low, TASK.high, (100, 2))
    some = batch_of(states)
    assert coaching.hint(batch_of([]), TASK).startswith("Perform")
    assert "end upright" in coaching.hint(batch_of([]), TASK)
    assert coaching.hint(some, TASK, 0.95).startswith("That is enough")
    assert coaching.hint(some, TASK, 0.1).startswith("Perform: another")
    assert "random actions" in coaching.hint(some, TASK, 0.5)
    assert "random actions" not in coaching.hint(some, TASK, 0.5, corruption=0.33)
    everywhere = [[x, y] for x in np.linspace(-3.1, 3.1, 41) for y in np.linspace(-47, 47, 41)]
    assert coaching.hint(batch_of(everywhere), TASK).startswith("Perform: every place")


def test_without_limits_nothing_is_made_up():
    free = TaskDescription(
        "free", (Variable("x"), Variable("y")), (Action("a"), Action("b")), sampling_time=0.1
    )
    states = np.random.default_rng(0).normal(size=(50, 2))
    assert "between" not in coaching.hint(batch_of(states, task=free), free)


def test_what_is_foretold_is_what_the_learner_does():
    """By hand the same; and of a task without a model nothing is flown."""
    world, _, name = prepare("pendulum", None, 0)
    rows = samples("set 5", world.task, 0)[:1200]
    hand = make_learner(name, TASK, {}, "here", 0)
    hand.pretrain(rows)
    share = evaluate(world.task, greedy_policy(hand)).success_fraction
    request = Request(TASK, "iolspi", {}, rows)
    assert preview.foresee(Request.unpack(request.pack()))["share"] == share
    other = request._replace(task=replace(TASK, name="unknown"))
    assert preview.foresee(other)["share"] is None


def test_words_of_what_is_foretold():
    words = foretold({"accepted": True, "share": 0.4}, 3, "end upright")
    assert words.startswith("Taught by these 3 episodes the learner's vehicle would end upright")
    assert "from 40% of the starts" in words
    assert "in doubt" in foretold({"accepted": False, "share": 0.4}, 3, "")
    assert "this episode" in foretold({}, 1, "")
    assert "no model" in foretold({"accepted": True, "share": None}, 2, "")


class Unasked:
    """In the place of asking a learner on a graph."""

    def __init__(self, node, task, ready):
        pass

    def ask(self):
        pass

    close = ask


@pytest.fixture
def seen_ahead(monkeypatch):
    monkeypatch.setattr(foresight, "LearnerAsked", Unasked)
    made = foresight.Foresight(None, TASK)
    yield made
    made.close()


def test_only_the_newest_set_is_answered_and_nobody_waits(seen_ahead):
    rows = samples("set 5", Pendulum(), 0)
    seen_ahead.ask(rows[:600])
    first = seen_ahead._process
    assert seen_ahead.look() is None
    seen_ahead.ask(rows[:900])
    assert seen_ahead.look() is None  # nobody waits for it
    assert first.wait(60.0) != 0
    end, found = time.monotonic() + 60.0, None
    while found is None and time.monotonic() < end:
        found = seen_ahead.look()
        time.sleep(0.01)
    assert 0.0 <= found["share"] <= 1.0
    assert not seen_ahead.busy
    assert seen_ahead.look() is None


def test_a_set_that_teaches_nothing_is_no_failure(seen_ahead):
    rows = batch_of([[math.nan, 0.0]] * 5)
    seen_ahead.ask(rows)
    end, found = time.monotonic() + 60.0, None
    while found is None and time.monotonic() < end:
        found = seen_ahead.look()
        time.sleep(0.01)
    assert found == {}
