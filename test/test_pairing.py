import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from iolspi_ros import wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.pairing import Pairer
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum.description
STATES = wire.states(TASK)
REWARDS = wire.RewardRows()


def messages(lengths):
    """State and reward of every observation; no two states are alike."""
    sent, stamp = [], 0
    for episode, length in enumerate(lengths):
        for step in range(length + 1):
            stamp += 5_000_000
            state = np.array([episode, step], float)
            o = Observation(
                episode, step, state, 100.0 * episode + step, (episode + step) % 3,
                truncated=step == length, stamp=stamp,
            )  # fmt: skip
            sent.append(("state", STATES.of(o)))
            sent.append(("reward", REWARDS.of(o)))
    return sent


def feed(arriving):
    pairer, formed = Pairer(TASK), []
    for topic, message in arriving:
        observation = getattr(pairer, topic)(message)
        if observation is not None:
            formed += pairer.transitions(observation)
    return formed


def check(formed):
    """Each transition is a true one, and none comes twice."""
    keys = [(before.episode, before.step) for before, _ in formed]
    assert len(keys) == len(set(keys))
    for (episode, step), (_, t) in zip(keys, formed, strict=True):
        assert t.state.tolist() == [episode, step]
        assert t.next_state.tolist() == [episode, step + 1]
        assert t.reward == 100.0 * episode + step + 1
        assert t.action == (episode + step + 1) % 3
    return set(keys)


lengths = st.lists(st.integers(1, 8), min_size=1, max_size=4)


@settings(deadline=None)
@given(lengths, st.randoms(use_true_random=False))
def test_lost_doubled_and_out_of_order_messages_form_no_wrong_transition(lengths, random):
    sent = messages(lengths)
    kept = [m for m in sent if random.random() > 0.1]
    doubled = kept + [m for m in kept if random.random() < 0.2]
    random.shuffle(doubled)
    found = check(feed(doubled))
    # All that could be formed were: both observations had arrived whole.
    arrived = {}
    for topic, message in kept:
        stamp = (
            STATES.state(message)[1] if topic == "state" else wire.join(*REWARDS.read(message)[2:4])
        )
        arrived.setdefault(stamp, set()).add(topic)
    whole, stamp = set(), 0
    for episode, length in enumerate(lengths):
        for step in range(length + 1):
            stamp += 5_000_000
            if arrived.get(stamp) == {"state", "reward"}:
                whole.add((episode, step))
    assert found == {(e, k) for e, k in whole if (e, k + 1) in whole}


def test_in_order_every_transition_comes_once_and_in_order():
    formed = feed(messages([4, 3]))
    check(formed)
    keys = [(before.episode, before.step) for before, _ in formed]
    assert keys == [(0, 0), (0, 1), (0, 2), (0, 3), (1, 0), (1, 1), (1, 2)]
    assert [t.truncated for _, t in formed] == [False] * 3 + [True] + [False] * 2 + [True]


def test_a_repeated_observation_is_given_again_once():
    pairer = Pairer(TASK)
    state, reward = (message for _, message in messages([1])[:2])
    assert pairer.state(state) is None
    assert pairer.reward(reward) is not None
    assert pairer.state(state) is None
    assert pairer.reward(reward) is not None


def test_memory_stays_small():
    pairer = Pairer(TASK)
    for topic, message in messages([3000]):
        getattr(pairer, topic)(message)
    assert len(pairer._observations) < 1000


def observed(k, value=0.0):
    """Observation k of an episode, as its two messages."""
    o = Observation(0, k, np.array([value, k], float), -1.0, 1, stamp=(k + 1) * 5_000_000)
    return STATES.of(o), REWARDS.of(o)


def test_the_oldest_are_forgotten_beyond_the_window_and_no_others():
    pairer = Pairer(TASK, window=4)
    for k in range(5):
        assert pairer.state(observed(k)[0]) is None
    completed = [pairer.reward(observed(k)[1]) for k in range(5)]
    assert [o is not None for o in completed] == [False, True, True, True, True]


def test_another_state_with_the_same_stamp_is_the_newer_one():
    """As from a vehicle that was started anew."""
    pairer = Pairer(TASK)
    pairer.reward(observed(0)[1])
    assert pairer.state(observed(0)[0]).state.tolist() == [0.0, 0.0]
    assert pairer.state(observed(0)[0]) is None  # repeated
    assert pairer.state(observed(0, value=0.5)[0]).state.tolist() == [0.5, 0.0]
