import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iolspi_ros.errors import InputError
from iolspi_ros.methods.tabular import (
    Episode,
    fly,
    greedy,
    initial,
    learn,
    optimal_values,
)
from iolspi_ros.task.finite import FiniteTask

LEFT, RIGHT = 0, 1


def corridor(horizon=6):
    """Five rooms; the last is the goal, a puddle is in the first."""
    rooms = np.arange(5)
    successor = np.stack([np.maximum(rooms - 1, 0), np.minimum(rooms + 1, 4)], axis=1)
    arrival = np.array([-3.0, 0.0, 0.0, 0.0, 0.0])
    times = np.arange(horizon + 1.0)
    return FiniteTask(successor.astype(np.int32), arrival, rooms == 4, -(times**2), -60.0)


def random_task(seed, horizon=5):
    rng = np.random.default_rng(seed)
    successor = rng.integers(0, 7, (7, 3)).astype(np.int32)
    return FiniteTask(successor, rng.normal(size=7), rng.random(7) < 0.3,
                      rng.normal(size=horizon + 1), -5.0)  # fmt: skip


def returns(task, state, step=0):
    """Return of every sequence of actions, one after the other."""
    for action in range(task.successor.shape[1]):
        following = int(task.successor[state, action])
        reward = task.arrival[following]
        if task.goal[following]:
            yield reward + task.reached[step + 1]
        elif step + 1 == task.horizon:
            yield reward + task.missed
        else:
            yield from (reward + rest for rest in returns(task, following, step + 1))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_optimal_values_are_the_best_of_all_sequences(seed):
    task = random_task(seed)
    values = optimal_values(task)
    for state in range(7):
        assert values[0, state] == pytest.approx(max(returns(task, state)))
    assert values[-1] == pytest.approx(-5.0)


def test_an_episode_is_flown():
    episode = fly(corridor(), 2, [LEFT, RIGHT])
    assert episode.states.tolist() == [2, 1, 2, 3, 4]
    assert episode.rewards.tolist() == [0.0, 0.0, 0.0, -16.0]
    lost = fly(corridor(), 1, [LEFT])
    assert lost.rewards.tolist() == [-3.0] * 5 + [-63.0]
    assert lost.score == -78.0


def test_demonstrated_values_are_the_mean_of_all_visits():
    task = corridor()
    episodes = [fly(task, 1, [LEFT, RIGHT]), fly(task, 1, [RIGHT]), fly(task, 2, [LEFT, RIGHT])]
    seen = {}
    for episode in episodes:
        for k, pair in enumerate(zip(episode.states, episode.actions, strict=False)):
            seen.setdefault(pair, []).append(episode.rewards[k:].sum())
    assert len(seen[1, RIGHT]) == 3
    q = initial(task, -50.0, episodes)
    for state in range(5):
        for action in range(2):
            expected = np.mean(seen.get((state, action), [-50.0]))
            assert q[state, action] == pytest.approx(expected)


def by_hand(task, q, starts, episodes, epsilon, alpha, rng):
    """T Algorithm 9, line by line, for values that are never equal."""
    q, scores = q.copy(), []
    for _ in range(episodes):
        state, path = starts[rng.integers(0, len(starts))], []
        for k in range(task.horizon):
            exploring = rng.random() < epsilon
            action = rng.integers(0, q.shape[1]) if exploring else np.argmax(q[state])
            following = task.successor[state, action]
            reward = task.arrival[following]
            if task.goal[following]:
                reward += task.reached[k + 1]
            elif k + 1 == task.horizon:
                reward += task.missed
            path.append((state, action, reward))
            state = following
            if task.goal[following]:
                break
        for j, (state, action, _) in enumerate(path):
            onward = sum(reward for _, _, reward in path[j:])
            q[state, action] += alpha * (onward - q[state, action])
        scores.append(sum(reward for _, _, reward in path))
    return q, np.array(scores)


@pytest.mark.parametrize("seed", range(4))
def test_learning_is_algorithm_9(seed):
    task, starts = random_task(seed, 9), np.array([0, 3, 6])
    q = np.random.default_rng(seed).normal(size=(7, 3))
    expected, scores = by_hand(task, q, starts, 60, 0.3, 0.1, np.random.default_rng(5))
    found = learn(task, q, starts, 60, epsilon=0.3, alpha=0.1, rng=np.random.default_rng(5))
    np.testing.assert_allclose(found.q, expected, rtol=1e-12)
    np.testing.assert_allclose(found.scores, scores, rtol=1e-12)
    assert found.visits.sum() >= 60
    untouched = found.visits == 0
    np.testing.assert_array_equal(found.q[untouched], q[untouched])


def test_it_finds_the_best_way():
    task = corridor()
    for start in (0, 1, 2, 3):
        found = learn(task, initial(task, 0.0), np.array([start]), 2000, epsilon=0.1, alpha=0.1,
                      rng=np.random.default_rng(start))  # fmt: skip
        best = optimal_values(task)[0, start]
        assert greedy(task, found.q, start).score == best == -((4.0 - start) ** 2)


def test_equal_values_are_drawn_from():
    task = FiniteTask(np.ones((2, 3), np.int32), np.zeros(2), np.array([False, True]),
                      np.zeros(2), 0.0)  # fmt: skip
    q = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 0.0]])
    found = learn(task, q, np.array([0]), 3000, epsilon=0.0, alpha=0.0,
                  rng=np.random.default_rng(0))  # fmt: skip
    first, second, third = found.visits[0]
    assert second == 0
    assert abs(first - third) < 200


def test_a_demonstration_is_followed_at_once():
    task = corridor()
    q = initial(task, -50.0, [fly(task, 1, [RIGHT])])
    assert greedy(task, q, 1).actions.tolist() == [RIGHT] * 3
    blind = initial(task, 0.0, [fly(task, 1, [RIGHT])])  # T 5-3-2: zero makes it shun them
    assert greedy(task, blind, 1).actions[0] == LEFT


def test_rates_are_checked():
    task = corridor()
    with pytest.raises(InputError, match=r"epsilon is 1.5; allowed: \[0.0, 1.0\]"):
        learn(task, initial(task, 0.0), np.array([0]), 1, epsilon=1.5, alpha=0.1,
              rng=np.random.default_rng(0))  # fmt: skip
    assert isinstance(greedy(task, initial(task, 0.0), 0), Episode)
