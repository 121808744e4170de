"""What the embedded autopilot adds to the quadrotor: the ground, and a steering of its own.

The dynamics themselves are looked at in `test_quadrotor.py`.
"""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim_nodes.autopilot.autopilot import Autopilot
from sim_nodes.autopilot.body import STEP, Body, ned
from sim_nodes.autopilot.control import Target, lean
from sim_nodes.autopilot.firmware import find_firmware
from sim_nodes.autopilot.ground import push, touch
from sim_nodes.quadrotor.airframe import UTILITY, Payload
from sim_nodes.quadrotor.body import (
    ATTITUDE,
    CABLE,
    LOAD,
    LOAD_VELOCITY,
    POSITION,
    RATES,
    SIZE,
    STAGES,
    VELOCITY,
    hovering,
    move,
)
from sim_nodes.quadrotor.cable import SLACK, TAUT

G = 9.81
CALM = np.zeros(3)
PAYLOAD = Payload(0.1, 1.0, 0.0)


def fresh(payload=PAYLOAD):
    return Body(UTILITY, payload, np.random.default_rng(0))


def in_air(body, height, swing=(0.0, 0.0)):
    body.craft[:] = hovering(body.frame, body.payload, (0.0, 0.0, height), swing)


def pass_time(body, seconds, hover=True):
    """Rotors as they are, or at rest: and the ground."""
    command, room = body.craft[13:17].copy() * hover, np.empty((STAGES, SIZE))
    return max(
        (move(body.craft, command, CALM, body.frame, body.payload, STEP, room),
         touch(body.craft, body.payload, STEP))[1]
        for _ in range(round(seconds / STEP))
    )  # fmt: skip


def test_it_is_the_utility_quadrotor_of_the_task():
    body = fresh()
    assert body.frame == UTILITY._replace(rotor_low=0.0)
    assert body.height == 0.0
    assert body.landed
    assert body.attached
    assert body.attitude == pytest.approx(np.zeros((2, 3)))  # nose to the north


def test_a_released_load_flies_a_parabola():
    body = fresh()
    in_air(body, 20.0, (0.5, 0.2))
    body.craft[LOAD_VELOCITY] = 1.0, -0.5, 0.3
    start, speed = (value.copy() for value in body.load)
    body.release()
    assert not body.attached
    pass_time(body, 1.0)
    expected = start + speed * 1.0 + np.array([0, 0, 0.5 * G])
    np.testing.assert_allclose(body.load[0], expected, atol=1e-9)


def test_a_load_on_the_ground_stays_there_and_its_cable_hangs_loose():
    body = fresh()
    in_air(body, 0.5)
    body.craft[LOAD], body.craft[LOAD_VELOCITY], body.craft[CABLE] = (0.3, 0, 0), (1, 0, 0), SLACK
    for _ in range(40):
        pass_time(body, 0.05)
        body.craft[POSITION], body.craft[VELOCITY] = (0.0, 0.0, 0.5), 0.0
    assert body.load[0][2] == 0.0
    assert np.linalg.norm(body.load[1]) < 1e-6
    assert body.craft[CABLE] == SLACK


def test_a_vehicle_that_sinks_lays_its_load_down_and_takes_it_up_again():
    body, room = fresh(), np.empty((STAGES, SIZE))
    in_air(body, 1.3)
    body.craft[VELOCITY] = body.craft[LOAD_VELOCITY] = 0.0, 0.0, -0.5
    rotors = body.craft[13:17].copy()
    for up in (False, True):
        for _ in range(round(1.6 / STEP)):
            body.craft[VELOCITY] = 0.0, 0.0, 0.5 if up else -0.5
            move(body.craft, rotors, CALM, body.frame, body.payload, STEP, room)
            touch(body.craft, body.payload, STEP)
            body.craft[ATTITUDE], body.craft[RATES] = (1.0, 0.0, 0.0, 0.0), 0.0
        assert body.craft[CABLE] == (TAUT if up else SLACK)
        height = -body.load[0][2]
        assert height == pytest.approx(body.height - 1.0 if up else 0.0, abs=1e-6)


def test_what_falls_comes_to_rest_on_the_ground_level_and_facing_as_it_did():
    body = fresh()
    in_air(body, 3.0)
    body.release()
    body.craft[ATTITUDE] = math.cos(0.3), 0.0, 0.0, math.sin(0.3)  # 0.6 rad from the east
    impact = pass_time(body, 1.2, hover=False)
    assert impact == pytest.approx(math.sqrt(2.0 * G * 3.0), rel=0.05)
    assert body.craft[POSITION][2] == 0.0
    assert not body.craft[VELOCITY].any()
    assert body.attitude[0] == pytest.approx([0.0, 0.0, 0.5 * math.pi - 0.6], abs=1e-6)


