import json

import numpy as np
import pytest

from iolspi_ros.bench import learner, scale, speed
from iolspi_ros.bench.rows import at_least, at_most
from iolspi_ros.cli import bench


def test_goals_hold_or_not():
    assert at_most("time", 2.0, "s", 2.0).holds
    assert not at_most("time", 2.1, "s", 2.0).holds
    assert not at_least("ratio", float("nan"), "times", 1.0).holds


def test_power_laws_are_found():
    assert scale.exponent([1.0, 10.0, 100.0], [3.0, 3e2, 3e4]) == pytest.approx(2.0)


def test_figures_are_taken_at_the_deadline_and_after_it():
    """Two seeds, cost 1.2, 1.1, 1.0 and 1.2, 1.1, 1.02 at 0, 20 and 40 s."""
    ratio = np.array([[1.2, 1.1, 1.0], [1.2, 1.1, 1.02]])
    upright = np.array([[0.0, 0.5, 1.0], [0.0, 0.7, 1.0]])
    curves = learner.Curves(np.array([0.0, 20.0, 40.0]), ratio, upright, upright)
    found = {row.name: row for row in learner._figures(curves, "set 5", "refreshed")}
    assert found["set 5, refreshed: cost at 20 s, mean"].value == pytest.approx(1.1)
    assert found["set 5, refreshed: cost, worst later update of all seeds"].value == 1.1
    assert not found["set 5, refreshed: cost at 20 s, upper 95 %"].holds
    assert found["set 5, refreshed: last 0.5 s upright at 20 s, mean"].value == pytest.approx(0.6)


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
