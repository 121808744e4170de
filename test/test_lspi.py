import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.lspi import BlockSystem, greedy, offline_lspi
from iolspi_ros.core.moments import Moments, accumulate
from iolspi_ros.core.samples import Transitions
from iolspi_ros.core.solve import solve

GAMMA = 0.9


class Tabular:
    """One function per state: LSPI on it is exact policy iteration."""

    def __init__(self, size):
        self.size = size

    def __call__(self, states, terminated=None):
        phi = np.eye(self.size)[states[:, 0].astype(int)]
        if terminated is not None:
            phi[terminated] = 0.0
        return phi


def problem(seed, n_states, n_actions, ends):
    """Every state and action of a deterministic problem once, as samples."""
    rng = np.random.default_rng(seed)
    state, action = (a.ravel() for a in np.indices((n_states, n_actions)))
    following = rng.integers(n_states, size=len(state))
    reward = rng.standard_normal(len(state))
    terminated = rng.random(len(state)) < ends
    return Transitions(
        state[:, None].astype(float), action, reward, following[:, None].astype(float),
        terminated, np.zeros(len(state), bool),
    )  # fmt: skip


def policy_iteration(t, n_states, n_actions):
    """Exact Q of the best policy, by solving the Bellman equations of each policy."""
    following = t.next_state[:, 0].astype(int).reshape(n_states, n_actions)
    reward = t.reward.reshape(n_states, n_actions)
    alive = ~t.terminated.reshape(n_states, n_actions)
    policy = np.zeros(n_states, int)
    while True:
        rows = np.arange(n_states)
        matrix = np.eye(n_states)
        np.add.at(matrix, (rows, following[rows, policy]), -GAMMA * alive[rows, policy])
        values = np.linalg.solve(matrix, reward[rows, policy])
        q = reward + GAMMA * alive * values[following]
        better = q.argmax(axis=1)
        if (better == policy).all() or np.allclose(q.max(axis=1), values):
            return q
        policy = better


def run(t, features, n_actions, weights, **options):
    options = {"gamma": GAMMA, "delta": 0.0, "chi": 1e-9, "max_iterations": 50} | options
    return offline_lspi(t, features, n_actions, weights=weights, **options)[0]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 7), st.integers(1, 4), st.sampled_from([0, 0.3]))
def test_on_a_table_it_is_exact_policy_iteration(seed, n_states, n_actions, ends):
    t = problem(seed, n_states, n_actions, ends)
    start = np.random.default_rng(seed).standard_normal((n_actions, n_states))
    result = run(t, Tabular(n_states), n_actions, start)
    assert result.stop == "converged"
    expected = policy_iteration(t, n_states, n_actions)
    np.testing.assert_allclose(result.solve.weights.T, expected, atol=1e-8)


@pytest.mark.parametrize("last", [(), (1,), (0, 2)])
def test_weights_agree_with_least_squares_written_out(last):
    """Also when nothing follows after the `last` actions, which are then solved first."""
    rng = np.random.default_rng(1)
    n, size, actions = 200, 5, 3
    phi, following = rng.standard_normal((2, n, size))
    a, b = rng.integers(actions, size=(2, n))
    r = rng.standard_normal(n)
    following[np.isin(a, last)] = 0.0
    moments = accumulate(Moments.empty(actions, size, 0.1), phi, a, r, following, b)
    full = np.zeros((n, actions * size))
    later = np.zeros((n, actions * size))
    for k in range(n):
        full[k, a[k] * size : (a[k] + 1) * size] = phi[k]
        later[k, b[k] * size : (b[k] + 1) * size] = following[k]
    matrix = full.T @ (full - GAMMA * later) + 0.1 * np.eye(actions * size)
    expected = np.linalg.lstsq(matrix, full.T @ r, rcond=None)[0]
    for scaling in ("samples", "weights"):
        found = solve(moments, GAMMA, scaling)
        np.testing.assert_allclose(found.weights.ravel(), expected, rtol=1e-9)
        assert found.healthy
        assert found.rank == actions * size
        if not last:  # in parts it is that of the worst part
            exact = np.linalg.cond(matrix, 1)
            assert exact / 10 < found.condition < exact * 10
        assert found.residual < 1e-12


