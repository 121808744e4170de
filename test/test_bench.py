import json

import numpy as np
import pytest

from iolspi_ros import resources
from iolspi_ros.bench import deep, latency, learner, public, safety, scale, speed
from iolspi_ros.bench.rows import at_least, at_most
from iolspi_ros.cli import bench
from iolspi_ros.experiments.headless import make_learner
from iolspi_ros.experiments.slung_load import DEFAULT, INFORMED, SlungLoadRun, drop
from iolspi_ros.experiments.thesis import slung_load_claims as c
from iolspi_ros.experiments.thesis.curves import NEAR_OPTIMAL
from sim_nodes.tasks.slung_load import Outcome, SlungLoad
from sim_nodes.world import WorldSettings, make_world


def test_goals_hold_or_not():
    assert at_most("time", 2.0, "s", 2.0).holds
    assert not at_most("time", 2.1, "s", 2.0).holds
    assert not at_least("ratio", float("nan"), "times", 1.0).holds


def test_power_laws_are_found():
    assert scale.exponent([1.0, 10.0, 100.0], [3.0, 3e2, 3e4]) == pytest.approx(2.0)


def test_figures_are_taken_at_the_deadline_and_after_it():
    """Two seeds, cost 1.2, 1.1, 1.0 and 1.2, 1.1, 1.02 at 0, 10 and 20 s."""
    ratio = np.array([[1.2, 1.1, 1.0], [1.2, 1.1, 1.02]])
    upright = np.array([[0.0, 0.5, 1.0], [0.0, 0.7, 1.0]])
    curves = learner.Curves(np.array([0.0, 10.0, 20.0]), ratio, upright, upright)
    found = {row.name: row for row in learner._figures(curves, "set 5", "refreshed")}
    assert found["set 5, refreshed: cost at 10 s, mean"].value == pytest.approx(1.1)
    assert found["set 5, refreshed: cost, worst later update of all seeds"].value == 1.1
    assert not found["set 5, refreshed: cost at 10 s, mean"].holds
    assert found["set 5, refreshed: last 0.5 s upright at 10 s, mean"].value == pytest.approx(0.6)


def test_crashes_are_counted_per_thousand_episodes_and_against_each_other():
    """1 in 10 online and 1 in 20 informed; the shield lets none through."""

    def cell(every, dunks):
        ending = np.full((2, 15_000), Outcome.MISS)
        if every:
            ending[:, ::every] = [[Outcome.WALL], [Outcome.CABLE]]
        judged = np.zeros((2, 2, 5), int)
        judged[:, -1, Outcome.DUNK], judged[:, -1, Outcome.OPEN] = dunks, 10 - dunks
        numbers = {name: np.ones((2, 2)) for name in ("discounted", "flipped_discounted", "vetoes")}
        return {"ending": ending, "judged": judged, **numbers}

    data = {c.ONLINE_T: cell(10, 3), c.INFORMED_T: cell(20, 4), c.CONSTANT: cell(5, 4),
            c.GREEDY: cell(20, 10), c.SHIELDED: cell(0, 9), c.FINE: cell(20, 10),
            c.DEFAULT_T: cell(20, 10), c.DEFAULT_SHIELDED: cell(0, 9),
            c.NARROW_LARGE: cell(20, 7),
            NEAR_OPTIMAL: {"judged": np.array([[0, 10, 0, 0, 0]])}}  # fmt: skip
    found = {row.name: row for row in safety.rows(data)}
    assert found["online: crashes per 1,000 episodes, 0 to 15000"].value == pytest.approx(100.0)
    assert found["informed: misses per 1,000 episodes, 0 to 1000"].value == pytest.approx(950.0)
    assert found["online: crashes in all 15000 episodes"].value == pytest.approx(1500.0)
    fewer = found["crashes fewer with demonstrations than without, 15,000 episodes"]
    assert fewer.value == pytest.approx(50.0)
    assert fewer.holds
    assert found["informed, finest grid: greedy dunks, mean"].holds
    assert not found["narrow, informed, larger grid: greedy dunks, mean"].holds
    assert found[f"{c.DEFAULT_T}: greedy after 15000 episodes, dunks, mean"].holds
    assert not found[f"{c.DEFAULT_SHIELDED}: greedy after 15000 episodes, dunks, mean"].holds
    assert found[f"{c.DEFAULT_SHIELDED}: greedy after 15000 episodes, crashes, mean"].holds
    over = "crashes with demonstrations and shield over online's, episodes 0 to 1000"
    assert found[over].value == 0.0


def test_the_default_learner_is_that_of_the_parameter_file():
    file = resources.find("config", "slung_load.yaml")
    values = resources.parameters(file, "learner")
    configured = make_learner("iolspi", SlungLoad.description, values, str(file), 0)
    assert configured.settings == DEFAULT


