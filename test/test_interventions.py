"""An expert at the learner's side, without waiting for the best there is."""

import numpy as np
import pytest

from iolspi_ros.bench import interventions as bench
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Transition
from iolspi_ros.experiments import interventions
from iolspi_ros.experiments.headless import Listener, make_learner, make_world, train
from iolspi_ros.experiments.interventions import (
    CONFIRMING,
    DELAY,
    NOBODY,
    WATCHING,
    InterventionRun,
    Watched,
    help_learning,
)
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load.dynamics import Outcome

TASK = SlungLoad.description


class Dynamics:
    """Knows what one step brings, and flies neutral; a load that cannot be dunked is nothing."""

    def q(self, states, ahead=0):
        values = [SlungLoad().step(states, np.full(len(states), a))[1] for a in range(4)]
        return np.stack(values, axis=1)

    def __call__(self, states):
        return np.full(len(states), TASK.neutral)


class Noted:
    """A learner that always does the same, and notes who did what."""

    task = TASK

    def __init__(self, action):
        self.action, self.sources = action, []

    def act(self, state, explore=True):
        return self.action, Source.EXPLOIT

    def observe(self, transition):
        self.sources.append(transition.source)
        return False


def transition(reward=0.0, *, ended=False):
    return Transition(np.zeros(4), 1, reward, np.zeros(4), ended, False)


def test_nobody_at_its_side_changes_nothing():
    """Bit by bit."""
    seen, setting = [], InterventionRun(NOBODY, episodes=30)
    values = {"epsilon": 1.0, "update_interval": 10_000}
    for watched in (False, True):
        core = make_learner("iolspi", TASK, values, "here", 3)
        world, ends = make_world("slung_load", None, 3), []
        pilot = Watched(core, Dynamics(), setting) if watched else core
        look = lambda *_: None  # noqa: E731
        train(world, pilot, 30, Listener(look, on_episode=lambda *end, kept=ends: kept.append(end)))
        seen.append((ends, core.batch.rows().state.copy()))
    assert seen[0][0] == seen[1][0]
    assert np.array_equal(seen[0][1], seen[1][1])


def test_one_who_confirms_stops_a_mistake_and_keeps_the_vehicle_to_the_end():
    pilot, state = Noted(3), np.array([-5.0, 0.0, 0.0, 0.0])
    watched = Watched(pilot, Dynamics(), InterventionRun(CONFIRMING, loss=5.0))
    for ended in (False, False, True):
        assert watched.act(state) == (TASK.neutral, Source.HUMAN)  # a release here would miss
        watched.observe(transition(ended=ended))
    pilot.action = 1
    assert watched.act(state) == (1, Source.EXPLOIT)  # another episode is the learner's again
    watched.observe(transition())
    assert pilot.sources == [Source.HUMAN] * 3 + [Source.EXPLOIT]
    assert watched.takeovers == [True, False]


def test_one_who_watches_comes_late_and_not_for_little():
    class Worth(Dynamics):
        value = 50.0

        def q(self, states, ahead=0):
            return np.full((len(states), 4), self.value)

    expert = Worth()
    watched = Watched(Noted(0), expert, InterventionRun(WATCHING, loss=30.0))
    state = np.zeros(4)

    def flown():
        source = watched.act(state)[1]
        watched.observe(transition())
        return source

    assert flown() == Source.EXPLOIT
    expert.value = 25.0  # discounted it is 26 less
    assert [flown() for _ in range(5)] == [Source.EXPLOIT] * 5
    expert.value = -10.0
    assert [flown() for _ in range(DELAY + 2)] == [Source.EXPLOIT] * DELAY + [Source.HUMAN] * 2


def test_a_helper_leaves_when_they_said():
    watched = Watched(Noted(3), Dynamics(), InterventionRun(CONFIRMING, loss=5.0, stays=2))
    for _ in range(4):
        watched.act(np.array([-5.0, 0.0, 0.0, 0.0]))
        watched.observe(transition(ended=True))
    assert watched.takeovers == [True, True, False, False]


@pytest.mark.parametrize("helper", [NOBODY, CONFIRMING])
def test_a_realisation_says_what_came_of_it(monkeypatch, helper):
    monkeypatch.setattr(interventions, "near_optimal_policy", lambda task: Dynamics())
    found = help_learning(InterventionRun(helper, loss=5.0, episodes=12), 0)
    again = help_learning(InterventionRun(helper, loss=5.0, episodes=12), 0)
    assert all(np.array_equal(found[name], again[name]) for name in found)
    assert found["ending"].shape == found["taken"].shape == found["dunks"].shape == (12,)
    assert found["taken"].any() == (helper == CONFIRMING)
    assert (found["until"], found["reached"]) == (12, False)
    if helper == CONFIRMING:
        assert not (found["ending"] == Outcome.MISS).any()
    stacked = {name: np.stack([value, value]) for name, value in map_arrays(found)}
    numbers = bench.numbers(stacked)
    assert numbers["taken over, first quarter [%]"][0] == 100.0 * found["taken"][:3].mean()
    assert numbers["crashes per 1,000 episodes"][0] == pytest.approx(
        1000.0 * np.isin(found["ending"], (Outcome.CABLE, Outcome.WALL)).mean()
    )


def map_arrays(found):
    return [(name, np.asarray(value)) for name, value in found.items()]


def test_bench_compares_seed_by_seed():
    rng, data = np.random.default_rng(0), {}
    for cell in bench.cells(4):
        until = rng.integers(100, 400, 4)
        data[cell.label] = {
            "ending": np.ones((4, 80), np.int8), "taken": np.zeros((4, 80), bool),
            "dunks": np.full((4, 80), 0.5), "until": until, "reached": until < 400,
        }  # fmt: skip
    rows = {row.name: row.value for row in bench.rows(data)}
    alone, with_ = data["set 5: alone"]["until"], data["set 5: watched"]["until"]
    title = "set 5, watched: episodes to 95 % dunks, more than alone"
    assert rows[title] == pytest.approx((with_ - alone).mean())
    assert rows[f"{title}, lower 95 %"] <= rows[title] <= rows[f"{title}, upper 95 %"]
