import itertools
from dataclasses import replace

import numpy as np
import pytest

from iolspi_ros import resources
from iolspi_ros.errors import InputError
from iolspi_ros.experiments import cache, evaluate
from iolspi_ros.experiments.evaluate import near_optimal_policy
from iolspi_ros.methods.near_optimal import Grid, NearOptimal, near_optimal
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A cache folder of this test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "iolspi_ros"


def judged(task, points):
    return evaluate.evaluate(task, near_optimal_policy(task, points))


def test_interpolation_is_exact_for_what_is_linear_in_each_dimension():
    low, high, counts = (-1.0, 0.0, 2.0), (1.0, 4.0, 3.0), (5, 3, 4)
    grid = Grid(low, high, counts)

    def value(s):
        return (2.0 * s[:, 0] - 1.0) * (3.0 - s[:, 1]) * (s[:, 2] + 0.5)

    points = grid.points(0, grid.size)
    axes = [np.linspace(*ends) for ends in zip(low, high, counts, strict=True)]
    np.testing.assert_allclose(points, list(itertools.product(*axes)))
    states = np.random.default_rng(0).uniform(low, high, (200, 3))
    np.testing.assert_allclose(grid.interpolate(value(points), states), value(states))
    np.testing.assert_allclose(grid.interpolate(value(points), points), value(points))
    beyond = np.array([[-5.0, 7.0, 2.5], [9.0, -1.0, 9.0]])
    expected = value(np.clip(beyond, low, high))
    np.testing.assert_allclose(grid.interpolate(value(points), beyond), expected)


def walk(states, actions):
    """Each step right costs 1, the end is at 3."""
    following = np.clip(states + np.where(actions == 1, 1.0, -1.0)[:, None], 0.0, 3.0)
    return following, np.full(len(states), -1.0), following[:, 0] >= 3.0


def test_a_walk_to_the_end_has_the_value_of_its_discounted_steps():
    """V(x) is a geometric sum, and nothing comes after the end."""
    told = []
    policy = near_optimal(walk, Grid((0.0,), (3.0,), (4,)), 2, 0.5, 1e-12, told.append)
    np.testing.assert_allclose(policy.values[:3], [-1.75, -1.5, -1.0])
    assert (policy(np.array([[0.0], [1.0], [2.0]])) == 1).all()
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_a_model_without_rewards_is_refused():
    def broken(states, actions):
        return states, np.full(len(states), np.nan), np.zeros(len(states), bool)

    with pytest.raises(InputError, match="not finite"):
        near_optimal(broken, Grid((0.0,), (3.0,), (4,)), 2, 0.5)


@pytest.mark.parametrize("initial", ["hanging", "distributed"])
def test_refining_the_grid_moves_the_return_by_less_than_half_a_percent(initial):
    task = Pendulum(initial=initial)
    coarse, fine = judged(task, (201, 201)), judged(task, None)
    assert coarse.discounted_return == pytest.approx(fine.discounted_return, rel=0.005)
    assert fine.success_fraction == 1.0


def test_nothing_simple_beats_it():
    task = Pendulum()
    best = judged(task, (151, 151)).discounted_return
    for action in range(3):
        still = evaluate.evaluate(task, lambda s, a=action: np.full(len(s), a))
        assert still.discounted_return < best


def test_the_load_lands_in_the_basket_even_with_a_coarse_grid():
    task = SlungLoad()
    best = judged(task, (20, 27, 21, 13))
    assert best.success_fraction > 0.95
    for action in range(4):
        still = evaluate.evaluate(task, lambda s, a=action: np.full(len(s), a))
        assert still.discounted_return < best.discounted_return


def test_values_are_found_again_unless_anything_changed(folder, monkeypatch):
    task, points = Pendulum(), (21, 21)
    first = near_optimal_policy(task, points)
    files = list(folder.iterdir())
    assert len(files) == 1
    with monkeypatch.context() as patch:
        patch.setattr(evaluate, "near_optimal", None)  # computing would fail
        again = near_optimal_policy(task, points)
    np.testing.assert_array_equal(again.values, first.values)
    near_optimal_policy(task, (21, 23))
    near_optimal_policy(Pendulum(g=5.0), points)
    other = replace(Pendulum.description, gamma=0.9)
    monkeypatch.setattr(Pendulum, "description", other)
    near_optimal_policy(task, points)
    assert len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("damage", ["cut", "empty", "text", "other", "nan"])
def test_a_damaged_file_is_computed_anew(folder, damage):
    task, points = Pendulum(), (21, 21)
    right = near_optimal_policy(task, points).values
    (file,) = folder.iterdir()
    if damage == "other":
        cache.write(file.stem, np.zeros(3))
    elif damage == "nan":
        cache.write(file.stem, np.full(right.shape, np.nan))
    else:
        whole = file.read_bytes()
        file.write_bytes({"cut": whole[: len(whole) // 2], "empty": b"", "text": b"hello"}[damage])
    np.testing.assert_array_equal(near_optimal_policy(task, points).values, right)
    np.testing.assert_array_equal(cache.read(file.stem, right.shape), right)


def test_a_folder_that_cannot_be_written_is_no_error(folder):
    folder.write_text("a file is in the way")
    assert np.isfinite(near_optimal_policy(Pendulum(), (11, 11)).values).all()
    assert folder.read_text() == "a file is in the way"


def test_a_relative_cache_folder_is_not_taken(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert resources.cache_folder() == tmp_path / ".cache" / "iolspi_ros"


def test_looking_further_ahead_makes_up_for_values_that_know_nothing():
    grid = Grid((0.0,), (3.0,), (4,))
    ends = np.array([[0.5], [1.5]])

    def prize(states, actions):
        following, _, ended = walk(states, actions)
        return following, np.where(ended, 1.0, 0.0), ended

    short, far = (NearOptimal(grid, np.zeros(4), prize, 2, 0.5, n) for n in (1, 3))
    assert short(ends).tolist() == [0, 0]
    assert far(ends).tolist() == [1, 1]
