"""The literature's learners, each against what it is known to come to."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from iolspi_ros.core.learner import Source, greedy_policy, learner_class, update
from iolspi_ros.core.samples import Transition, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.experiments.samplesets import INDEPENDENT, samples
from iolspi_ros.methods import local_model
from iolspi_ros.methods.traits import TRAITS
from iolspi_ros.methods.value_iteration import parabola_top
from iolspi_ros.saving import checkpoint
from iolspi_ros.task import Action, Ending, TaskDescription, Variable
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.world import World, WorldSettings

METHODS = [name for name in TRAITS if name not in ("iolspi", "dqn")]
N, GAMMA = 6, 0.9


def described(n_actions=2, low=0.0, high=N - 1.0, gamma=GAMMA, n_dims=1, values=None, dt=1.0):
    return TaskDescription(
        name="small",
        variables=tuple(Variable(f"x{d}", "", low, high) for d in range(n_dims)),
        actions=tuple(
            Action(f"a{a}", (float(v),)) for a, v in enumerate(values or range(n_actions))
        ),
        neutral=0, sampling_time=dt, episode_steps=1000, gamma=gamma, endings=(Ending("end"),),
    )  # fmt: skip


WALK = described()
"""A corridor of six places; action 0 goes left, 1 right; 1 for the right end, which is the end."""


def walk(place, action):
    """Next place, reward, end."""
    there = min(max(place + (1 if action else -1), 0), N - 1)
    return there, (1.0 if there == N - 1 else -0.1 * (action == 0)), there == N - 1


def exact(policy=None):
    """Q of the corridor by linear equations: of a stochastic policy (N, 2), or of the best one."""
    q = np.zeros((N, 2))
    for _ in range(100):
        pi = policy if policy is not None else np.eye(2)[q.argmax(axis=1)]
        system, right = np.eye(2 * N), np.zeros(2 * N)
        for s in range(N - 1):
            for a in range(2):
                there, right[2 * s + a], end = walk(s, a)
                if not end:
                    system[2 * s + a, 2 * there : 2 * there + 2] -= GAMMA * pi[there]
        new = np.linalg.solve(system, right).reshape(N, 2)
        if np.allclose(new, q, atol=1e-14):
            break
        q = new
    return q[: N - 1]


def tabular(name, task=WALK, **more):
    cls = learner_class(name)
    settings = cls.Settings(centers=(N,), width=0.05, **more)
    return cls(task, settings, np.random.default_rng(0))


def live(core, steps, rng):
    """Let a learner walk the corridor, from anywhere."""
    place = 0
    for _ in range(steps):
        action, source = core.act(np.array([float(place)]))
        there, reward, end = walk(place, action)
        core.observe(Transition(np.array([float(place)]), action, reward,
                                np.array([float(there)]), end, False, int(source)))  # fmt: skip
        place = int(rng.integers(N - 1)) if end else there


def table(core):
    return core.values(np.arange(N - 1.0)[:, None])


@pytest.mark.parametrize("trace", [0.0, 0.5])
def test_q_learning_comes_to_the_optimal_values_whatever_is_explored(trace):
    core = tabular("q_learning", epsilon=0.5, trace=trace, learning_rate=0.3)
    live(core, 6000, np.random.default_rng(1))
    np.testing.assert_allclose(table(core), exact(), atol=1e-6)


def test_sarsa_comes_to_the_values_of_what_it_does_exploring_included():
    epsilon = 0.3
    core = tabular(
        "sarsa", epsilon=epsilon, trace=0.0, learning_rate=0.5, learning_rate_decay=0.9998
    )
    live(core, 40_000, np.random.default_rng(1))
    soft = np.tile([epsilon / 2, 1.0 - epsilon / 2], (N, 1))  # right is the best everywhere
    assert (exact(soft).argmax(axis=1) == 1).all()
    np.testing.assert_allclose(table(core), exact(soft), atol=0.02)
    assert np.abs(table(core) - exact()).max() > 0.05  # and not to the optimal ones


def hand(transitions, alpha, lam, next_value, cut):
    """Q of few steps with traces, by the book's definition: every earlier pair shares the error."""
    q = np.zeros((N, 2))
    for k, t in enumerate(transitions):
        s, a, r, _, end = t
        error = r + (0.0 if end else GAMMA * next_value(q, k)) - q[s, a]
        first = max([j + 1 for j in range(k) if cut(q, j + 1)] or [0])
        for j in range(first, k + 1):
            q[transitions[j][0], transitions[j][1]] += alpha * (GAMMA * lam) ** (k - j) * error
    return q


