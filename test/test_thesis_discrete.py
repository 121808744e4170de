"""The experiments of T's chapters 5 and 8: what they compute, and how their claims are decided."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from iolspi_ros.experiments import slung_grid
from iolspi_ros.experiments.cart_pole import Balancing, balancing, demonstration
from iolspi_ros.experiments.slung_grid import Survey, Sweep, Trial, survey, sweep, trial
from iolspi_ros.experiments.thesis import chapter5, chapter5_claims, chapter8, chapter8_claims
from iolspi_ros.experiments.thesis.claims import Verdict


def test_a_trial_adds_up():
    found = trial(Trial(1, episodes=230), 4)
    sizes = np.diff(found["episode"], prepend=0)
    assert sizes.sum() == 230
    assert found["average"] == pytest.approx(np.average(found["score"], weights=sizes))
    assert found["running"][-1] == pytest.approx(found["average"])
    assert found["pairs"] <= found["visits"] <= 230 * 25
    assert -25.0 < found["shown"] < -1.96
    alone = trial(Trial(episodes=230), 4)
    assert np.isnan(alone["shown"])
    assert alone["average"] < found["average"]


def test_a_sweep_is_its_trials():
    found = sweep(Sweep(Trial(episodes=100), "epsilon", (0.0, 0.2)), 1)
    for value, average, since in zip(*found.values(), strict=True):
        one = trial(Trial(episodes=100, epsilon=value), 1)
        assert (average, since) == (one["average"], one["converged"])


def test_learning_has_converged_when_four_of_five_are_satisfactory():
    scores = np.full(300, -50.0)
    scores[100:] = -4.0
    scores[100:300:6] = -50.0  # one in six
    assert slung_grid._converged(scores) == pytest.approx(100, abs=10)
    scores[100:300:4] = -50.0
    assert slung_grid._converged(scores) == 300.0
    assert slung_grid._converged(np.full(60, -2.0)) == 0.0


def test_a_survey_counts_each_visit_once_in_every_dimension():
    found = survey(Survey(episodes=300), 0)
    for name in slung_grid.DIMENSIONS:
        assert found[f"visits_{name}"].sum() == found["visits"]
        values = found[f"value_{name}"]
        assert np.nanmax(values) <= 0.0
        assert np.isfinite(values).sum(axis=1).tolist() == sorted(
            np.isfinite(values).sum(axis=1), reverse=True
        )
    starts = found["visits_velocity"][5]
    assert starts >= 300  # every episode begins at rest


def test_the_best_flight_is_listed_step_by_step():
    rows = chapter5._best_flight({})
    assert rows[-1]["time"] == pytest.approx(1.4)
    assert sum(row["reward"] for row in rows) == pytest.approx(-1.96)
    assert rows[-1]["angle"] < 0.0
    for before, after in pairwise(rows):
        push = {"L": -2.0, "N": 0.0, "R": 2.0}[before["input"]]
        assert after["velocity"] == np.clip(before["velocity"] + push, -5, 5)


def test_a_demonstration_begins_again_after_each_fall():
    skilled, late = (demonstration(400, one, np.random.default_rng(0)) for one in (True, False))
    assert len(skilled) == len(late) == 400
    assert late.terminated.sum() > skilled.terminated.sum() > 0
    inner = np.flatnonzero(~late.terminated[:-1])
    np.testing.assert_array_equal(late.next_state[inner], late.state[inner + 1])
    after = np.flatnonzero(late.terminated[:-1]) + 1
    assert np.abs(late.state[after]).max() < 0.1


def test_balancing_is_a_function_of_setting_and_seed():
    setting = Balancing(samples=300, steps=100, evaluations=5)
    first, again, other = (balancing(setting, seed) for seed in (3, 3, 4))
    assert first["steps"] == again["steps"] <= 100
    assert first["samples"] == other["samples"] == 300
    assert not np.array_equal(first["spread"], other["spread"])
    again = balancing(replace(setting, draw=1), 3)
    np.testing.assert_array_equal(first["spread"], again["spread"])
    merged = balancing(replace(setting, samples=0, demonstrated=(60, -50)), 0)
    assert merged["samples"] == 110


def test_without_an_end_a_constant_drops_out_of_the_equations_at_gamma_1():
    setting = Balancing(samples=1000, steps=10, evaluations=1, gamma=1.0)
    assert balancing(setting, 0)["singular"] == 0.0
    assert balancing(replace(setting, ends=False), 0)["singular"] == 1.0


def cell(steps):
    n = len(steps)
    return {"steps": np.array(steps, float), "samples": np.full(n, 90), "converged": np.ones(n),
            "singular": np.zeros(n), "length": np.full(n, 8.0)}  # fmt: skip


def test_table_8_1_has_both_readings_beside_the_printed_numbers():
    data = {f"{n} {kind}": cell([n, n + 2]) for n in chapter8.SAMPLES
            for kind in ("samples", "episodes")}  # fmt: skip
    rows = chapter8._by_number(data | {chapter8_claims.ENDLESS: cell([5.0, 6.0])})
    assert len(rows) == 13
    assert [row["T"] for row in rows[:12:2]] == [322.9, 918.0, 1215.7, 1808.2, 1233.1, 2339.5]
    assert (rows[11]["setting"], rows[11]["mean"]) == ("1000 episodes", 1001.0)


def test_table_8_3_ends_with_the_worst_and_the_best_random_set():
    data = {label: cell([10.0, 500.0, 30.0]) for label in chapter8.KINDS}
    poor, good = chapter8._by_kind(data)[-2:]
    assert (poor["mean"], poor["T"]) == (10.0, 49.0)
    assert (good["mean"], good["T"]) == (500.0, 600.0)


def test_scatter_is_decided_by_the_bootstrap():
    rng = np.random.default_rng(0)
    for deviation, expected in ((150.0, Verdict.REPRODUCED), (20.0, Verdict.NOT)):
        steps = 300.0 + deviation * rng.standard_normal(60)
        (found,) = chapter8_claims._between_sets({"random": cell(steps)})
        assert found.verdict is expected
        assert found.measured.mean == pytest.approx(deviation, rel=0.2)
        noise = deviation * rng.standard_normal((2, 200))
        sets = 500.0 * rng.standard_normal(200)
        data = {"random": cell(sets + noise[0]), "random, other w₀": cell(sets + noise[1])}
        (same,) = chapter8_claims._between_weights(data)
        assert same.measured.mean == pytest.approx(deviation, rel=0.2)


def test_values_are_compared_over_ranges_of_a_variable():
    value = np.zeros((4, 5, 11))
    value[:, chapter5_claims._CUT, 8:] = [[1.0], [2.0], [3.0], [2.0]]  # from 3 m/s on
    data = {"scattered starts": {"value_velocity": value}}
    (found,) = chapter5_claims.values("velocity", (3.0, 5.0), (1.0, 2.0))(data)
    assert found.measured.mean == 2.0
    assert found.verdict is Verdict.REPRODUCED


def test_swept_values_are_compared_by_seed():
    noise = np.random.default_rng(0).normal(size=(20, 1)) * 30.0
    one = {"value": np.tile([0.0, 0.1, 0.5], (20, 1)),
           "average": np.add(noise, [[1.0, 3.0, 2.5]]),
           "converged": np.add(noise, [[9.0, 5.0, 7.0]])}  # fmt: skip
    data = {"a": one}
    found = chapter5_claims.swept("a", 0.1, (0.0, 0.5))(data)
    assert [f.measured.mean for f in found] == pytest.approx([2.0, 0.5])
    (sooner,) = chapter5_claims.swept("a", 0.1, (0.0,), "converged")(data)
    assert sooner.measured.mean == pytest.approx(4.0)
    (near,) = chapter5_claims.swept_near("a", (0.1, 0.5), 1.0)(data)
    assert near.verdict is Verdict.REPRODUCED
