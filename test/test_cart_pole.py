from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iolspi_ros import resources
from iolspi_ros.experiments import cart_pole
from iolspi_ros.experiments.evaluate import evaluate
from sim_nodes.tasks import make_task
from sim_nodes.tasks.cart_pole import CartPole
from sim_nodes.world import World, WorldSettings

TASK = CartPole()
LAGOUDAKIS_AND_PARR = 0.33


def equation_8_1(_, y, force):
    """T Eq. 8-1, written from the paper."""
    g, m, M, l = 9.81, 2.0, 8.0, 0.5  # noqa: E741
    kappa = 1 / (m + M)
    above = g * np.sin(y[0]) - kappa * m * l * y[1] ** 2 * np.sin(2 * y[0]) / 2
    above -= kappa * np.cos(y[0]) * force
    return [y[1], above / (4 * l / 3 - kappa * m * l * np.cos(y[0]) ** 2)]


def exactly(state, force):
    return solve_ivp(equation_8_1, (0, 0.1), state, args=(force,), rtol=1e-8, atol=1e-8).y[:, -1]


@pytest.mark.parametrize("action", [0, 1, 2])
@pytest.mark.parametrize("start", [(0.0, 0.0), (0.8, -2.0), (-1.2, 1.5)])
def test_a_step_integrates_eq_8_1(start, action):
    next_state, _, _ = TASK.step(np.array(start), action, 0.0, 7.0)
    expected = exactly(start, (-50.0, 0.0, 50.0)[action] + 7.0)
    np.testing.assert_allclose(next_state, expected, atol=1e-3)


def test_falling_ends_it_and_costs_one():
    states = np.array([(1.5, 3.0), (-1.5, -3.0), (1.5, -3.0)])
    next_state, reward, ended = TASK.step(states, np.array([1, 1, 1]))
    assert (np.abs(next_state[:, 0]) > np.pi / 2).tolist() == [True, True, False]
    assert ended.tolist() == [True, True, False]
    assert reward.tolist() == [-1.0, -1.0, 0.0]
    for k in range(3):
        alone, r, e = TASK.step(states[k], 1)
        np.testing.assert_array_equal(alone, next_state[k])
        assert (r, e) == (reward[k], ended[k])


def test_the_functions_are_those_of_eq_8_2():
    state = np.array([0.3, -1.4])
    expected = [1.0]
    for alpha in (-np.pi / 4, 0.0, np.pi / 4):
        for rate in (-1.0, 0.0, 1.0):
            expected += [np.exp(-((0.3 - alpha) ** 2 + (-1.4 - rate) ** 2) / 2)]
    np.testing.assert_allclose(cart_pole.basis()(state), expected, rtol=1e-14)


def test_random_episodes_are_whole_and_seeded():
    rng = np.random.default_rng(3)
    found, lengths = cart_pole.random_episodes(TASK, 200, rng)
    assert len(found) == lengths.sum()
    last = np.cumsum(lengths) - 1
    np.testing.assert_array_equal(np.flatnonzero(found.terminated), last)
    assert not found.truncated.any()
    np.testing.assert_array_equal(found.reward, np.where(found.terminated, -1.0, 0.0))
    inner = np.setdiff1d(np.arange(len(found)), last)
    np.testing.assert_array_equal(found.next_state[inner], found.state[inner + 1])
    starts = found.state[np.r_[0, last[:-1] + 1]]
    assert np.std(starts) == pytest.approx(TASK.deviation, rel=0.15)
    for k in (0, 5, 700):  # the force that explains a step is within the noise of its action
        pushes = np.array([exactly(found.state[k], force)[1] for force in (-60.0, 60.0)])
        share = (found.next_state[k, 1] - pushes[0]) / (pushes[1] - pushes[0])
        force = -60.0 + 120.0 * share
        assert abs(force - TASK.description.actions[found.action[k]].value[0]) < 10.5
    again, _ = cart_pole.random_episodes(TASK, 200, np.random.default_rng(3))
    np.testing.assert_array_equal(again.next_state, found.next_state)