def test_traces_share_errors_as_by_hand():
    steps = [(2, 1, 0.5, 3, False), (3, 1, -0.2, 4, False), (4, 1, 1.0, 5, True)]
    rows = [Transition(np.array([float(s)]), a, r, np.array([float(s2)]), end)
            for s, a, r, s2, end in steps]  # fmt: skip
    sarsa, q_learning = (
        tabular(name, trace=0.6, learning_rate=0.4) for name in ("sarsa", "q_learning")
    )
    for row in rows:
        sarsa.observe(row)
        q_learning.observe(row)
    expected = hand(steps, 0.4, 0.6, lambda q, k: q[steps[k + 1][:2]], lambda q, j: False)
    np.testing.assert_allclose(table(sarsa), expected[: N - 1], atol=1e-12)
    # Numbers of the last error alone: 0.4 for the pair itself, a factor 0.54 for each before.
    assert expected[4, 1] == pytest.approx(0.4)
    expected = hand(steps, 0.4, 0.6, lambda q, k: q[steps[k + 1][0]].max(), lambda q, j: False)
    # After step 2, action 1 of place 3 is not worse than another, so no trace is cut ...
    np.testing.assert_allclose(table(q_learning)[4], expected[4], atol=1e-12)


def test_a_trace_of_q_learning_ends_where_it_explored():
    core = tabular("q_learning", trace=0.9, learning_rate=0.5)
    at = [np.array([float(k)]) for k in range(N)]
    core.observe(Transition(at[3], 0, 1.0, at[2]))  # now 0 is the best action in place 3
    core.observe(Transition(at[2], 1, 0.0, at[3]))
    before = core.weights.copy()
    core.observe(Transition(at[3], 1, 5.0, at[4]))  # not the best
    changed = np.argwhere(core.weights != before)
    assert {tuple(pair) for pair in changed.tolist()} <= {(1, 3)} | {
        (a, k) for a, k in changed.tolist() if abs(core.weights[a, k] - before[a, k]) < 1e-6
    }


def test_automata_choose_the_action_that_is_rewarded():
    core = tabular("automata", window=5, learning_rate=0.1)
    live(core, 4000, np.random.default_rng(1))
    np.testing.assert_allclose(core.weights.sum(axis=0), 1.0)
    assert (table(core)[:, 1] > 0.9).all()
    assert core.epsilon < 0.2


def test_one_step_of_an_automaton_by_hand():
    core = tabular("automata", window=1, learning_rate=0.25)
    at = [np.array([float(k)]) for k in range(N)]
    for action, reward in ((0, 0.0), (1, 2.0), (0, 1.0)):
        core.observe(Transition(at[1], action, reward, at[2], True))
    # The first tells nothing; β = 1: p(1) = 1/2 + 1/4 · 1/2; then β = 1/2 for 0.
    p = 0.5 + 0.25 * 0.5
    np.testing.assert_allclose(core.weights[1, 1], p * (1 - 0.125))


def linear(n, rng, values=(-2.0, 0.0, 2.0)):
    """Samples of x' = A x + B a with reward -(xᵀx + 0.1 a²), a double integrator."""
    a, b = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([0.005, 0.1])
    x, action = rng.uniform(-1.0, 1.0, (n, 2)), rng.integers(len(values), size=n)
    u = np.array(values)[action]
    after = x @ a.T + u[:, None] * b
    reward = -(x**2).sum(axis=1) - 0.1 * u**2
    none = np.zeros(n, bool)
    return Transitions(x, action, reward, after, none, none), a, b


def test_the_local_model_is_weighted_least_squares():
    rng = np.random.default_rng(0)
    offsets, targets = rng.normal(size=(4, 15, 2)), rng.normal(size=(4, 15, 3))
    distances = np.linalg.norm(offsets, axis=2)
    weight = local_model.weights(distances, 0.7)
    found = local_model.regress(offsets, targets, weight)
    for n in range(4):
        x = np.column_stack([np.ones(15), offsets[n]])
        w = np.diag(np.exp(-(distances[n] ** 2) / (2 * 0.7**2)))  # T Eq. 4-8, squared
        closed = np.linalg.inv(x.T @ w @ x) @ x.T @ w @ targets[n]
        np.testing.assert_allclose(found[n], closed, rtol=1e-4, atol=1e-6)