def test_a_realisation_says_how_every_episode_ended():
    found = drop(SlungLoadRun(INFORMED, samples="set 5", episodes=40, looks=2), 0)
    again = drop(SlungLoadRun(INFORMED, samples="set 5", episodes=40, looks=4), 0)
    np.testing.assert_array_equal(found["ending"], again["ending"])  # looking changes nothing
    assert (found["judged"].sum(axis=1) == 143).all()
    assert not found["vetoes"].any()
    worth = {Outcome.DUNK: 100.0, Outcome.MISS: -10.0, Outcome.CABLE: -50.0, Outcome.WALL: -150.0}
    for score, ending in zip(found["score"], found["ending"], strict=True):
        on_the_way = score - worth.get(Outcome(ending), 0.0)
        assert -50 * 0.5 * 6.5 <= on_the_way <= 0.0  # T Eq. 20: at most 6.5 m from the basket


def test_algorithm_2_written_out_gives_our_weights():
    ours = speed._run(300, 4).weights
    theirs = speed._algorithm_2(speed.LITERAL, 300, 4)
    assert speed._agree("", ours, theirs).holds


def test_the_slung_load_is_learned_on_every_kind_of_grid():
    for algorithm, grid in (("literal", (3, 1, 3, 1)), ("refreshed", (3, 3, 3, 3))):
        grown = scale.run(algorithm, grid, episodes=2)
        assert grown.functions == 4 * np.prod(grid)
        assert 0.0 <= grown.dunks + grown.crashes <= 1.0


def test_rows_are_written_as_json(tmp_path):
    bench._write(tmp_path / "rows.json", [at_most("time", 1.0, "s", 2.0)])
    row = {"name": "time", "value": 1.0, "unit": "s", "goal": "at most 2", "holds": True}
    assert json.loads((tmp_path / "rows.json").read_text()) == [row]


def test_delays_are_to_the_first_setpoint_that_changed():
    asked = np.array([1000, 2000, 3000, 4000])
    passed = np.array([900, 1100, 1300, 1900, 2400, 2900, 3100, 4200])
    values = np.array([-3.0, -3.0, 1.0, 3.0, 3.0, -1.0, -3.0, -2.0])
    found = latency.delays(asked, passed, values, 1e-6)
    np.testing.assert_allclose(found, [300e-9, 900e-9, 100e-9, 200e-9])
    np.testing.assert_allclose(latency.delays(asked, passed, values, 250e-9), [100e-9, 200e-9])


def test_the_usual_environments_are_learned_from_a_plain_pilot(monkeypatch):
    """A threshold that the demonstrations alone reach costs no step; one out of reach, them all."""
    pytest.importorskip("gymnasium")
    monkeypatch.setattr("iolspi_ros.bench.public.JUDGED", 10)
    challenge = public.CHALLENGES[0]
    found = public.reach(challenge._replace(threshold=100.0), 0, demonstrated=True)
    assert found.steps == 0.0
    assert found.best >= 100.0
    assert found.shown > 100.0
    never = public.reach(challenge._replace(threshold=1e9, most=600), 0, demonstrated=False)
    assert never.steps == np.inf
    assert 0.0 < never.best <= 500.0


def test_a_library_s_learners_are_looked_at_as_ours(monkeypatch):
    pytest.importorskip("stable_baselines3")
    monkeypatch.setattr("iolspi_ros.bench.public.JUDGED", 10)
    for challenge in (public.CHALLENGES[0], public.CHALLENGES[3]):  # DQN, SAC
        low = deep.reach(challenge._replace(threshold=-1e9), 0)
        assert low.steps == 1.0
        name, _, settings = deep.TUNED[challenge.id]
        monkeypatch.setitem(deep.TUNED, challenge.id, (name, 600, settings))
        never = deep.reach(challenge._replace(threshold=1e9), 0)
        assert never.steps == np.inf
        assert low.best <= never.best <= 500.0


def test_pilots_of_the_usual_environments_fly_them():
    """Each earns far more than chance does: 22, -500, -200 and -1200."""
    pytest.importorskip("gymnasium")
    chance = {"CartPole-v1": 22.0, "Acrobot-v1": -400.0, "MountainCar-v0": -190.0,
              "Pendulum-v1": -900.0}  # fmt: skip
    for challenge in public.CHALLENGES[:4]:
        kind = public.vehicle_class(challenge.id, {}, public.Wishes(actions=challenge.actions), 3)
        world = make_world(kind(), WorldSettings(), np.random.default_rng(0))
        _, score = public._show(world, challenge.pilot, np.random.default_rng(1))
        assert score > chance[challenge.id], challenge.id
