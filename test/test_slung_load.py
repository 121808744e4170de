import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate
from sim_nodes.tasks import make_task
from sim_nodes.tasks.slung_load import RELEASE, Outcome, SlungLoad, outcome
from sim_nodes.world import World, WorldSettings

TASK = SlungLoad()
G, L = 9.81, 1.0  # T Table 2


def pulled(time, y, a):
    """The load seen from the quadrotor: it hangs in the field of gravity less acceleration.

    Newton for the load at angle θ, tangent (cos θ, -sin θ) with z down; the cable pulls across
    it, so L θ̈ is the tangent's part of (−a, g).
    """
    _, speed, angle, rate = y
    tangent = np.array([np.cos(angle), -np.sin(angle)])
    return [speed, a, rate, tangent @ np.array([-a, G]) / L]


@pytest.mark.parametrize("action", [0, 1, 2])
def test_many_small_steps_follow_newton(action):
    start = np.array([-4.0, 0.5, 0.4, -0.7])
    small = SlungLoad()
    parameters = small.parameters(0.0)
    parameters[-1] = 1e-5
    state, next_state = start.copy(), np.empty(4)
    for _ in range(50_000):
        small.compiled(state, action, 0.0, parameters, next_state)
        state, next_state = next_state, state
    exact = solve_ivp(
        pulled, (0, 0.5), start, args=(TASK.description.actions[action].value[0],), rtol=1e-10
    )
    np.testing.assert_allclose(state, exact.y[:, -1], atol=2e-4)


def test_a_step_is_eulers():
    x, v, q, w = state = np.array([-4.0, 1.0, 0.5, -2.0])
    next_state, reward, ended = TASK.step(state, 2)
    angular = -math.cos(q) * 3.0 + math.sin(q) / L * -G  # T Eq. 18 as printed
    expected = [x + 0.1 * v, v + 0.1 * 3.0, q + 0.1 * w, w + 0.1 * angular]
    np.testing.assert_allclose(next_state, expected, rtol=1e-14)
    assert (reward, ended) == (pytest.approx(-0.5 * 4.0), False)
    pushed, _, _ = TASK.step(state, 2, 0.0, 0.5)
    assert pushed[1] == pytest.approx(v + 0.1 * 3.5)


def falls(state, dt=1e-4):
    """Let the load fall in small steps until it is below the rim."""
    x, v, q, w = state
    p = np.array([x + L * np.sin(q), L * np.cos(q)])
    speed = np.array([v + L * np.cos(q) * w, -L * np.sin(q) * w])
    if p[1] > 0.9:
        return False
    while True:
        before = p
        p = p + speed * dt + np.array([0.0, 0.5 * G * dt**2])
        speed = speed + np.array([0.0, G * dt])
        if before[1] <= 0.9 < p[1] and speed[1] >= 0.0:
            return None if abs(abs(p[0]) - 1.5) < 0.01 else abs(p[0]) < 1.5


def test_a_dunk_is_what_small_steps_of_the_fall_say():
    rng = np.random.default_rng(0)
    seen = Counter()
    for state in rng.uniform((-4, -4, -1.5, -6), (4, 4, 1.5, 6), (300, 4)):
        expected = falls(state)
        if expected is None:
            continue  # too near the edge for small steps to tell
        _, reward, ended = TASK.step(state, RELEASE)
        assert ended
        assert reward == (100.0 if expected else -10.0), state
        seen[expected] += 1
    assert min(seen[True], seen[False]) > 30


@pytest.mark.parametrize(
    ("state", "action", "reward", "way"),
    [
        ((-1.0, 0.0, 1.0, 0.0), RELEASE, 100.0, Outcome.DUNK),
        ((-1.0, 0.0, 0.1, 0.0), RELEASE, -10.0, Outcome.MISS),  # below the rim
        ((-4.0, 0.0, 1.0, 0.0), RELEASE, -10.0, Outcome.MISS),  # beside the basket
        ((-4.0, 0.0, 1.5, 2.0), 1, -50.0, Outcome.CABLE),
        ((-4.0, 0.0, -1.5, -2.0), 1, -50.0, Outcome.CABLE),
        ((-6.4, -2.0, 0.0, 0.0), 1, -150.0, Outcome.WALL),
        ((2.9, 2.0, 0.0, 0.0), 1, -150.0, Outcome.WALL),
        ((2.9, 2.0, 1.5, 2.0), 1, -150.0, Outcome.WALL),  # both at once
        ((-4.0, 2.0, 0.0, 0.0), 1, -2.0, Outcome.OPEN),
    ],
)
def test_each_ending_and_its_reward(state, action, reward, way):
    _, given_reward, ended = TASK.step(np.array(state), action)
    assert given_reward == reward
    assert isinstance(given_reward, float)
    assert ended is (way != Outcome.OPEN)
    assert outcome(given_reward, ended) == way