def test_the_local_model_knows_linear_dynamics_and_wraps_angles():
    rows, a, b = linear(3000, np.random.default_rng(0))
    task = described(low=-1.5, high=1.5, n_dims=2, values=(-2.0, 0.0, 2.0))
    model = local_model.LocalModel(rows, task)
    x = np.random.default_rng(1).uniform(-0.9, 0.9, (200, 2))
    after, reward, ended = model(x, np.full(200, 2))
    np.testing.assert_allclose(after, x @ a.T + 2.0 * b, atol=1e-5)
    np.testing.assert_allclose(reward, -(x**2).sum(axis=1) - 0.4, atol=0.01)
    assert not ended.any()
    pendulum = Pendulum()
    model = local_model.LocalModel(samples(INDEPENDENT, pendulum, 0), pendulum.description)
    x = np.array([[-3.14, -5.0], [3.14, 5.0]])
    truth = pendulum.step(x, np.array([0, 2]))[0]
    assert (np.abs(x[:, 0] - truth[:, 0]) > 6.0).all()  # over the edge
    np.testing.assert_allclose(model(x, np.array([0, 2]))[0], truth, atol=0.05)


def test_value_iteration_comes_to_dynamic_programming():
    core = tabular("value_iteration", tolerance=1e-9, ridge=1e-9)
    rows = [Transition(np.array([float(s)]), a, walk(s, a)[1], np.array([float(walk(s, a)[0])]),
                       walk(s, a)[2]) for s in range(N - 1) for a in range(2)] * 5  # fmt: skip
    core.pretrain(Transitions.of(rows, 1))
    np.testing.assert_allclose(table(core), exact(), atol=1e-3)


def test_fitted_q_comes_to_dynamic_programming():
    pytest.importorskip("sklearn")
    core = tabular("fitted_q", tolerance=1e-9)
    rows = [Transition(np.array([float(s)]), a, walk(s, a)[1], np.array([float(walk(s, a)[0])]),
                       walk(s, a)[2]) for s in range(N - 1) for a in range(2)]  # fmt: skip
    core.pretrain(Transitions.of(rows, 1))
    np.testing.assert_allclose(table(core), exact(), atol=1e-6)


def test_what_follows_the_end_of_an_episode_is_worth_nothing():
    """Into the best place of all by an end: nothing; there itself 1 for ever."""
    pytest.importorskip("sklearn")
    core = tabular("fitted_q", tolerance=1e-9)
    first, best = np.zeros(1), np.ones(1)
    rows = [Transition(first, 0, 0.0, best, True), Transition(first, 1, 0.0, first, False),
            *(Transition(best, a, 1.0, best, False) for a in range(2))]  # fmt: skip
    core.pretrain(Transitions.of(rows * 3, 1))
    there = 1.0 / (1.0 - GAMMA)
    np.testing.assert_allclose(table(core)[:2], [[0.0, 0.0], [there, there]], atol=1e-6)


def test_packed_trees_say_what_the_library_says():
    ensemble = pytest.importorskip("sklearn.ensemble")
    from iolspi_ros.methods import fitted_q

    rng = np.random.default_rng(0)
    x, y = rng.normal(size=(300, 2)), rng.normal(size=300)
    forest = ensemble.ExtraTreesRegressor(7, min_samples_leaf=3, random_state=0).fit(x, y)
    means = fitted_q._Means(forest, x, x)
    nodes = fitted_q._packed(0, forest, means.sums(y) / means.counts)
    q, others = np.zeros((100, 1)), rng.normal(size=(100, 2))
    fitted_q._predict(nodes, others, q)
    np.testing.assert_allclose(q[:, 0], forest.predict(others), atol=1e-9)


def test_continuous_value_iteration_comes_to_the_linear_quadratic_regulator():
    """Its value is quadratic, and its actions are any: T's conditions, so it must be exact."""
    rows, a, b = linear(4000, np.random.default_rng(0), (-6.0, 0.0, 6.0))
    gamma = 0.9
    task = described(low=-1.5, high=1.5, n_dims=2, values=(-6.0, 0.0, 6.0), gamma=gamma)
    cls = learner_class("continuous_value_iteration")
    core = cls(task, cls.Settings(ridge=0.0, tolerance=1e-6), np.random.default_rng(0))
    core.pretrain(rows)
    root = np.sqrt(gamma)
    riccati = solve_discrete_are(root * a, root * b[:, None], np.eye(2), np.array([[0.1]]))
    x = np.random.default_rng(1).uniform(-0.4, 0.4, (300, 2))
    value = core.best(core.values(x))
    np.testing.assert_allclose(value, -np.einsum("ni,ij,nj->n", x, riccati, x), atol=0.05)


def test_the_top_of_a_parabola():
    at = np.array([-1.0, 0.0, 2.0])
    q = np.stack([3.0 - (at - 0.5) ** 2, 1.0 - (at - 5.0) ** 2, (at - 1.0) ** 2, 0.0 * at])
    np.testing.assert_allclose(parabola_top(q, at), [3.0, 1.0 - 9.0, 4.0, 0.0])