def test_a_new_load_hangs_below_or_lies_on_the_ground():
    for height, below, cable in ((5.0, 4.0, TAUT), (0.4, 0.0, SLACK)):
        body = fresh()
        in_air(body, height)
        body.release()
        pass_time(body, 0.3)
        place = body.craft[POSITION].copy()
        body.hang()
        assert body.craft[CABLE] == cable
        assert body.craft[LOAD] == pytest.approx([*place[:2], max(place[2] - 1.0, 0.0)])
        assert -body.load[0][2] == pytest.approx(below, abs=0.05)


@pytest.mark.parametrize(
    ("quaternion", "angles"),
    [
        ((math.sqrt(0.5), 0, 0, math.sqrt(0.5)), (0.0, 0.0, 0.0)),  # nose to the north
        ((1, 0, 0, 0), (0.0, 0.0, math.pi / 2)),  # to the east
        ((math.cos(0.1), math.sin(0.1), 0, 0), (0.2, 0.0, math.pi / 2)),  # left side up
        ((math.cos(0.1), 0, math.sin(0.1), 0), (0.0, -0.2, math.pi / 2)),  # nose down
    ],
)
def test_angles_are_those_of_an_autopilot(quaternion, angles):
    body = fresh()
    body.craft[ATTITUDE], body.craft[RATES] = quaternion, (0.1, 0.2, 0.3)
    assert body.attitude[0] == pytest.approx(angles)
    assert body.attitude[1] == pytest.approx([0.1, -0.2, -0.3])


def test_north_east_down_and_back():
    vector = np.array([1.0, 2.0, 3.0])
    assert ned(vector).tolist() == [2.0, 1.0, -3.0]
    assert ned(ned(vector)).tolist() == vector.tolist()


def test_it_leans_for_the_acceleration_asked_for_and_no_further_than_it_may():
    east, north, lift = lean(np.array([1.5, -2.0, -0.7]), 0.6)
    assert [north, east, G - lift] == pytest.approx([1.5, -2.0, -0.7])
    east, north, lift = lean(np.array([50.0, 0.0, 0.0]), 0.6)
    assert math.atan2(math.hypot(north, east), lift) == pytest.approx(0.6)
    assert lift == pytest.approx(G)


def falling_freely(body):
    """A step without steering, as its autopilot lets it pass."""
    gains = Autopilot(find_firmware("px4")).commander.gains()
    body.move(Target(np.zeros(3, np.int64), np.zeros((3, 3))), gains, False, False,
              np.zeros(4), STEP)  # fmt: skip


def test_its_accelerometer_feels_the_cable_and_the_air_across_the_rotors_axis():
    """Compared with the cable's pull on two masses, and linear drag; its rotors run down."""
    body = fresh()
    in_air(body, 20.0, (0.5, 0.3))
    body.craft[VELOCITY] = body.craft[LOAD_VELOCITY] = 2.0, -1.0, 0.5
    before = body.craft.copy()
    falling_freely(body)
    thrust = 0.5 * (push(before, body.frame) + body.push)
    cable = (before[LOAD] - before[POSITION]) / PAYLOAD.length
    axes = Rotation.from_quat(before[ATTITUDE], scalar_first=True).as_matrix().T
    outer = axes[2] * thrust - body.frame.drag_across * before[VELOCITY]
    pull = -float(outer @ cable) * PAYLOAD.mass / (body.frame.mass + PAYLOAD.mass)
    assert pull > 0.2
    felt = body.felt(0.0, 0.0)
    assert felt == pytest.approx(axes @ (outer + pull * cable) * (1, -1, -1), abs=0.05)
    many = np.array([body.felt(0.5, 0.3) for _ in range(500)]) - felt
    assert many.mean(axis=0) == pytest.approx([0.3, 0.0, 0.0], abs=0.1)
    assert many.std(axis=0) == pytest.approx([0.5] * 3, abs=0.1)


def test_its_accelerometer_feels_the_ground():
    body = fresh()
    falling_freely(body)
    assert body.felt(0.0, 0.0) == pytest.approx([0.0, 0.0, -G], abs=1e-6)