def test_an_end_counts_zero_and_a_cut_does_not():
    """One state that stays: ended, it is worth its reward; cut, reward / (1 - γ)."""
    for ended, worth in ((True, 1.0), (False, 1.0 / (1.0 - GAMMA))):
        one = np.zeros((1, 1))
        t = Transitions(
            one, np.zeros(1, int), np.ones(1), one, np.array([ended]), np.array([not ended])
        )
        result = run(t, Tabular(1), 1, np.zeros((1, 1)))
        assert result.solve.weights[0, 0] == pytest.approx(worth)


def test_states_never_seen_make_the_solve_singular_and_it_says_so():
    t = problem(0, 3, 2, 0.0)[:4]  # nothing of the last state's actions
    result = run(t, Tabular(3), 2, np.zeros((2, 3)))
    assert result.solve.status == "singular"
    assert result.solve.rank == 4
    assert not result.solve.healthy
    assert np.isfinite(result.solve.weights).all()


def test_infinite_moments_are_reported():
    moments = Moments.empty(1, 2, 1.0)
    moments.reward[0, 0] = np.inf
    assert solve(moments, GAMMA).status == "non-finite"


class Bumps:
    size = 4

    def __call__(self, states, terminated=None):
        phi = np.exp(-8.0 * (states - np.linspace(-1, 1, self.size)) ** 2)
        if terminated is not None:
            phi[terminated] = 0.0
        return phi


def test_a_cycle_is_recognised():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        states, following = rng.uniform(-1, 1, (2, 30, 1))
        none = np.zeros(30, bool)
        t = Transitions(
            states, rng.integers(2, size=30), rng.standard_normal(30), following, none, none
        )
        result = run(t, Bumps(), 2, rng.standard_normal((2, 4)), gamma=0.95, delta=1e-3)
        if result.stop == "oscillating":
            break
    else:
        pytest.fail("no set of samples oscillated")
    # Once round the cycle, by hand: the policy on the samples is the same again.
    weights = result.solve.weights
    first = greedy(weights, Bumps()(t.next_state))
    for step in range(1, result.period + 1):
        again = run(t, Bumps(), 2, weights, gamma=0.95, delta=1e-3, max_iterations=1)
        weights = again.solve.weights
        same = (greedy(weights, Bumps()(t.next_state)) == first).all()
        assert same == (step == result.period)


def test_the_cap_and_the_caller_stop_it():
    t = problem(3, 6, 3, 0.0)
    start = np.random.default_rng(0).standard_normal((3, 6))
    assert run(t, Tabular(6), 3, start, max_iterations=1).stop == "cap"
    assert run(t, Tabular(6), 3, start, proceed=lambda share: False).stop == "interrupted"


def test_ties_are_broken_at_random():
    rng = np.random.default_rng(0)
    chosen = greedy(np.ones((3, 2)), np.ones((3000, 2)), rng)
    counts = np.bincount(chosen, minlength=3)
    assert (abs(counts - 1000) < 150).all()
    assert (greedy(np.ones((3, 2)), np.ones((5, 2))) == 0).all()


@pytest.mark.parametrize("weighted", [False, True])
def test_moving_samples_to_another_policy_s_blocks_is_summing_them_up_anew(weighted):
    """Λ = Σ w φ(s, a) φ(s', b)ᵀ, one sample at a time, for one policy after the other."""
    rng, n, n_actions = np.random.default_rng(5), 300, 3
    grid = RBFGrid((-1.0, -1.0), (1.0, 1.0), (3, 3))
    state, next_state = rng.uniform(-1.0, 1.0, (2, n, 2))
    action, last = rng.integers(n_actions, size=n), rng.random(n) < 0.1
    samples = Transitions(state, action, rng.standard_normal(n), next_state, last, last)
    weight = rng.uniform(0.5, 2.0, n) if weighted else np.ones(n)
    system = BlockSystem(samples, grid, n_actions, 0.9, weight, 1e-3)
    policy = rng.integers(n_actions, size=n)
    for changed in (0.0, 0.02, 0.7, 1.0, 0.0):
        policy = np.where(rng.random(n) < changed, rng.integers(n_actions, size=n), policy)
        wanted = np.zeros((n_actions, grid.size, n_actions, grid.size))
        for k in range(n):
            here, there = grid(state[k : k + 1])[0], grid(next_state[k : k + 1])[0]
            wanted[action[k], :, policy[k]] += weight[k] * np.outer(here, there) * (not last[k])
        before = system.moments(policy)
        np.testing.assert_allclose(before.cross, wanted, rtol=1e-12, atol=1e-12)
        kept = before.cross.copy()
        system.moments(rng.integers(n_actions, size=n))
        np.testing.assert_array_equal(before.cross, kept)  # what was handed out stays as it was
