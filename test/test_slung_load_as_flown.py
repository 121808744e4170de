"""The slung load as an autopilot flies it: late, with a lag, against the air."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate
from sim_nodes.tasks import make_task
from sim_nodes.tasks.base import Compiled, Stateful
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad
from sim_nodes.tasks.slung_load.as_flown import AsFlown
from sim_nodes.world import WorldSettings, make_world

LATE = {"delay": 0.1, "lag": 0.14, "drag": 1.2, "gain": 1.1}
DIFFERENT = LATE | {f"{name}_spread": 0.5 for name in LATE} | {"push_spread": 0.4}


def vehicle(**values):
    return make_task("slung_load", values, "here.yaml")


def flown(task, seed, actions):
    rows = [task.begin(seed)]
    rows += [task.advance(action)[0] for action in actions]
    return np.array(rows)


# ------------------------------------------------------------ without it


def test_by_default_it_is_the_thesis_own():
    spread_alone = vehicle(delay_spread=0.5, lag_spread=0.5, drag_spread=1.0)
    for task in (vehicle(), spread_alone):
        assert isinstance(task, SlungLoad)
        assert isinstance(task, Compiled)
        assert not isinstance(task, Stateful)
        assert task.as_flown() is None
    for name, value in (*LATE.items(), ("push_spread", 0.1), ("gain_spread", 0.1)):
        assert isinstance(vehicle(**{name: value}), Stateful), name


def test_with_nothing_set_a_world_has_the_bits_that_it_had():
    task, plain = vehicle(drag_spread=1.0), SlungLoad()
    world = make_world(task, WorldSettings(), np.random.default_rng(3))
    draws, chosen = np.random.default_rng(3), np.random.default_rng(0)
    for episode in range(5):
        seen, state = world.begin(episode), plain.draw_initial(draws)
        while not seen.last:
            action = int(chosen.integers(3))
            np.testing.assert_array_equal(seen.state, state)
            seen = world.move(episode, action)
            state, reward, _ = plain.step(state, action)
            assert seen.reward == reward


# ------------------------------------------------------------ how it answers


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.25])
@pytest.mark.parametrize(("lag", "drag"), [(0.0, 1.2), (0.2, 0.0), (0.14, 1.2), (1e-6, 0.3)])
def test_it_answers_as_the_equations_say(delay, lag, drag):
    """Against an independent integration of them, each piece between two jumps for itself."""
    actions = (2, 2, 0, 1, 0, 2, 2, 1, 2)
    task = vehicle(delay=delay, lag=lag, drag=drag, gain=1.1, push_spread=0.5)
    found = flown(task, 4, actions)
    asked = np.array([0.0, *(3.0 * (action - 1) for action in actions)])  # before the first: none

    def equations(time, y, command):
        _, speed, angle, rate, held = y
        a = (held if lag else 1.1 * command) - drag * speed + task.response.push
        answers = (1.1 * command - held) / lag if lag else 0.0
        return [speed, a, rate, -np.cos(angle) * a - 9.81 * np.sin(angle), answers]

    jumps = delay + 0.1 * np.arange(len(actions))
    edges = np.unique(np.concatenate([0.1 * np.arange(len(actions) + 1), jumps]).round(9))
    y, at = np.array([*found[0], 0.0]), {0.0: found[0]}
    for begin, end in pairwise(edges):
        command = asked[np.count_nonzero(jumps <= begin + 1e-9)]
        if end <= 0.9 + 1e-9:
            y = solve_ivp(equations, (begin, end), y, "Radau", args=(command,), rtol=1e-8).y[:, -1]
            at[round(end, 9)] = y[:4]
    expected = [at[round(0.1 * n, 9)] for n in range(len(actions) + 1)]
    np.testing.assert_allclose(found, expected, atol=0.06)
    assert np.ptp(found[:, 1]) > 0.2


def test_a_swing_does_not_grow_by_itself():
    """T's own step, of 0.1 s by Euler's method, lets it grow by 5 % each time."""
    late, own = vehicle(delay=0.1), SlungLoad()
    state = late.begin(7)
    swing = 9.81 * (1.0 - np.cos(state[2]))
    after = flown(late, 7, [1] * 10)[-1]
    assert after[3] ** 2 / 2.0 + 9.81 * (1.0 - np.cos(after[2])) == pytest.approx(swing, rel=0.06)
    for _ in range(10):
        state, _, _ = own.step(state, 1)
    assert state[3] ** 2 / 2.0 + 9.81 * (1.0 - np.cos(state[2])) > 2.0 * swing


def test_rewards_and_ends_are_the_tasks():
    task, own = vehicle(**LATE), SlungLoad()
    before = task.begin(1)
    for action in (0, 2, 2):
        after, reward, ended, cut = task.advance(action)
        assert (reward, ended, cut) == (*own.judge(before, after), False)
        before = after
    told_apart = 0
    for seed in range(200):  # a release is judged on the state left
        before = flown(task, seed, (2, 2, 2))[-1]
        after, reward, ended, _ = task.advance(RELEASE)
        assert ended
        assert reward == own.landed(own.landing(before))
        told_apart += reward != own.landed(own.landing(after))
    assert told_apart > 3
    ends = set()
    for seed in range(3):
        task.begin(seed)
        for _ in range(60):
            _, reward, ended, _ = task.advance(2)
            if ended:
                ends.add(reward)
                break
    assert ends <= {-50.0, -150.0}
    assert ends


# ------------------------------------------------------------ what differs between episodes


def test_answers_differ_between_episodes_and_follow_from_the_seed():
    task = vehicle(**DIFFERENT)
    drawn = []
    for seed in range(300):
        task.begin(seed)
        drawn.append(task.response)
    low, high = np.min(drawn, axis=0), np.max(drawn, axis=0)
    np.testing.assert_allclose(low, [0.05, 0.07, 0.6, -0.4, 0.55], rtol=0.03)
    np.testing.assert_allclose(high, [0.15, 0.21, 1.8, 0.4, 1.65], rtol=0.03)
    assert np.abs(np.corrcoef(np.transpose(drawn)) - np.eye(5)).max() < 0.2
    actions = (0, 2, 2, 0, 1)
    np.testing.assert_array_equal(flown(task, 5, actions), flown(task.fresh(), 5, actions))
    same_start = vehicle(**LATE)
    assert np.array_equal(same_start.begin(5), task.begin(5))
    assert not np.array_equal(flown(same_start, 5, actions), flown(task, 5, actions))


def test_nothing_of_an_episode_is_left_in_the_next():
    task = vehicle(**DIFFERENT)
    first = flown(task, 5, (2, 2, 0))
    flown(task, 6, (0, 0, 0, 0))
    np.testing.assert_array_equal(flown(task, 5, (2, 2, 0)), first)


def test_a_world_draws_them_from_its_own_generator():
    def responses(seed):
        task = vehicle(**DIFFERENT)
        world, found = make_world(task, WorldSettings(), np.random.default_rng(seed)), []
        for episode in range(5):
            world.begin(episode)
            found.append(task.response)
        return found

    assert responses(0) == responses(0)
    assert responses(0) != responses(1)
    assert len(set(responses(0))) == 5


def test_policies_are_judged_on_it():
    task = vehicle(**DIFFERENT)
    found = evaluate(task, lambda states: np.full(len(states), 1))
    assert found.states.shape == (51, 143, 4)
    assert not found.succeeded.any()
    held = evaluate(task, lambda states: np.full(len(states), RELEASE))
    assert 0.0 < held.success_fraction < 0.5


# ------------------------------------------------------------ what is refused


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"delay": -0.1}, "delay is -0.1"),
        ({"delay": 0.4}, "delay is 0.4"),
        ({"delay": 0.2, "delay_spread": 0.6}, "delay with its spread"),
        ({"lag": float("nan")}, "lag is nan"),
        ({"drag": -1.0}, "drag is -1.0"),
        ({"drag": 9.0}, "drag is 9.0"),
        ({"drag_spread": 1.1}, "drag_spread is 1.1"),
        ({"lag_spread": -0.1}, "lag_spread is -0.1"),
        ({"gain": 0.0}, "gain is 0.0"),
        ({"push_spread": float("inf")}, "push_spread is inf"),
        ({"drag": 1}, "write 1.0, not 1"),
    ],
)
def test_what_no_vehicle_answers_like_is_refused(values, why):
    with pytest.raises(InputError, match=why):
        vehicle(**values)


def test_it_does_not_move_before_an_episode():
    task = vehicle(**LATE)
    assert isinstance(task, AsFlown)
    with pytest.raises(InputError, match="no episode has begun"):
        task.advance(1)