def test_many_at_once_are_each_alone():
    rng = np.random.default_rng(0)
    states, actions = (
        rng.uniform(TASK.description.low, TASK.description.high, (400, 4)),
        rng.integers(4, size=400),
    )
    noise = rng.normal(size=400)
    next_state, reward, ended = TASK.step(states, actions, 0.0, noise)
    assert (next_state.shape, reward.shape, ended.dtype) == ((400, 4), (400,), bool)
    ways = outcome(reward, ended)
    assert set(ways) == set(Outcome)
    for k in range(400):
        alone, r, e = TASK.step(states[k], actions[k], 0.0, noise[k])
        np.testing.assert_array_equal(next_state[k], alone)
        assert (reward[k], ended[k], ways[k]) == (r, e, outcome(r, e))


finite = st.floats(width=32, allow_nan=False, allow_infinity=False)


@settings(max_examples=300, deadline=None)
@given(st.tuples(finite, finite, finite, finite), st.integers(0, 3), finite)
def test_what_is_finite_stays_finite(state, action, noise):
    next_state, reward, _ = TASK.step(np.array(state), action, 0.0, noise)
    assert np.isfinite(next_state).all()
    assert math.isfinite(reward)


@pytest.mark.parametrize(("initial", "low", "high"), [("wide", -6, 0), ("narrow", -5, -4)])
def test_initial_conditions_fill_the_ranges(initial, low, high):
    task, rng = SlungLoad(initial=initial), np.random.default_rng(0)
    drawn = np.array([task.draw_initial(rng) for _ in range(2000)])
    judged = task.initial_states()
    for states, slack in ((drawn, 0.01), (judged, 1e-12)):
        assert not states[:, [1, 3]].any()
        np.testing.assert_allclose([states[:, 0].min(), states[:, 0].max()], [low, high],
                                   atol=slack * 6)  # fmt: skip
        widest = np.abs(states[:, 2])
        assert np.pi / 3 - slack <= widest.max() <= np.pi / 3 + 1e-12
    assert len(np.unique(judged, axis=0)) == 143


def test_states_stay_within_the_limits():
    rng = np.random.default_rng(0)
    state = np.array([TASK.draw_initial(rng) for _ in range(5000)])
    action = rng.integers(3, size=5000)
    for _ in range(TASK.description.episode_steps):
        action = np.where(rng.random(len(state)) < 0.2, rng.integers(3, size=len(state)), action)
        next_state, _, ended = TASK.step(state, action)
        state, action = next_state[~ended], action[~ended]
        assert (state >= TASK.description.low).all()
        assert (state <= TASK.description.high).all()


def test_a_world_starts_anywhere_and_is_cut_after_5_s():
    world = World(TASK, WorldSettings(), np.random.default_rng(0))
    starts = {float(world.begin(k).state[0]) for k in range(50)}
    assert len(starts) == 50
    world.state = np.array([-4.0, 0.0, 0.0, 0.0])
    seen = [world.move(49, TASK.description.neutral) for _ in range(50)]
    assert [s.last for s in seen] == [False] * 49 + [True]
    assert seen[-1].truncated


def test_success_is_a_dunk():
    def hold(states):
        return np.full(len(states), RELEASE)

    flown = evaluate(TASK, hold)
    expected = [falls(state) for state in TASK.initial_states()]
    for said, true in zip(flown.succeeded, expected, strict=True):
        assert true is None or said == true
    assert flown.succeeded.any()
    assert not flown.succeeded.all()
    np.testing.assert_array_equal(flown.discounted, np.where(flown.succeeded, 100.0, -10.0))


def test_bad_settings_are_named():
    with pytest.raises(InputError, match="initial is 'far'; allowed: wide, narrow"):
        make_task("slung_load", {"initial": "far"}, "here.yaml")
