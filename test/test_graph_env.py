"""The graph as an environment of Gymnasium: checked by its own checker, flown by other learners."""

import numpy as np
import pytest

from iolspi_ros.errors import InputError
from iolspi_ros.experiments.headless import make_world

gymnasium = pytest.importorskip("gymnasium")

import msg_bridge.gym  # noqa: E402

msg_bridge.gym.register()  # as the entry point does


@pytest.fixture
def make(domain):
    made = []

    def graph(task="pendulum", **more):
        made.append(gymnasium.make(msg_bridge.gym.ID, task=task, domain=domain, **more))
        return made[-1]

    yield graph
    for env in made:
        env.close()


@pytest.mark.filterwarnings("ignore::UserWarning")  # a limit may be infinite; no render mode
@pytest.mark.parametrize("task", ["pendulum", "gymnasium:CartPole-v1"])
def test_gymnasiums_own_checker_finds_nothing(make, task):
    from gymnasium.utils.env_checker import check_env

    check_env(make(task).unwrapped)


def test_it_flies_what_the_simulator_flies(make):
    env, world = make("slung_load"), make_world("slung_load", None, 11)
    state, _ = env.reset(seed=11)
    rng = np.random.default_rng(0)
    for episode in range(3):
        seen = world.begin(episode)
        np.testing.assert_array_equal(state, seen.state)
        while not seen.last:
            action = int(rng.integers(4))
            state, reward, terminated, truncated, facts = env.step(action)
            seen = world.move(episode, action)
            np.testing.assert_array_equal(state, seen.state)
            assert (reward, terminated, truncated) == (seen.reward, seen.terminated, seen.truncated)
            assert facts == {"step": seen.step, "applied": action, "steps": 1}
        state, _ = env.reset()


def test_an_episode_that_is_left_early_begins_another(make):
    env = make()
    first, _ = env.reset(seed=1)
    env.step(0)
    second, _ = env.reset()
    again, _ = env.reset(seed=1)
    assert (first == again).all()
    assert (first != second).any()


def test_steps_out_of_turn_and_actions_that_are_none_are_refused(make):
    env = make().unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    with pytest.raises(InputError, match="action is 7; allowed: 0 to 2"):
        env.step(7)


def test_a_vehicle_that_is_not_there_is_said(domain):
    with pytest.raises(InputError, match=r"a vehicle on /task did not come within 0.3 s"):
        gymnasium.make(msg_bridge.gym.ID, domain=domain, timeout=0.3)


def test_a_simulator_that_cannot_start_says_why(domain):
    with pytest.raises(InputError, match="task is 'nothing'; allowed"):
        gymnasium.make(msg_bridge.gym.ID, task="nothing", domain=domain, timeout=5.0)


def test_it_takes_the_place_of_a_learner_in_a_graph_that_runs(nodes, domain):
    nodes.start("simulator", "-r", "__ns:=/north", "-p", "task:=cart_pole")
    env = gymnasium.make(msg_bridge.gym.ID, namespace="/north", domain=domain)
    state, _ = env.reset(seed=3)
    assert state.shape == (2,)
    assert not env.step(1)[2]
    env.close()


def test_an_evolution_strategy_learns_to_balance_through_the_graph(make):
    """CMA-ES (N. Hansen's `cma`) on a linear policy: a learner that knows nothing of this house."""
    cma = pytest.importorskip("cma")
    env = make("gymnasium:CartPole-v1")

    def cost(weights):
        state, _ = env.reset(seed=5)
        total, over = 0.0, False
        while not over:
            state, reward, terminated, truncated, _ = env.step(int(state @ weights > 0))
            total, over = total + reward, terminated or truncated
        return -total

    options = {"seed": 1, "maxfevals": 60, "ftarget": -500, "verbose": -9}
    found = cma.fmin2(cost, np.zeros(4), 1.0, options)[1].result
    assert found.fbest == -500


@pytest.mark.slow
def test_stable_baselines_learns_through_the_graph(make):
    sb3 = pytest.importorskip("stable_baselines3")
    env = make("gymnasium:CartPole-v1")
    model = sb3.PPO("MlpPolicy", env, seed=0, device="cpu", n_steps=512)
    model.learn(15_000)
    state, _ = env.reset(seed=9)
    steps, over = 0, False
    while not over:
        state, _, terminated, truncated, _ = env.step(model.predict(state, deterministic=True)[0])
        steps, over = steps + 1, terminated or truncated
    assert steps > 150
