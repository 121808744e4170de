"""The low-level controller, the wind, and both together."""

import numpy as np
import pytest
from scipy.signal import welch

from iolspi_ros.errors import InputError
from sim_nodes.quadrotor import body, control, flight, wind
from sim_nodes.quadrotor.airframe import AR_DRONE_2, UTILITY, Payload
from sim_nodes.quadrotor.control import ACCELERATION, ATTITUDE, VELOCITY, Gains
from sim_nodes.quadrotor.response import measure

LOADS = {AR_DRONE_2: Payload(), UTILITY: Payload(mass=0.1)}
G, CALM = 9.81, np.zeros(3)


def flown(mode, sticks, seconds, frame=AR_DRONE_2, state=None, air=CALM):
    state = body.hovering(frame, LOADS[frame], (0, 0, 5)) if state is None else state.copy()
    memory = np.zeros(control.MEMORY)
    control.begin(state, LOADS[frame].mass / frame.mass, memory)
    flight.fly_all(
        state[None], memory[None], mode, np.array([sticks], float), air, Gains(), frame,
        LOADS[frame], round(seconds / flight.STEP),
    )  # fmt: skip
    return state


def turned(yaw):
    state = body.hovering(AR_DRONE_2, LOADS[AR_DRONE_2], (0, 0, 5))
    state[6], state[9] = np.cos(yaw / 2), np.sin(yaw / 2)
    return state


@pytest.mark.parametrize("frame", LOADS)
@pytest.mark.parametrize("loaded", [False, True])
def test_its_answers_are_quick_and_do_not_overshoot_much(frame, loaded):
    """What docs/slung_load_3d.md says of it; a stick that leans the vehicle is the quickest."""
    load = LOADS[frame] if loaded else None
    lean, climb, turn = (measure(name, frame, load) for name in ("lean", "climb", "turn"))
    assert lean.rise < 0.2
    assert lean.overshoot < 0.1
    assert 2.0 < lean.bandwidth < 5.0
    assert climb.rise < 0.6
    assert climb.overshoot < 0.15
    assert turn.rise < 0.5
    assert turn.overshoot < 0.05
    velocity = measure("velocity", frame, load)
    assert velocity.overshoot < 0.15
    assert velocity.rise < 1.5


@pytest.mark.parametrize("frame", LOADS)
def test_it_holds_altitude_and_heading_with_the_sticks_at_rest(frame):
    state = flown(ATTITUDE, [0, 0, 0, 0], 5.0, frame)
    np.testing.assert_allclose(state[:3], [0, 0, 5], atol=0.01)
    assert control.heading_of(state) == pytest.approx(0.0, abs=1e-6)


def test_an_altitude_is_held_again_where_the_climb_ends():
    state = flown(ACCELERATION, [0, 0, 1.0, 0], 2.0)
    memory = np.zeros(control.MEMORY)
    climbing = state.copy()
    control.begin(state, 0.14, memory)
    memory[0] = climbing[2] + climbing[5] / Gains().climb
    flight.fly_all(
        state[None], memory[None], ACCELERATION, np.zeros((1, 4)), CALM, Gains(), AR_DRONE_2,
        Payload(), 600,
    )  # fmt: skip
    assert abs(state[5]) < 0.05
    assert state[2] == pytest.approx(memory[0], abs=0.05)


def test_an_acceleration_is_what_the_vehicle_does():
    """Before the load swings back and the air holds it: over the first half second."""
    state = flown(ACCELERATION, [3.0, 0, 0, 0], 0.5)
    later = flown(ACCELERATION, [3.0, 0, 0, 0], 0.7)
    assert (later[3] - state[3]) / 0.2 == pytest.approx(3.0, abs=0.6)
    assert abs(later[4]) < 1e-6
    assert later[2] == pytest.approx(5.0, abs=0.05)


@pytest.mark.parametrize("mode", [ATTITUDE, VELOCITY, ACCELERATION])
def test_ahead_and_left_are_as_the_nose_points(mode):
    yaw = 2.0
    nose = np.array([np.cos(yaw), np.sin(yaw)])
    ahead = flown(mode, [0.2, 0, 0, 0], 1.0, state=turned(yaw))
    assert ahead[3:5] @ nose > 0.05
    assert abs(ahead[3:5] @ [-nose[1], nose[0]]) < 0.01
    left = flown(mode, [0, 0.2, 0, 0], 1.0, state=turned(yaw))
    assert left[3:5] @ [-nose[1], nose[0]] > 0.05


def test_a_velocity_is_held_against_the_wind():
    state = flown(VELOCITY, [0, 0, 0, 0], 30.0, air=np.array([3.0, 1.0, 0.0]))
    assert np.abs(state[3:6]).max() < 0.02


def test_it_comes_back_from_upside_down():
    state = body.hovering(AR_DRONE_2, Payload(), (0, 0, 20))
    body.release(state)
    state[6:10] = np.cos(1.4), np.sin(1.4), 0.0, 0.0
    end = flown(ATTITUDE, [0, 0, 0, 0], 3.0, state=state)
    assert abs(end[7]) < 0.02
    assert np.isfinite(end).all()


