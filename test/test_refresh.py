import numpy as np
import pytest

from iolspi_ros.core.dual import DualSystem
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.learner import update as learn
from iolspi_ros.core.lspi import BlockSystem, greedy
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.reduced import ReducedSystem
from iolspi_ros.core.refresh import refresh
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.core.solve import Solve, plausible, solve_system
from iolspi_ros.experiments.evaluate import evaluate, near_optimal_policy, policy_of
from iolspi_ros.experiments.headless import Listener, train
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.world import World, WorldSettings

TASK = Pendulum()


def uniform(n, seed=0):
    rng = np.random.default_rng(seed)
    states = rng.uniform(TASK.description.low, TASK.description.high, (n, 2))
    actions = rng.integers(3, size=n)
    following, reward, ended = TASK.step(states, actions)
    return Transitions(states, actions, reward, following, ended, ended)


def learner(seed=0, **changes):
    settings = LSPISettings(**{"centers": (11, 11)} | changes)
    return OnlineLSPI(TASK.description, settings, np.random.default_rng([seed, 1]))


def test_far_off_values_are_not_plausible():
    reward = np.array([-1.0, 0.5])
    assert plausible(np.array([99.0]), reward, 0.9)
    assert not plausible(np.array([-101.0]), reward, 0.9)
    assert not plausible(np.array([np.nan]), reward, 0.9)


def test_the_scale_of_gamma_is_that_of_its_eigenvalues():
    """Four functions far apart, three of them seen: Γ is a diagonal."""
    basis = RBFGrid((0.0,), (30.0,), (4,), width=0.05)
    state = np.repeat([[0.0], [10.0], [20.0]], (8, 4, 4), axis=0)
    action, none = np.repeat([0, 1, 0], (8, 4, 4)), np.zeros(16, bool)
    rows = Transitions(state, action, np.zeros(16), state, none, none)
    expected = (8.0**2 + 4.0**2 + 4.0**2) / 16.0
    for kind in (ReducedSystem, DualSystem):
        assert kind(rows, basis, 2, 0.9, np.ones(16), 1e-4).scale == pytest.approx(expected)
    empty = ReducedSystem(rows[:0], basis, 2, 0.9, np.ones(0), 1e-4)
    assert empty.scale == 1.0


@pytest.mark.parametrize(("cut", "error"), [(0.0, 1e-8), (1e-3, 3e-3)])
def test_directions_left_out_change_little(monkeypatch, cut, error):
    """Values of two policies, one after the other, against those with every function."""
    monkeypatch.setattr("iolspi_ros.core.reduced.CUT", cut)
    t, basis = uniform(900), LSPISettings(centers=(9, 9)).resolve(TASK.description).features()
    ended = np.arange(900) % 7 == 0
    t = Transitions(t.state, t.action, t.reward, t.next_state, ended, ~ended)
    weight = np.random.default_rng(3).uniform(0.1, 1.0, 900)
    reduced = ReducedSystem(t, basis, 3, 0.95, weight, 2e-4)
    block = BlockSystem(t, basis, 3, 0.95, weight, reduced.delta)
    rng = np.random.default_rng(4)
    for policy in rng.integers(3, size=(2, 900)):
        found, exact = reduced.evaluate(policy), block.evaluate(policy)
        assert found.healthy
        assert found.rank == 3 * basis.size
        assert len(reduced.target) < 3 * basis.size or cut == 0.0
        values, true = (s.values(f.weights) for s, f in ((reduced, found), (block, exact)))
        np.testing.assert_allclose(values, true, atol=error * np.abs(true).max())


