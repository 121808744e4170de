import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from iolspi_ros.core.learner import Source, update
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.saving import checkpoint
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.world import World, WorldSettings

TASK = Pendulum.description


def learner(seed=0, **changes):
    values = {"algorithm": "literal", "centers": (4, 3), "update_interval": 50, "delta": 0.1}
    settings = LSPISettings(**values | changes)
    return OnlineLSPI(TASK, settings, np.random.default_rng([seed, 1]))


def world(seed=0):
    return World(Pendulum(), WorldSettings(), np.random.default_rng([seed, 0]))


def algorithm_2(start, transitions, features, s):
    """T Algorithm 2, lines 7 to 12, sample by sample with dense φ(s, a)."""
    n = TASK.n_actions * features.size

    def dense(state, action):
        out = np.zeros(n)
        out[action * features.size : (action + 1) * features.size] = features(state)
        return out

    weights = start.ravel().copy()
    gram, cross, vector = s.delta * np.eye(n), np.zeros((n, n)), np.zeros(n)
    for k, t in enumerate(transitions):
        q = [dense(t.next_state, a) @ weights for a in range(TASK.n_actions)]
        here, there = dense(t.state, t.action), dense(t.next_state, int(np.argmax(q)))
        if t.terminated:
            there = np.zeros(n)
        gram = s.forget_factor * gram + np.outer(here, here)
        cross = s.forget_factor * cross + np.outer(here, there)
        vector = s.forget_factor * vector + here * t.reward
        if (k + 1) % s.update_interval == 0:
            scale = 1.0 / (k + 1)
            weights = np.linalg.solve(scale * gram - TASK.gamma * scale * cross, scale * vector)
    return weights.reshape(TASK.n_actions, -1)


@pytest.mark.parametrize("forget_factor", [1.0, 0.99])
def test_it_is_algorithm_2(forget_factor):
    core = learner(forget_factor=forget_factor, width=0.7)
    start = core.weights.copy()
    seen = []
    observe = core.observe

    def keep(t):
        ended = t._replace(terminated=len(seen) % 97 == 96)
        seen.append(ended)
        return observe(ended)

    core.observe = keep
    train(world(), core, 3, Listener(on_observation=lambda *_: None))
    assert core.updates == 18
    expected = algorithm_2(start, seen, core.features, core.settings)
    np.testing.assert_allclose(core.weights, expected, rtol=1e-6)


STILL, BOTH = WorldSettings(), WorldSettings(action_noise=2.0, sensor_noise=(0.1, 0.5))


@pytest.mark.parametrize(
    ("task", "noise"),
    [
        (Pendulum(), STILL),
        (Pendulum(), BOTH),
        (Pendulum(), WorldSettings(action_noise=2.0)),
        (Pendulum(), WorldSettings(uniform_noise=2.0)),
        (Pendulum(g_after=19.81, g_change_start=1.7), STILL),
        (Pendulum(g_after=19.81, g_change_start=1.7, g_change_duration=1.0), BOTH),
    ],
)
@pytest.mark.parametrize("algorithm", ["literal", "refreshed"])
def test_the_compiled_loop_flies_step_by_step_the_same(task, noise, algorithm):
    """Zero weights make ties; g that changes, episodes and batches cut the loop."""
    cores, states, totals = [], [], []
    for listener in (Listener(), Listener(on_observation=lambda *_: None)):
        core = learner(algorithm=algorithm, update_interval=70, epsilon=0.5, epsilon_decay=0.9)
        core.weights[:] = 0.0
        vehicle = World(task, noise, np.random.default_rng([4, 0]))
        scores = []
        listener.on_episode = lambda *numbers, scores=scores: scores.append(numbers)
        train(vehicle, core, 3, listener)
        cores.append(core)
        totals.append(scores)
        states.append(vehicle.begin(9).state)
    compiled, plain = cores
    assert compiled.updates == plain.updates > 10
    np.testing.assert_array_equal(compiled.weights, plain.weights)
    for a, b in zip(compiled.batch.rows(), plain.batch.rows(), strict=True):
        for x, y in zip(a, b, strict=True):
            np.testing.assert_array_equal(x, y)
    np.testing.assert_array_equal(*states)
    assert len(totals[0]) == 3
    np.testing.assert_allclose(*totals, rtol=1e-12)
    assert compiled.rng.random() == plain.rng.random()


