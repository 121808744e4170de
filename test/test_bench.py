import json

import numpy as np
import pytest

from iolspi_ros.bench import latency, learner, scale, speed
from iolspi_ros.bench.rows import at_least, at_most, interval
from iolspi_ros.cli import bench


def test_the_interval_is_that_of_the_book():
    """Ten values of mean 3 and standard deviation 1: 3 ± 2.262 / √10 (Student, 9 degrees)."""
    values = np.repeat([2.0, 4.0], 5) * np.sqrt(0.9) + 3.0 - 3.0 * np.sqrt(0.9)
    assert np.std(values, ddof=1) == pytest.approx(1.0)
    mean, low, high = interval(values)
    assert (mean, low, high) == pytest.approx((3.0, 3.0 - 0.7153, 3.0 + 0.7153), abs=1e-4)
    assert interval(np.array([7.0])) == (7.0, 7.0, 7.0)


def test_goals_hold_or_not():
    assert at_most("time", 2.0, "s", 2.0).holds
    assert not at_most("time", 2.1, "s", 2.0).holds
    assert not at_least("ratio", float("nan"), "times", 1.0).holds


def test_power_laws_are_found():
    assert scale.exponent([1.0, 10.0, 100.0], [3.0, 3e2, 3e4]) == pytest.approx(2.0)


def test_a_realisation_is_judged_after_every_update():
    curve = learner.fly("set 5", learner.REFRESHED, 0, learner.STILL, 12.0)
    assert curve.time.tolist() == [0.0, 5.0, 10.0]
    assert (curve.ratio > 0.99).all()
    assert ((curve.upright >= curve.whole) & (curve.upright <= 1.0)).all()


def test_random_samples_are_whole_episodes_of_all_actions():
    samples = learner.samples("random", 3)
    assert len(samples) == 21 * 300
    assert samples.truncated.sum() == 21
    assert np.bincount(samples.action).min() > 1900


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