def test_one_unknown_for_each_sample_gives_the_same_as_one_for_each_function():
    """Weights, values, scale and predictions, for a policy of each kind."""
    t, basis = uniform(500), LSPISettings(centers=(9, 7)).resolve(TASK.description).features()
    ended = np.arange(500) % 7 == 0
    t = Transitions(t.state, t.action, t.reward, t.next_state, ended, ~ended)
    weight = np.random.default_rng(3).uniform(0.1, 1.0, 500)
    block = BlockSystem(t, basis, 3, 0.9, weight, 0.05)
    dual = DualSystem(t, basis, 3, 0.9, weight, 0.05)
    start = np.random.default_rng(4).standard_normal((3, basis.size))
    np.testing.assert_array_equal(dual.policy(start), block.policy(start))
    one, other = (system.evaluate(system.policy(start)) for system in (dual, block))
    assert one.healthy
    np.testing.assert_allclose(one.weights, other.weights, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(dual.values(start), block.values(start), atol=1e-10)


def test_from_samples_of_everywhere_it_is_near_optimal_at_once():
    core = learner()
    update = core.pretrain(uniform(6000))
    assert update.accepted
    assert update.refresh.converged
    best = evaluate(TASK, near_optimal_policy(TASK)).discounted_return
    found = evaluate(TASK, policy_of(core.weights, core.features)).discounted_return
    assert found / best < 1.01


def test_it_learns_online_from_nothing():
    """Within 40 s of vehicle time; the literal algorithm takes 300 s (T V)."""
    core = learner()
    world = World(TASK, WorldSettings(), np.random.default_rng([0, 0]))
    train(world, core, 27, Listener())
    best = evaluate(TASK, near_optimal_policy(TASK)).discounted_return
    found = evaluate(TASK, policy_of(core.weights, core.features)).discounted_return
    assert found / best < 1.02


def test_what_is_flown_is_greedy_to_its_own_values():
    """Converged: the policy that the weights were solved for is the one they choose."""
    core = learner()
    update = core.pretrain(uniform(6000))
    rows = core.buffer.transitions
    chosen = greedy(core.weights, core.features(rows.next_state, rows.terminated))
    np.testing.assert_array_equal(update.iteration.policy, chosen)
    again = refresh(core.buffer, 0, core.features, core.task, core.settings, core.weights)
    assert again.record.iterations <= 2  # nothing is left to do
    np.testing.assert_allclose(again.weights, core.weights, rtol=1e-6, atol=1e-6)


class Swinging:
    """Policy iteration on it never ends: each policy makes the other greedy; more δ settles it."""

    scale = 1.0

    def __init__(self, *_, **__):
        self.delta = 0.0

    def policy(self, weights):
        return np.array([int(weights[0, 0] > 0.5)])

    def evaluate(self, policy):
        value = 1.0 if self.delta > SETTLED else float(1 - policy[0])
        return Solve(np.array([[value]]), 1.0, 1, 0.0, "ok")

    def values(self, weights):
        return np.zeros(1)


SETTLED = 1e-3


@pytest.mark.parametrize(("settled", "rungs"), [(0.0, 1), (1e-3, 2), (1e-2, 3), (1.0, 3)])
def test_more_delta_is_tried_until_it_converges(monkeypatch, settled, rungs):
    monkeypatch.setattr("test_refresh.SETTLED", settled)
    monkeypatch.setattr("iolspi_ros.core.refresh.ReducedSystem", Swinging)
    core = learner(centers=(1, 1))
    rows = uniform(20)
    before = np.zeros((3, 1))
    found = refresh(core.buffer.add(rows, 20), 20, core.features, core.task, core.settings, before)
    assert found.record.rungs == rungs
    assert found.record.converged == (settled < 1.0)
    assert (found.weights is before) == (settled == 1.0)
    assert ("stay" in found.record.describe()) == (settled == 1.0)
    assert found.record.stop == ("oscillating" if settled == 1.0 else "converged")


def test_solves_that_are_not_healthy_are_never_flown():
    """A reward without end: nothing healthy can come of it."""
    core = learner(update_interval=5, centers=(4, 3))
    before = core.weights
    state = np.array([1.0, 2.0])
    for _ in range(5):
        core.observe(Transition(state, 0, 1e308, state))
    update = learn(core)
    assert not update.solve.healthy
    assert not update.accepted
    assert update.refresh.stop == "unhealthy"
    assert core.weights is before
    assert "stay" in update.text


def test_the_budget_of_time_is_kept_to_one_policy():
    core = learner(refresh_budget=1e-9)
    update = core.pretrain(uniform(2000))
    assert update.iteration.iterations == 1
    assert update.refresh.iterations == 1


def test_an_ill_conditioned_solve_is_told_from_a_singular_one():
    for order, status in ((6, "ok"), (10, "ill-conditioned"), (14, "singular")):
        hilbert = 1.0 / (np.arange(order)[:, None] + np.arange(order) + 1)
        assert solve_system(hilbert, np.ones(order)).status == status