@pytest.mark.parametrize("name", ["apprentice", "value_iteration"])
def test_learning_from_an_expert_beats_the_expert(name):
    """T Algorithm 8 on demonstration set 5; the expert is who flew it, without corruption."""
    pendulum = Pendulum()
    rows = samples("set 5", pendulum, 0)
    cls = learner_class(name)
    core = cls(pendulum.description, cls.Settings(centers=(11, 11)), np.random.default_rng(0))
    core.pretrain(rows)
    flown = evaluate(pendulum, greedy_policy(core))
    steps = pendulum.description.episode_steps
    expert = samples("set 1", pendulum, 0).reward.reshape(-1, steps)
    discounted = expert @ pendulum.description.gamma ** np.arange(steps)
    assert flown.discounted_return > max(discounted.mean(), -1400.0)


def small_flight(name, core, episodes, seed=3):
    world = World(Pendulum(), WorldSettings(), np.random.default_rng(seed))
    seen = []
    train(world, core, episodes, Listener(on_observation=lambda o, a, s: seen.append((a, s))))
    return world, seen


@pytest.mark.parametrize("name", METHODS)
def test_saved_and_restored_each_goes_on_bit_by_bit_the_same(name, tmp_path):
    if name == "fitted_q":
        pytest.importorskip("sklearn")
    task, cls = Pendulum().description, learner_class(name)
    settings = cls.Settings(centers=(7, 7), update_interval=350)
    cores = [cls(task, settings, np.random.default_rng(seed)) for seed in (0, 1)]
    if name == "apprentice":
        cores[0].pretrain(samples("set 5", Pendulum(), 0)[np.arange(2000)])
    small_flight(name, cores[0], 3)
    checkpoint.save(tmp_path / "c", cores[0], name)
    checkpoint.load(tmp_path / "c", cores[1], name)
    later = [small_flight(name, core, 3, seed=4)[1] for core in cores]
    assert later[0] == later[1]
    np.testing.assert_array_equal(cores[0].weights, cores[1].weights)
    assert cores[0].step == cores[1].step == 1800
    assert cores[0].n_samples == cores[1].n_samples
    bad = replace(cores[0].state(), weights=cores[0].weights[:, :-1])
    with pytest.raises(InputError, match="shapes"):
        cores[1].restore(bad)


@pytest.mark.parametrize("name", METHODS)
def test_an_update_beside_the_control_thread_changes_nothing_meanwhile(name):
    if name in ("fitted_q", "apprentice"):
        pytest.importorskip("sklearn")
    cls = learner_class(name)
    core = cls(Pendulum().description, cls.Settings(centers=(5, 5)), np.random.default_rng(0))
    for row in samples(INDEPENDENT, Pendulum(), 0)[np.arange(500)]:
        core.observe(row)
    before = core.snapshot
    compute = core.begin_update()
    found = compute()
    np.testing.assert_array_equal(core.snapshot, before)
    report = core.finish_update(found)
    assert report.number == 1
    assert report.accepted
    update(core)  # of nothing new


@pytest.mark.parametrize("name", [name for name in METHODS if not TRAITS[name].demonstrations])
def test_one_that_cannot_be_shown_anything_says_who_can(name):
    core = tabular(name)
    row = Transition(np.zeros(1), 1, 0.0, np.ones(1), False, False, int(Source.HUMAN))
    with pytest.raises(InputError, match=r"cannot learn from demonstrations.*iolspi.*apprentice"):
        core.pretrain(Transitions.of([row], 1))
    assert core.n_samples == 0


def test_the_apprentice_does_nothing_without_an_expert():
    with pytest.raises(InputError, match=r"no expert.*iolspi"):
        tabular("apprentice").act(np.zeros(1))


def test_actions_that_are_no_axis_are_refused():
    cls = learner_class("continuous_value_iteration")
    with pytest.raises(InputError, match=r"slung_load.*q_learning"):
        cls(SlungLoad.description, cls.Settings(), np.random.default_rng(0))


@pytest.mark.parametrize("name", METHODS)
def test_what_is_no_number_is_dropped_and_counted(name):
    if name == "fitted_q":
        pytest.importorskip("sklearn")
    core = tabular(name, described(3))
    core.observe(Transition(np.array([np.nan]), 0, 0.0, np.zeros(1)))
    core.observe(Transition(np.zeros(1), 7, 0.0, np.zeros(1)))
    assert (core.dropped, core.n_samples) == (2, 0)
    assert core.name == name