@pytest.mark.parametrize("algorithm", ["literal", "refreshed"])
def test_a_step_allocates_nothing_that_stays(algorithm):
    core = learner(algorithm=algorithm, update_interval=5000)
    transition = Transition(np.array([1.0, 2.0]), 1, -1.0, np.array([1.1, 2.0]))
    for _ in range(3000):  # until the interpreter keeps no more freed tuples for later
        core.act(transition.state)
        core.observe(transition)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    for _ in range(1000):
        core.act(transition.state)
        core.observe(transition)
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 1000  # less than a byte a step
    assert peak - before < 4000  # numbers in passing, no arrays of features


def test_exploration_decays_as_in_eq_14():
    core = learner(epsilon=0.8, epsilon_decay=0.5, epsilon_min=0.1)
    assert core.epsilon == 0.8
    core.step = 200  # one second
    assert core.epsilon == pytest.approx(0.4)
    core.step = 10**6
    assert core.epsilon == 0.1


def test_epsilon_is_the_share_of_exploring_actions():
    core = learner(epsilon=0.3)
    sources = [core.act(np.zeros(2))[1] for _ in range(4000)]
    assert abs(np.mean([s is Source.EXPLORE for s in sources]) - 0.3) < 0.04
    assert {core.act(np.zeros(2), explore=False)[1] for _ in range(50)} == {Source.EXPLOIT}


def demonstration(n=400):
    rng = np.random.default_rng(7)
    task = Pendulum()
    states = rng.uniform(task.description.low, task.description.high, (n, 2))
    actions = rng.integers(3, size=n)
    following, reward, ended = task.step(states, actions)
    return Transitions(states, actions, reward, following, ended, ended)


def test_informed_it_goes_on_from_the_weights_and_the_matrices():
    core = learner(update_interval=10)
    result = core.pretrain(demonstration())
    np.testing.assert_array_equal(core.weights, result.solve.weights)
    informed = core.moments
    assert informed.n_samples == core.n_samples == 400
    state = np.array([1.0, 2.0])
    for _ in range(10):
        core.observe(Transition(state, 0, -1.0, state))
    update(core)
    assert core.moments.n_samples == 410
    phi = core.features(state)
    np.testing.assert_allclose(core.moments.gram[0], informed.gram[0] + 10 * np.outer(phi, phi))


def test_numbers_that_are_none_are_dropped_and_counted():
    core = learner()
    fine = np.zeros(2)
    core.observe(Transition(fine, 0, float("nan"), fine))
    core.observe(Transition(np.array([np.inf, 0.0]), 0, 1.0, fine))
    core.observe(Transition(fine, 0, 1.0, np.array([0.0, np.nan])))
    core.observe(Transition(fine, 3, 1.0, fine))
    assert (core.step, core.dropped) == (0, 4)
    broken = demonstration()
    broken.reward[5] = np.nan
    core.pretrain(broken)
    assert core.dropped == 5
    assert np.isfinite(core.weights).all()


def test_a_demonstration_of_nothing_is_refused():
    broken = demonstration(3)
    broken.reward[:] = np.nan
    with pytest.raises(InputError, match="none of 3"):
        learner().pretrain(broken)


def test_an_unhealthy_solve_keeps_the_weights():
    core = learner(delta=0.0, update_interval=5)
    before = core.weights.copy()
    state = np.array([1.0, 2.0])
    for _ in range(5):
        core.observe(Transition(state, 0, -1.0, state))
    found = update(core)
    assert (found.accepted, found.solve.status) == (False, "singular")
    np.testing.assert_array_equal(core.weights, before)


@pytest.mark.parametrize("algorithm", ["literal", "refreshed"])
def test_solving_beside_the_control_thread_gives_the_same(algorithm):
    cores = [learner(algorithm=algorithm) for _ in range(2)]
    inline, beside = cores
    for core in cores:
        core.pretrain(demonstration())
        for k in range(50):
            core.observe(next(iter(demonstration()[k : k + 1])))
    update(inline)
    compute = beside.begin_update()
    beside.observe(next(iter(demonstration())))  # goes into the next batch
    beside.finish_update(compute())
    np.testing.assert_array_equal(inline.weights, beside.weights)


