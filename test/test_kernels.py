import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iolspi_ros.core.buffer import Buffer
from iolspi_ros.core.dual import DualSystem
from iolspi_ros.core.kernels import MOST_CENTERS, Kernels
from iolspi_ros.core.lspi import BlockSystem
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy, policy_of
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.samplesets import samples
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.world import World, WorldSettings

TASK = Pendulum()
PERIODS = np.array([2 * np.pi, 0.0])
STATES = np.random.default_rng(0).uniform((-np.pi, -50.0), (np.pi, 50.0), (2000, 2))
AUTO = LSPISettings(basis="auto", kernels=200, update_interval=250)


def test_the_functions_are_gaussians_of_chords_and_distances():
    """Written with the cosine and sine of the angle, which a turn does not change."""
    basis = Kernels.unseen(PERIODS).around(STATES, 40)[0]
    gain = 1.0 / (basis.scales * basis.width)
    for state in STATES[:20]:
        expected = []
        for center in basis.points:
            flat = [np.array([np.cos(s[0]), np.sin(s[0])]) for s in (state, center)]
            chord = np.linalg.norm(flat[0] - flat[1])
            square = (chord * gain[0]) ** 2 + ((state[1] - center[1]) * gain[1]) ** 2
            expected.append(np.exp(-square / 2))
        np.testing.assert_allclose(basis(state), expected, rtol=1e-9, atol=1e-12)
        turned = state + np.array([2 * np.pi, 0.0])
        np.testing.assert_allclose(basis(turned), expected, rtol=1e-9, atol=1e-12)
        q = basis.weigh(np.ones((2, 40)), state, np.empty(2))
        np.testing.assert_allclose(q, np.sum(expected))


@settings(deadline=None, max_examples=25)
@given(st.integers(1, 10), st.integers(2, 60), st.integers(0, 99))
def test_they_do_not_depend_on_units(n_dims, size, seed):
    """Every state is as near to a centre, measured in ranges, whatever the units are."""
    rng = np.random.default_rng(seed)
    states, units = rng.standard_normal((300, n_dims)), 2.0 ** rng.integers(-20, 20, n_dims)
    none = np.zeros(n_dims)
    one = Kernels.unseen(none).around(states, size)[0]
    other = Kernels.unseen(none).around(states * units, size)[0]
    assert one.size == min(size, MOST_CENTERS**n_dims, 76)
    np.testing.assert_allclose(other.points, one.points * units)
    np.testing.assert_allclose(other(states * units), one(states), rtol=1e-9, atol=1e-12)


def test_centres_are_states_spread_over_all_that_was_seen():
    crowded = np.concatenate([STATES[:300], 0.01 * STATES])
    basis = Kernels.unseen(PERIODS).around(crowded, 60)[0]
    seen = {tuple(row) for row in crowded}
    assert all(tuple(point) in seen for point in basis.points)
    assert len(np.unique(basis.points, axis=0)) == 60
    assert (np.abs(basis.points[:, 1]) < 0.5).mean() < 0.1  # the crowd is 2,000 of 2,300


def test_nothing_new_changes_nothing():
    basis = Kernels.unseen(PERIODS).around(STATES, 100)[0]
    again = basis.around(STATES, 100)[0]
    np.testing.assert_array_equal(again.points, basis.points)
    assert again.width == basis.width


def test_more_of_the_same_leaves_most_centres():
    more = np.random.default_rng(1).uniform((-np.pi, -50.0), (np.pi, 50.0), (500, 2))
    basis = Kernels.unseen(PERIODS).around(STATES, 100)[0]
    grown = basis.around(np.concatenate([STATES, more]), 100)[0]
    stayed = {tuple(p) for p in basis.points} & {tuple(p) for p in grown.points}
    assert len(stayed) > 80


def test_a_policy_and_its_functions_travel_as_one_array():
    basis = Kernels.unseen(PERIODS).around(STATES, 50)[0]
    weights = np.random.default_rng(1).standard_normal((3, 50))
    rows = basis.packed(weights)
    assert rows.shape == (3 + 2 + 1, 50)
    found, same = Kernels.unpacked(rows, 3)
    expected = basis(STATES) @ weights.T
    np.testing.assert_allclose(found(STATES) @ same.T, expected, rtol=1e-9, atol=1e-9)
    few = Kernels.unseen(np.zeros(4))
    found, same = Kernels.unpacked(few.packed(np.ones((2, 1))), 2)
    np.testing.assert_array_equal(found(np.ones(4)) @ same.T, [1.0, 1.0])
    for wrong in (rows[:3], rows[:, :2], rows * np.nan):
        with pytest.raises(InputError, match="a policy with its functions"):
            Kernels.unpacked(wrong, 3)


