"""The vehicle under the embedded autopilot: its load swings, hangs, lies and flies as it must."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_nodes.autopilot.body import STEP, Body
from sim_nodes.autopilot.control import Gains, attitude
from sim_nodes.autopilot.dynamics import Airframe, derivative, move, thrust_direction
from sim_nodes.tasks.slung_load import SlungLoad

G = 9.81
BARE = Airframe(drag=0.0, load_drag=0.0, load=1e-6)  # so light that the quadrotor does not feel it
CALM = np.zeros(3)


def hanging(angle, rate=0.0, height=10.0):
    """State with the cable at an angle to the north [rad] and its rate [rad/s]."""
    state = np.zeros(19)
    state[2], state[12] = -height, G
    state[13:16] = np.sin(angle), 0.0, np.cos(angle) - height
    state[16:19] = np.cos(angle) * rate, 0.0, -np.sin(angle) * rate
    return state


def cable(state):
    """Angle in the plane of north and down [rad]."""
    return np.arctan2(state[13] - state[0], state[15] - state[2])


def test_the_load_swings_as_in_the_task():
    """Against an independent integration of T Eq. 18, pushed as the quadrotor really was."""
    state, command = hanging(0.6, -0.5), np.array([0.0, 0.0, 0.0, G])
    pushes, angles = [], []
    for i in range(1600):
        # Lean one way and the other, with the thrust that holds the height when settled.
        command[1] = -0.29 if i % 400 < 200 else 0.29
        command[3] = G / np.cos(command[1])
        rates = np.empty(19)
        derivative(state, command, CALM, True, BARE, rates)
        pushes.append(rates[3:6])
        angles.append(cable(state))
        move(state, command, CALM, True, BARE, STEP)
    pushes = np.array(pushes)
    times = STEP * np.arange(len(pushes))

    def pendulum(time, y):
        push = np.array([np.interp(time, times, pushes[:, i]) for i in range(3)])
        # T Eq. 18, with what the quadrotor accelerates downwards taken from gravity.
        return [y[1], -(np.cos(y[0]) * push[0] + np.sin(y[0]) * (G - push[2]))]

    exact = solve_ivp(pendulum, (0, times[-1]), [0.6, -0.5], t_eval=times, rtol=1e-9, atol=1e-9)
    assert 0.6 < np.abs(angles).max() < np.pi / 2  # it swings wide, on a tight cable
    assert np.abs(pushes[:, 0]).max() > 2.0
    np.testing.assert_allclose(angles, exact.y[0], atol=2e-3)


def test_free_swing_agrees_with_the_tasks_equations():
    """The task's own compiled step, made small, with the quadrotor hovering."""
    task, small = SlungLoad(), 1e-4
    parameters = task.parameters(0.0)
    parameters[-1] = small
    here, following = np.array([0.0, 0.0, 0.8, 0.0]), np.empty(4)
    state, command = hanging(0.8), np.array([0.0, 0.0, 0.0, G])
    for _ in range(400):
        move(state, command, CALM, True, BARE, STEP)
        for _ in range(25):
            task.compiled(here, 1, 0.0, parameters, following)
            here, following = following, here
    assert cable(state) == pytest.approx(here[2], abs=2e-3)


def energy(state, frame):
    quadrotor = 0.5 * frame.mass * state[3:6] @ state[3:6] - frame.mass * G * state[2]
    load = 0.5 * frame.load * state[16:19] @ state[16:19] - frame.load * G * state[15]
    return quadrotor + load


def test_a_falling_pair_keeps_energy_and_momentum():
    frame = Airframe(drag=0.0, load_drag=0.0)
    state = hanging(0.4, 3.0, height=100.0)
    state[12] = 0.0
    state[4], state[17] = 1.0, -1.0
    before, momentum = energy(state, frame), frame.mass * state[3:5] + frame.load * state[16:18]
    for _ in range(800):
        move(state, np.zeros(4), CALM, True, frame, STEP)
    assert energy(state, frame) == pytest.approx(before, rel=1e-4)
    after = frame.mass * state[3:5] + frame.load * state[16:18]
    np.testing.assert_allclose(after, momentum, atol=1e-9)
    assert np.linalg.norm(state[13:16] - state[:3]) == pytest.approx(1.0, abs=2e-3)


def test_a_released_load_flies_a_parabola():
    body = Body(Airframe(load_drag=0.0), np.random.default_rng(0))
    body.state[:] = hanging(0.5, 2.0, height=20.0)
    start, speed = body.load[0].copy(), body.load[1].copy()
    body.release()
    for _ in range(400):
        move(body.state, np.array([0, 0, 0, G]), CALM, body.attached, body.frame, STEP)
    expected = start + speed * 1.0 + np.array([0, 0, 0.5 * G])
    np.testing.assert_allclose(body.load[0], expected, atol=1e-9)


def test_a_load_on_the_ground_stays_there():
    body = Body(Airframe(), np.random.default_rng(0))
    body.state[2] = -0.5  # the cable hangs loose
    body.state[16] = 1.0
    for _ in range(2000):
        move(body.state, np.array([0, 0, 0, G]), CALM, True, body.frame, STEP)
    assert body.load[0][2] == 0.0
    assert np.linalg.norm(body.load[1]) < 1e-6


def test_wind_blows_it_along_its_drag():
    frame = Airframe(drag=0.3)
    state, rates = hanging(0.0), np.empty(19)
    derivative(state, np.array([0, 0, 0, G]), np.array([4.0, -2.0, 0.0]), False, frame, rates)
    np.testing.assert_allclose(rates[3:6], [1.2, -0.6, 0.0], atol=1e-12)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_attitude_gives_the_acceleration_asked_for(yaw):
    gains = Gains(
        False, (5.0, 5.0), (2.5, 1.0), (10.0, 2.5, 1.5), 9.0, (1.0, 1.0), (2.0, 5.0), (0.5, 1.0),
        1.0, 0.0, 0.6, 4.0, 3.0,
    )  # fmt: skip
    wanted = np.array([1.5, -2.0, -0.7])
    roll, pitch, thrust = attitude(wanted, yaw, gains, G)
    got = np.array([0, 0, G]) - thrust * np.array(thrust_direction(roll, pitch, yaw))
    np.testing.assert_allclose(got, wanted, atol=1e-12)
    roll, pitch, thrust = attitude(np.array([50.0, 0.0, 0.0]), yaw, gains, G)
    down = np.array(thrust_direction(roll, pitch, yaw))
    assert np.arccos(down[2]) == pytest.approx(0.6)
    assert thrust * down[2] == pytest.approx(G)
