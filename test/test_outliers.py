from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from iolspi_ros.core.learner import update
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.outliers import FEW, doubts, far
from iolspi_ros.core.samples import Transition
from iolspi_ros.core.solve import plausible
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate, policy_of
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.samplesets import samples
from iolspi_ros.task import Variable
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.world import World, WorldSettings

TASK = Pendulum()
TAUGHT = samples("set 3", TASK, 0)
RNG = np.random.default_rng(0)


def learner(**changes):
    settings = LSPISettings(centers=(11, 11), **changes)
    return OnlineLSPI(TASK.description, settings, np.random.default_rng(0))


def spoiled(rows, at, **changes):
    """The same transitions, one of them with other numbers."""
    fields = {name: getattr(rows, name).copy() for name in changes}
    for name, value in changes.items():
        fields[name][at] = value
    return replace(rows, **fields)


BAD = {
    "a reward of -1e9": {"reward": -1e9},
    "a reward of -1e4": {"reward": -1e4},
    "a reward of 1e300": {"reward": 1e300},
    "a state in degrees": {"state": (170.0, 600.0)},
    "a next state in degrees": {"next_state": (-170.0, 3000.0)},
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_sample_changes_nothing(name):
    """The same policy as without it, and it is counted and named."""
    clean, dirty = learner(), learner()
    clean.pretrain(TAUGHT)
    update = dirty.pretrain(spoiled(TAUGHT, 6295, **BAD[name]))
    assert update.accepted
    assert update.refresh.doubted == 1
    assert "1 samples not believed" in update.text
    returns = [
        evaluate(TASK, policy_of(core.weights, core.features)).discounted_return
        for core in (clean, dirty)
    ]
    assert returns[1] / returns[0] < 1.01
    assert plausible(dirty.features(TAUGHT.state) @ dirty.weights.T, TAUGHT.reward, 0.98)


@pytest.mark.parametrize("reward", [-1e9, -1e4])
def test_a_learner_that_took_one_heals_within_two_updates(reward):
    """As from a checkpoint of one that believed everything."""
    core = learner()
    core.pretrain(TAUGHT)
    rows = core.buffer.transitions
    core.buffer = replace(core.buffer, transitions=spoiled(rows, len(rows) - 5, reward=reward))
    core.weights = np.random.default_rng(0).standard_normal(core.weights.shape) * -reward
    world = World(TASK, WorldSettings(), np.random.default_rng([0, 0]))
    updates = []
    train(world, core, 7, Listener(on_update=updates.append))
    assert len(updates) == 2
    assert updates[0].accepted
    values = core.features(rows.state) @ core.weights.T
    assert values.min() > 1.5 * rows.reward.min() / 0.02
    assert values.max() < 300.0  # 247 of one that never saw it
    assert updates[-1].refresh.doubted <= 1


@pytest.mark.parametrize("task", [TASK, SlungLoad()], ids=["pendulum", "slung load"])
@pytest.mark.parametrize("number", range(1, 6))
def test_what_was_flown_is_believed(task, number):
    """Prizes and crashes too, however few: from the first 50 samples on."""
    rows = samples(f"set {number}", task, 0)
    for count in (1, 2, 50, 500, len(rows)):
        assert not doubts(rows[np.arange(count)]).rows.any()


def test_what_comes_again_is_believed():
    sizes = np.ones(1000)
    for count in range(1, FEW + 3):
        sizes[-count] = 1e6
        assert far(sizes, 10.0).sum() == (count if count <= FEW else 0)


def test_rewards_that_are_false_now_and_then_never_become_true():
    """However many there are, they stand among true ones; a place that pays is paid again."""
    rng = np.random.default_rng(0)
    scattered = rng.choice(len(TAUGHT), 40, replace=False)
    assert doubts(spoiled(TAUGHT, scattered, reward=-1e9)).rows.sum() == 40
    place = np.argsort(np.abs(TAUGHT.state - TAUGHT.state[3000]).sum(axis=1))[:40]
    assert not doubts(spoiled(TAUGHT, place, reward=-1e9)).rows.any()


def test_a_true_prize_is_not_forgotten_when_it_is_crowded():
    """Once believed, it is believed: a part of the space keeps few samples, but those of it."""
    core = OnlineLSPI(
        TASK.description, LSPISettings(basis="auto", kernels=150, buffer_size=800), RNG
    )
    found = []
    for _ in range(8):
        states = RNG.uniform((-np.pi, -20.0), (np.pi, 20.0), (1000, 2))
        states[::25] = RNG.normal((0.0, 0.0), 0.01, (40, 2))
        for k, state in enumerate(states):
            prize = k % 25 == 0
            core.observe(Transition(state, 1, 100.0 if prize else -1.0, states[k - 1], False))
        update(core)
        kept = core.buffer.transitions
        found.append((int((kept.reward > 0.0).sum()), int(doubts(kept).rows.sum())))
    assert all(number > FEW and doubted == 0 for number, doubted in found), found
    assert len(core.buffer) <= 800


@pytest.mark.parametrize("settings", [{"basis": "auto"}, {"centers": (11, 11)}])
@pytest.mark.parametrize("online", [True, False])
def test_where_nothing_can_be_believed_nothing_changes(settings, online):
    core = OnlineLSPI(TASK.description, LSPISettings(**settings), np.random.default_rng(0))
    weights = core.weights
    beyond = spoiled(TAUGHT, slice(None), state=(900.0, 900.0))[np.arange(50)]
    if online:
        for k in range(50):
            row = beyond[np.array([k])]
            core.observe(Transition(row.state[0], int(row.action[0]), float(row.reward[0]),
                                    row.next_state[0], False))  # fmt: skip
        found = update(core)
    else:
        found = core.pretrain(beyond)
    assert (found.accepted, found.healthy) == (False, False)
    assert "24 samples not believed: variable 0 at 900" in found.text
    assert core.weights is weights
    assert core.pretrain(TAUGHT).accepted


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_a_policy_does_not_depend_on_the_unit_of_its_rewards(unit):
    core = learner()
    found = core.pretrain(replace(TAUGHT, reward=TAUGHT.reward * unit))
    one = learner()
    assert found.refresh.iterations >= one.pretrain(TAUGHT).refresh.iterations
    np.testing.assert_allclose(core.weights / unit, one.weights, rtol=1e-5, atol=1e-5)


def test_samples_of_another_task_are_dropped():
    core, state = learner(), np.zeros(2)
    for s, n in ((np.zeros(1), state), (state, np.zeros(3)), (np.zeros(5), np.zeros(5))):
        assert not core.observe(Transition(s, 0, 0.0, n, False))
    assert (core.dropped, core.step) == (3, 0)


def test_a_task_without_limits_is_learned():
    """Features come from the samples; a grid asks for limits."""
    task = replace(TASK.description, variables=(Variable("x"), Variable("v", low=0.0)))
    rows = replace(TAUGHT, state=abs(TAUGHT.state), next_state=abs(TAUGHT.next_state))
    for basis in ("", "auto"):
        core = OnlineLSPI(task, LSPISettings(basis=basis), np.random.default_rng(0))
        assert core.pretrain(rows).accepted
    with pytest.raises(InputError, match=r"x of task pendulum has no limits.*basis: auto"):
        OnlineLSPI(task, LSPISettings(basis="rbf"), np.random.default_rng(0))


def test_a_first_fall_among_nothing_but_zeros_is_believed():
    assert not far(np.array([0.0] * 100 + [1.0]), 30.0).any()


def test_limits_are_kept_where_they_are_known():
    low, high = np.array([-np.pi, -50.0]), np.array([np.pi, 50.0])
    rows = spoiled(TAUGHT, slice(0, 100), state=(60.0, 0.0))
    assert doubts(rows, low, high).rows[:100].all()
    assert doubts(rows, low, high).rows.sum() == 100
    assert "variable 0 at 60" in doubts(rows, low, high).reasons


@given(
    arrays.arrays(float, st.integers(2, 60), elements=st.floats(0.0, 1e12)),
    st.floats(2.0, 100.0),
)
def test_only_a_few_that_stand_apart_are_far(sizes, factor):
    found = far(sizes, factor)
    assert found.sum() <= FEW
    if found.any():
        rest = sizes[~found].max()
        assert rest > 0.0
        assert (sizes[found] > factor * rest).any()
    np.testing.assert_array_equal(found, far(sizes * 2.0**7, factor))  # in any unit


@settings(deadline=None, max_examples=15)
@given(st.floats(1e4, 1e300), st.sampled_from([-1.0, 1.0]), st.integers(0, 6299))
def test_no_single_reward_makes_values_that_the_others_cannot_add_up_to(size, sign, at):
    core = OnlineLSPI(TASK.description, LSPISettings(centers=(6, 6)), np.random.default_rng(0))
    core.pretrain(spoiled(TAUGHT, at, reward=sign * size))
    q = core.features(TAUGHT.state) @ core.weights.T
    assert np.abs(q).max() < 2.0 * np.abs(TAUGHT.reward).max() / (1.0 - 0.98)


def test_a_discount_near_one_costs_no_more():
    counts = {}
    for gamma in (0.98, 0.9999, 0.999999):
        task, settings = replace(TASK.description, gamma=gamma), LSPISettings(centers=(11, 11))
        core = OnlineLSPI(task, settings, np.random.default_rng(0))
        counts[gamma] = core.pretrain(TAUGHT).refresh.iterations
    assert counts[0.9999] <= 2 * counts[0.98] + 10
    assert counts[0.999999] <= 2 * counts[0.98] + 10


def test_the_shield_learns_from_what_is_believed():
    envelope = {"envelope_low": (-np.inf, -40.0), "envelope_high": (np.inf, 40.0)}
    cores = [learner(**envelope) for _ in range(2)]
    cores[0].pretrain(TAUGHT[np.arange(6300) != 100])
    cores[1].pretrain(spoiled(TAUGHT, 100, state=(170.0, 600.0)))
    np.testing.assert_allclose(cores[1].shield.cross, cores[0].shield.cross)
    core = cores[1]
    core.observe(Transition(np.zeros(2), 1, -1e9, np.zeros(2)))
    assert len(core.batch) == 1  # the buffer decides, by all the others
