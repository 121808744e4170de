import numpy as np
import pytest

from iolspi_ros.core.reference import Grid, near_optimal
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy
from sim_nodes.tasks import Pendulum


def test_interpolation_is_exact_for_what_is_linear():
    grid = Grid((-1.0, 0.0), (1.0, 4.0), (5, 3), (False, False))
    states = np.random.default_rng(0).uniform((-1, 0), (1, 4), (50, 2))
    values = 2.0 * grid.points[:, 0] - 3.0 * grid.points[:, 1] + 1.0
    np.testing.assert_allclose(
        grid.interpolation(states) @ values, 2.0 * states[:, 0] - 3.0 * states[:, 1] + 1.0
    )


def test_a_periodic_dimension_wraps():
    grid = Grid((-np.pi,), (np.pi,), (360,), (True,))
    near = grid.interpolation(np.array([[np.pi - 1e-9], [-np.pi + 1e-9]])).toarray()
    np.testing.assert_allclose(near[0], near[1], atol=1e-6)


def test_a_walk_to_the_end_has_the_value_of_its_discounted_steps():
    """Each step right costs 1, the end is at 3: V(x) is a geometric sum."""

    def step(states, actions):
        following = np.clip(states + np.where(actions == 1, 1.0, -1.0)[:, None], 0.0, 3.0)
        return following, np.full(len(states), -1.0), following[:, 0] >= 3.0

    policy = near_optimal(step, Grid((0.0,), (3.0,), (4,), (False,)), 2, 0.5, 1e-12)
    np.testing.assert_allclose(policy.values[:3], [-1.75, -1.5, -1.0])
    assert (policy(np.array([[0.0], [1.0], [2.0]])) == 1).all()


@pytest.mark.parametrize("initial", ["hanging", "distributed"])
def test_refining_the_grid_moves_the_return_by_less_than_half_a_percent(initial):
    task = Pendulum(initial=initial)
    coarse, fine = (evaluate(task, near_optimal_policy(task, n)) for n in (201, 301))
    assert coarse.discounted_return == pytest.approx(fine.discounted_return, rel=0.005)
    assert fine.success_fraction == 1.0


def test_nothing_simple_beats_it():
    task = Pendulum()
    best = evaluate(task, near_optimal_policy(task, 151)).discounted_return
    for action in range(3):
        still = evaluate(task, lambda s, a=action: np.full(len(s), a))
        assert still.discounted_return < best