def test_rotors_stay_within_what_they_can():
    memory, command = np.zeros(control.MEMORY), np.empty(4)
    rng = np.random.default_rng(0)
    for _ in range(200):
        state = body.hovering(AR_DRONE_2, Payload(), (0, 0, 5))
        state[3:13] = rng.normal(size=10) * 3.0
        state[6:10] /= np.linalg.norm(state[6:10])
        control.begin(state, 0.1, memory)
        control.steer(
            state, memory, int(rng.integers(3)), rng.normal(size=4) * 10, Gains(), AR_DRONE_2,
            0.005, command,
        )  # fmt: skip
        assert (command >= AR_DRONE_2.rotor_low - 1e-9).all()
        assert (command <= AR_DRONE_2.rotor_high + 1e-9).all()


# ------------------------------------------------------------------ wind

SPEED, HEIGHT = 4.0, 5.0


def standard(speed=SPEED, height=HEIGHT):
    """Times [s] and variances of gusts along, across and up, as MIL-F-8785C prints them."""
    h = height / 0.3048
    length = h / (0.177 + 0.000823 * h) ** 1.2 * 0.3048
    up = 0.1 * speed
    level = up / (0.177 + 0.000823 * h) ** 0.4
    return np.array([length, length, height]) / speed, np.array([level, level, up]) ** 2


@pytest.mark.parametrize("dt", [0.005, 0.1])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_gusts_are_correlated_as_drydens(axis, dt):
    """Along e^-x, across and up (1 - x/2) e^-x, with x = V τ / L: for any step, without drawing."""
    air, (times, variances) = wind.gusts(SPEED, 0.3, HEIGHT, dt), standard()
    spread = np.diag(air.begin[axis] ** 2)
    lasting = air.keep[axis] @ spread @ air.keep[axis].T + air.fresh[axis] @ air.fresh[axis].T
    np.testing.assert_allclose(lasting, spread, rtol=1e-9, atol=1e-15)
    x = dt / times[axis] * np.arange(50)
    wanted = variances[axis] * np.exp(-x) * (1.0 if axis == 0 else 1.0 - 0.5 * x)
    kept, found = np.eye(2), []
    for _ in range(50):
        found.append(air.out[axis] @ kept @ spread @ air.out[axis])
        kept = air.keep[axis] @ kept
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)


def test_gusts_have_drydens_spectra():
    dt, n = 0.1, 100_000
    air, (times, variances) = wind.gusts(SPEED, 0.7, HEIGHT, dt), standard()
    rng = np.random.default_rng(0)
    gust, now, seen = np.zeros((3, 2)), np.empty(3), np.empty((n, 3))
    wind.begin_gusts(air, rng, gust)
    for k in range(n):
        wind.blow(air, rng, gust, now)
        seen[k] = air.axes @ (now - air.steady)
    frequency, power = welch(seen.T, 1 / dt, nperseg=5_000)
    inside = (frequency > 0.01) & (frequency < 1.0)
    w = 2 * np.pi * frequency[inside]
    for axis in range(3):
        x2 = (times[axis] * w) ** 2
        shape = 1 / (1 + x2) if axis == 0 else (1 + 3 * x2) / (1 + x2) ** 2 / 2
        printed = 4 * variances[axis] * times[axis] * shape  # one-sided, per Hz
        ratio = power[axis, inside] / printed
        assert np.median(ratio) == pytest.approx(1.0, abs=0.12)
        for band in np.array_split(ratio, 5):
            assert band.mean() == pytest.approx(1.0, abs=0.12)


def test_no_wind_is_no_wind():
    air = wind.gusts(0.0, 0.0, 3.0, 0.005)
    gust, now, rng = np.zeros((3, 2)), np.ones(3), np.random.default_rng(0)
    wind.begin_gusts(air, rng, gust)
    wind.blow(air, rng, gust, now)
    np.testing.assert_array_equal(now, 0.0)
    steady = wind.gusts(5.0, np.pi / 2, 3.0, 0.005, strength=0.0)
    wind.blow(steady, rng, gust, now)
    np.testing.assert_allclose(now, [0, 5, 0], atol=1e-12)


def test_a_wind_that_is_none_is_refused():
    for speed, direction in ((np.nan, 0.0), (-1.0, 0.0), (99.0, 0.0), (3.0, np.nan)):
        with pytest.raises(InputError, match="wind"):
            wind.check_wind(speed, direction)


def test_a_flight_in_gusts_is_its_seeds():
    ends = []
    for seed in (1, 1, 2):
        rng = np.random.default_rng(seed)
        air = wind.gusts(4.0, 0.0, 5.0, flight.STEP)
        one = flight.vehicle(body.hovering(AR_DRONE_2, Payload(), (0, 0, 5)), air, rng)
        control.begin(one.state, 0.14, one.memory)
        flight.fly(one, VELOCITY, np.zeros(4), air, rng, Gains(), AR_DRONE_2, Payload(), 200)
        ends.append(one.state)
    np.testing.assert_array_equal(ends[0], ends[1])
    assert np.abs(ends[0] - ends[2]).max() > 1e-3