@pytest.mark.parametrize("algorithm", ["literal", "refreshed"])
def test_a_checkpoint_goes_on_bit_by_bit(tmp_path, algorithm):
    before, after = learner(algorithm=algorithm), learner(seed=9, algorithm=algorithm)
    train(world(), before, 2, Listener())
    # One more, so that it is saved in the middle of a batch.
    before.observe(Transition(np.zeros(2), 1, -1.0, np.ones(2)))
    checkpoint.save(tmp_path / "a" / "c.npz", before, "iolspi")
    checkpoint.load(tmp_path / "a" / "c.npz", after, "iolspi")
    for name in ("weights", "step", "updates"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    train(world(5), before, 2, Listener())
    train(world(5), after, 2, Listener())
    np.testing.assert_array_equal(after.weights, before.weights)


@pytest.mark.parametrize("cut", [0, 100, -50])
def test_a_damaged_checkpoint_says_so(tmp_path, cut):
    path = tmp_path / "c.npz"
    checkpoint.save(path, learner(), "iolspi")
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError, match="damaged"):
        checkpoint.load(path, learner(), "iolspi")


def test_a_checkpoint_of_something_else_is_refused(tmp_path):
    path = tmp_path / "c.npz"
    with pytest.raises(InputError, match="does not exist"):
        checkpoint.load(path, learner(), "iolspi")
    checkpoint.save(path, learner(), "iolspi")
    with pytest.raises(InputError, match="is of learner 'iolspi'; allowed: 'other'"):
        checkpoint.load(path, learner(), "other")
    slower = OnlineLSPI(replace(TASK, sampling_time=0.01), learner().settings, learner().rng)
    said = "sampling_time is 0.005 here and 0.01 there .here: checkpoint .*; there: the vehicle"
    with pytest.raises(InputError, match=said):
        checkpoint.load(path, slower, "iolspi")
    with pytest.raises(InputError, match="centers"):
        checkpoint.load(path, learner(centers=(3, 4)), "iolspi")


def test_a_save_that_fails_leaves_the_one_before(tmp_path, monkeypatch):
    path = tmp_path / "c.npz"
    checkpoint.save(path, learner(), "iolspi")
    before = path.read_bytes()

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(InputError, match="No space left"):
        checkpoint.save(path, learner(3), "iolspi")
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["c.npz"]


@pytest.mark.parametrize(
    ("field", "value"),
    [("forget_factor", 0.0), ("forget_factor", 1.1),
     ("update_interval", 0), ("epsilon", 1.5), ("width", 0.0), ("delta", float("nan")),
     ("scaling", "none"), ("centers", (0, 3))],
)  # fmt: skip
def test_settings_out_of_range_name_field_and_value(field, value):
    with pytest.raises(InputError, match=f"{field}.* is"):
        LSPISettings(**{field: value})


def test_what_a_person_did_online_counts_as_demonstrated(tmp_path):
    """Also of a batch that grew, and that was saved half full."""
    core, again = (learner(algorithm="refreshed", update_interval=4) for _ in range(2))
    rng = np.random.default_rng(3)
    sources = [Source.EXPLOIT, Source.HUMAN, -1, Source.HOLD, Source.CORRUPTED, Source.SHIELD]
    for k, source in enumerate(sources):
        state = rng.uniform(TASK.low, TASK.high)
        core.observe(Transition(state, k % 3, -1.0, state, source=source))
    checkpoint.save(tmp_path / "c.npz", core, "iolspi")
    checkpoint.load(tmp_path / "c.npz", again, "iolspi")
    for one in (core, again):
        update(one)
        kept = one.buffer
        assert kept.demonstrated.tolist() == [False, True, False, False, True, False]
        assert kept.born.tolist() == [1, 2, 3, 4, 5, 6]  # as old as they are, unlike a bag's
    one.observe(Transition(np.zeros(2), 1, -1.0, np.zeros(2)))
    assert one.batch.source.tolist() == [-1]  # nothing of the batch before is left
