import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iolspi_ros.errors import InputError
from sim_nodes.tasks import make_task
from sim_nodes.tasks.pendulum import Pendulum, dynamics
from sim_nodes.world import World, WorldSettings

TASK = Pendulum()


def equation_15(_, y, voltage, g):
    """T Eq. 15, written from the paper."""
    alpha, rate = y
    m, l, b, K, R, J = 0.055, 0.042, 3e-6, 0.0536, 9.5, 1.91e-4  # noqa: E741
    torque = m * g * l * np.sin(alpha) - b * rate - K**2 * rate / R + K * voltage / R
    return [rate, torque / J]


@pytest.mark.parametrize("action", [0, 1, 2])
@pytest.mark.parametrize("start", [(3.0, 0.0), (0.3, -12.0), (-1.5, 20.0)])
def test_a_step_integrates_eq_15(start, action):
    state = np.array(start)
    for _ in range(20):
        state, _, _ = TASK.step(state, np.int64(action))
    exact = solve_ivp(
        equation_15,
        (0, 0.1),
        start,
        args=(TASK.description.actions[action].value[0], 9.81),
        rtol=1e-11,
        atol=1e-11,
    ).y[:, -1]
    angle = (exact[0] + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(state, [angle, exact[1]], atol=1e-5)


def test_the_reward_is_eq_16_as_a_cost():
    state = np.array([0.5, -2.0])
    _, reward, ended = TASK.step(state, np.int64(2))
    assert reward == pytest.approx(-(state @ np.diag([5.0, 0.01]) @ state + 0.01 * 3.0**2))
    assert not ended


def test_many_at_once_are_each_alone():
    rng = np.random.default_rng(0)
    states, actions = (
        rng.uniform(TASK.description.low, TASK.description.high, (50, 2)),
        rng.integers(3, size=50),
    )
    next_state, reward, ended = TASK.step(states, actions)
    assert next_state.shape == (50, 2)
    assert ended.shape == (50,)
    for k in range(50):
        alone, r, _ = TASK.step(states[k], actions[k])
        np.testing.assert_allclose(next_state[k], alone, rtol=1e-12, atol=1e-12)
        assert reward[k] == pytest.approx(r)


def test_angle_wraps_and_rate_saturates():
    state, _, _ = TASK.step(np.array([np.pi - 0.01, 20.0]), np.int64(2))
    assert -np.pi <= state[0] < -3.0
    fast, _, _ = TASK.step(np.array([2.0, 15 * np.pi]), np.int64(2))
    assert fast[1] <= 15 * np.pi


def test_initial_conditions():
    hanging = TASK.initial_states()
    assert hanging.shape == (21, 2)
    assert (np.abs(np.abs(hanging[:, 0]) - np.pi) <= 0.1 + 1e-12).all()
    np.testing.assert_allclose(np.unique(hanging[:, 1]), np.pi / 3 * np.arange(-3, 4), atol=1e-12)
    spread = Pendulum(initial="distributed").initial_states()
    assert spread.shape == (28, 2)
    assert np.abs(spread[:, 1]).max() == pytest.approx(10 * np.pi)


def test_gravity_changes_at_once_or_slowly():
    assert Pendulum(g=3.81, g_after=19.81).gravity(1e9) == 3.81  # never, by default
    sudden = Pendulum(g_after=19.81, g_change_start=300.0)
    assert (sudden.gravity(299.99), sudden.gravity(300.0)) == (9.81, 19.81)
    slow = Pendulum(g_after=19.81, g_change_start=300.0, g_change_duration=300.0)
    assert slow.gravity(450.0) == pytest.approx(14.81)
    assert slow.gravity(900.0) == 19.81


def test_noise_has_its_deviations_and_its_seed():
    noise = WorldSettings(action_noise=1.0, sensor_noise=(0.1, 2.0))
    quiet = World(TASK, WorldSettings(order="sweep"), np.random.default_rng(0))
    runs = []
    for seed in (1, 1, 2):
        world = World(TASK, noise, np.random.default_rng(seed))
        runs.append([world.begin(k).state for k in range(2000)])
    np.testing.assert_array_equal(runs[0], runs[1])
    assert not np.array_equal(runs[0], runs[2])
    starts = TASK.initial_states()
    nearest = [np.abs(starts[:, 0] - s[0]).min() for s in runs[0]]
    assert 0.02 < np.mean(nearest) < 0.1
    quiet.begin(0)
    first = quiet.move(0, 2)
    expected, _, _ = TASK.step(starts[0], np.int64(2))
    np.testing.assert_array_equal(first.state, expected)
    perturbed, _, _ = TASK.step(starts[0], np.int64(2), 0.0, 0.7)
    slope = (
        0.7
        * dynamics.TORQUE_CONSTANT
        / dynamics.RESISTANCE
        / dynamics.INERTIA
        * TASK.description.sampling_time
    )
    assert perturbed[1] - expected[1] == pytest.approx(slope, rel=0.02)


def test_an_episode_is_cut_by_the_clock_after_300_steps():
    world = World(TASK, WorldSettings(), np.random.default_rng(0))
    world.begin(0)
    seen = [world.move(0, 1) for _ in range(300)]
    assert [s.last for s in seen] == [False] * 299 + [True]
    assert seen[-1].truncated
    assert not seen[-1].terminated
    assert world.vehicle_time == pytest.approx(1.5)


def test_a_sweep_starts_everywhere_in_turn():
    world = World(TASK, WorldSettings(order="sweep"), np.random.default_rng(0))
    starts = [world.begin(k).state for k in range(42)]
    np.testing.assert_array_equal(starts, np.tile(TASK.initial_states(), (2, 1)))


def test_upright_is_the_whole_last_half_second():
    states = np.zeros((301, 3, 2))
    states[:, 0, 0] = 0.2
    states[:201, 1, 0] = 3.0
    states[250, 2, 0] = 0.3
    assert TASK.succeeded(states, np.zeros((300, 3))).tolist() == [True, True, False]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"initial": "sideways"}, "initial is 'sideways'; allowed: hanging, distributed"),
        ({"g": -1.0}, r"g is -1.0; allowed: \[0.0"),
        ({"g": "much"}, "g is 'much'; allowed: a float"),
        ({"g": 10}, r"g is 10; allowed: a float \(write 1.0, not 1\)"),
    ],
)
def test_bad_settings_name_file_field_and_range(values, words):
    with pytest.raises(InputError, match=f"here.yaml: {words}"):
        make_task("pendulum", values, "here.yaml")


def test_an_unknown_task_lists_those_that_there_are():
    with pytest.raises(
        InputError, match="task is 'pendulm'; allowed: cart_pole, pendulum, slung_load"
    ):
        make_task("pendulm", {}, "")