def average_by_scipy(deviation, episodes, rng):
    """Length of random episodes, integrated by somebody else's method, to a step's accuracy."""
    lengths = []
    for _ in range(episodes):
        state, steps = deviation * rng.standard_normal(2), 0
        while abs(state[0]) <= np.pi / 2:
            state = exactly(state, rng.choice((-50.0, 0.0, 50.0)) + rng.uniform(-10, 10))
            steps += 1
        lengths.append(steps)
    return np.mean(lengths), np.std(lengths) / np.sqrt(episodes)


def test_a_random_episode_balances_for_about_6_steps():
    """T 8-1, quoting L. From closer to the equilibrium, as both say, Eq. 8-1 takes longer."""
    rng = np.random.default_rng(0)
    wide, near = (
        cart_pole.random_episodes(CartPole(deviation=d), 20_000, rng)[1].mean() - 1.0
        for d in (LAGOUDAKIS_AND_PARR, 0.01)  # the last step falls
    )
    assert wide == pytest.approx(6.0, abs=0.5)
    assert near == pytest.approx(7.9, abs=0.1)
    mean, error = average_by_scipy(0.01, 150, rng)
    assert abs(mean - 1.0 - near) < 3.0 * error


def test_lagoudakis_and_parr_balance_about_2850_steps_after_1000_episodes():
    """Their 100 repetitions, with 10 of their 1,000 evaluations each."""
    features, judged = cart_pole.basis(), []
    task = CartPole(deviation=LAGOUDAKIS_AND_PARR)
    for seed in range(100):
        rng = np.random.default_rng(seed)
        samples, _ = cart_pole.random_episodes(task, 1000, rng)
        found = cart_pole.learn(samples, features, np.zeros((3, 10)))
        steps = cart_pole.balancing_steps(TASK, features, found.solve.weights, 10, rng)
        judged.append(steps.mean())
    mean, half = np.mean(judged), 1.96 * np.std(judged, ddof=1) / 10.0
    print(f"{mean:.0f} ± {half:.0f} balancing steps (95 %) of 3,000")
    assert abs(mean - 2850.0) <= half
    assert half < 150.0


def test_a_policy_that_is_bad_falls_soon():
    steps = cart_pole.balancing_steps(
        TASK, cart_pole.basis(), np.zeros((3, 10)), 50, np.random.default_rng(0)
    )
    assert steps.max() < 10  # always pushes to the left


def test_a_world_pushes_with_uniform_noise():
    world = World(TASK, WorldSettings(uniform_noise=10.0), np.random.default_rng(0))
    rates = []
    for _ in range(500):
        world.state = np.zeros(2)
        rates.append(world.move(0, TASK.description.neutral).state[1])
    bound, _, _ = TASK.step(np.zeros(2), TASK.description.neutral, 0.0, -10.0)
    assert np.abs(rates).max() <= bound[1]
    assert np.std(rates) == pytest.approx(bound[1] / np.sqrt(3), rel=0.1)


def test_success_and_settings():
    assert make_task("cart_pole", {"deviation": 0.5}, "here").initial_states().max() == 0.5
    flown = evaluate(TASK, lambda states: np.full(len(states), TASK.description.neutral))
    assert flown.succeeded.tolist() == (flown.score == 0.0).tolist()  # a fall costs one
    assert {True, False} == set(flown.succeeded.tolist())  # upright at rest, nothing falls


def test_the_wide_functions_are_those_of_the_parameter_file():
    file = resources.find("config", "cart_pole.yaml")
    learner = resources.parameters(file, "learner")
    names = ("low", "high", "centers", "periodic", "normalisation", "width", "buffer_size",
             "samples_per_cell", "refresh_iterations")  # fmt: skip
    for name in names:
        value = learner[name]
        given = tuple(value) if isinstance(value, list) else value
        assert getattr(cart_pole.WIDE, name) == given, name


def test_the_refreshed_learner_balances_from_a_hundred_random_episodes():
    setting = cart_pole.Balancing(episodes=100, wide=True, refreshed=True)
    steps = [cart_pole.balancing(setting, seed)["steps"] for seed in range(6)]
    theirs = [cart_pole.balancing(replace(setting, wide=False, refreshed=False), seed)["steps"]
              for seed in range(6)]  # fmt: skip
    assert np.mean(steps) > np.mean(theirs)