def test_a_buffer_stays_spread_in_ten_dimensions():
    """A thousand states of everywhere are not pushed out by ten thousand in one place."""
    rng = np.random.default_rng(0)
    wide, near = rng.standard_normal((1000, 10)), 0.01 * rng.standard_normal((10_000, 10))
    _, crowds = Kernels.unseen(np.zeros(10)).around(np.concatenate([wide, near]), 200)
    buffer = Buffer.empty(crowds, 8, 2000, keep_demonstrations=False)
    for states in (wide, near):
        zeros = np.zeros(len(states), int)
        none = zeros.astype(bool)
        buffer = buffer.add(Transitions(states, zeros, zeros * 0.0, states, none, none), 0)
    kept = np.linalg.norm(buffer.transitions.state, axis=1) > 1.0
    assert kept.sum() > 850
    weight = buffer.weight(0, 1.0)
    assert weight[~kept].sum() < 0.1 * weight[kept].sum()


def test_the_pendulum_is_learned_without_a_grid():
    """Nobody gives limits, centres or widths; only that the angle repeats."""
    core = OnlineLSPI(TASK.description, AUTO, np.random.default_rng([0, 1]))
    core.pretrain(samples("set 3", TASK, 0))
    world = World(TASK, WorldSettings(), np.random.default_rng([0, 0]))
    train(world, core, 7, Listener())
    best = evaluate(TASK, near_optimal_policy(TASK)).discounted_return
    found = evaluate(TASK, policy_of(core.weights, core.features)).discounted_return
    assert found / best < 1.01
    assert core.features.size == MOST_CENTERS**2


def test_fewer_samples_than_functions_are_learned_from_too():
    """One unknown for each sample, in place of one for each function and action: the same."""
    rows = samples("set 5", TASK, 0)[::60]
    basis = Kernels.unseen(PERIODS).around(STATES, 100)[0]
    weight = np.random.default_rng(3).uniform(0.1, 1.0, len(rows))
    block = BlockSystem(rows, basis, 3, 0.9, weight, 0.05)
    dual = DualSystem(rows, basis, 3, 0.9, weight, 0.05)
    assert len(rows) < 300
    policy = block.policy(np.random.default_rng(4).standard_normal((3, 100)))
    one, other = dual.evaluate(policy), block.evaluate(policy)
    assert one.healthy
    np.testing.assert_allclose(one.weights, other.weights, rtol=1e-7, atol=1e-7)
    core = OnlineLSPI(TASK.description, AUTO, np.random.default_rng(0))
    assert core.pretrain(rows).healthy


def test_few_samples_make_few_functions():
    assert Kernels.unseen(PERIODS).around(STATES[:80], 500)[0].size == 21
    assert Kernels.unseen(PERIODS).around(STATES[:1], 500)[0].size == 1


def test_acting_is_quick():
    core = OnlineLSPI(
        TASK.description, replace(AUTO, kernels=500, epsilon=0.0), np.random.default_rng(0)
    )
    core.features = Kernels.unseen(PERIODS).around(STATES, 500)[0]
    core.weights = np.random.default_rng(1).standard_normal((3, 500))
    centers, weights = np.random.default_rng(2).random((500, 2)), core.weights

    def plainly(state):
        """Five hundred Gaussians of two variables, weighed for three actions, in numpy alone."""
        return np.argmax(weights @ np.exp(-np.square(centers - state).sum(axis=1)))

    took = {core.act: [], plainly: []}
    for state in STATES:
        for choose, times in took.items():
            start = time.perf_counter()
            choose(state)
            times.append(time.perf_counter() - start)
    acting, plain = (np.median(times[1:]) for times in took.values())
    print(f"act: {1e6 * acting:.1f} µs, numpy {1e6 * plain:.1f} µs")
    assert acting < 2.0 * plain


def test_the_literal_algorithm_has_a_grid():
    with pytest.raises(InputError, match="allowed: refreshed"):
        LSPISettings(algorithm="literal", basis="auto")
