"""Frames and units between MAVLink and this graph, both ways."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink import convert
from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.profiles import ARDUPILOT, PX4
from msg_bridge.mavlink.setpoints import (
    AccelerationSetpoint,
    Integral,
    PositionSetpoint,
    VelocitySetpoint,
    packet,
)
from msg_bridge.mavlink.telemetry import parameter_raw, parameter_value

EAST, NORTH = Track(), Track(heading=math.pi / 2)
vectors = arrays(float, 3, elements=st.floats(-1e3, 1e3))
angles = st.floats(-math.pi, math.pi)


def test_masks_are_those_that_were_flown():
    assert convert.ACCELERATION == 0x0C3F
    assert convert.ACCELERATION_HEIGHT == 0x0D3B
    assert convert.VELOCITY == 0x0DC7
    assert convert.POSITION == 0x0DF8


def test_a_position_report_in_ned_is_enu_here():
    message = dialect.MAVLink_local_position_ned_message(0, 1.0, 2.0, -5.0, 0.1, 0.2, 0.3)
    position, velocity = convert.local_position(message)
    np.testing.assert_allclose(position, [2.0, 1.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(velocity, [0.2, 0.1, -0.3], atol=1e-7)


def globe(latitude, longitude, altitude):
    return dialect.MAVLink_global_position_int_message(
        0, round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3), 0, 0, 0, 0, 0
    )


def test_a_place_on_the_globe_is_metres_here():
    """A minute of latitude is a nautical mile, 1852 m, within half a percent anywhere."""
    here, there = globe(47.0, 8.0, 500.0), globe(47.0 + 1.0 / 60.0, 8.0, 499.0)
    east, north, up = convert.global_offset(there, here)
    assert east == 0.0
    assert north == pytest.approx(1852.0, rel=5e-3)
    assert up == pytest.approx(-1.0)
    east, _, _ = convert.global_offset(globe(60.0, 8.0 + 1e-3, 0.0), globe(60.0, 8.0, 0.0))
    assert east == pytest.approx(111.195 * 0.5, rel=5e-3)  # cos 60° is a half


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw", "up"),
    [
        (0.0, 0.0, 1.2, (0.0, 0.0, 1.0)),
        (0.0, -0.3, 0.0, (0.0, math.sin(0.3), math.cos(0.3))),  # nose down, to the north
        (0.0, -0.3, math.pi / 2, (math.sin(0.3), 0.0, math.cos(0.3))),  # to the east
        (0.3, 0.0, 0.0, (math.sin(0.3), 0.0, math.cos(0.3))),  # right side down: to the east
        (0.3, 0.0, math.pi, (-math.sin(0.3), 0.0, math.cos(0.3))),
    ],
)
def test_who_leans_pushes_that_way(roll, pitch, yaw, up):
    message = dialect.MAVLink_attitude_message(0, roll, pitch, yaw, 0, 0, 0)
    assert convert.upwards(message) == pytest.approx(up, abs=1e-9)


def test_tilt():
    def at(roll, pitch):
        return convert.tilt(dialect.MAVLink_attitude_message(0, roll, pitch, 1.0, 0, 0, 0))

    assert at(0.0, 0.0) == 0.0
    assert at(0.3, 0.0) == pytest.approx(0.3, abs=1e-6)
    assert at(0.0, -0.3) == pytest.approx(0.3, abs=1e-6)
    assert at(math.pi, 0.0) == pytest.approx(math.pi, abs=1e-6)


def test_tracks_point_where_they_say():
    np.testing.assert_allclose(NORTH.here(np.array([0.0, 1.0, 0.0])), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(NORTH.here(np.array([1.0, 0.0, 0.0])), [0, -1, 0], atol=1e-12)
    shifted = Track((10.0, 20.0), math.pi / 2)
    np.testing.assert_allclose(
        shifted.place_here(np.array([10.0, 23.0, 4.0])), [3, 0, 4], atol=1e-12
    )


@given(vectors, angles, st.floats(-100, 100), st.floats(-100, 100))
def test_tracks_there_and_back(vector, heading, east, north):
    track = Track((east, north), heading)
    np.testing.assert_allclose(track.there(track.here(vector)), vector, atol=1e-9)
    np.testing.assert_allclose(track.place_there(track.place_here(vector)), vector, atol=1e-9)


@pytest.mark.parametrize("track", [EAST, NORTH])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_acceleration_along_the_track_goes_out_in_ned(track, sign):
    message = packet(AccelerationSetpoint(3.0 * sign, 0.0, 0.5, 5.0), ARDUPILOT, track, (1, 1), 2.0)
    ahead = message.afx if track is NORTH else message.afy
    across = message.afy if track is NORTH else message.afx
    assert ahead == pytest.approx(3.0 * sign)
    assert across == pytest.approx(0.0, abs=1e-9)
    assert message.afz == pytest.approx(-0.5)
    assert (message.type_mask, message.coordinate_frame) == (0x0C3F, 1)
    assert message.time_boot_ms == 2000


def test_px4_is_given_the_height_as_a_position():
    message = packet(AccelerationSetpoint(3.0, 1.0, 0.5, 5.0), PX4, EAST, (1, 1), 0.0)
    assert message.type_mask == 0x0D3B
    assert (message.afy, message.afx, message.z) == (3.0, 1.0, -5.0)


def test_velocities_and_places_go_out_in_ned():
    message = packet(VelocitySetpoint(2.0, 1.0, 0.5), PX4, NORTH, (1, 1), 0.0)
    np.testing.assert_allclose([message.vx, message.vy, message.vz], [2, -1, -0.5], atol=1e-12)
    message = packet(PositionSetpoint(2.0, 1.0, 5.0), PX4, Track((10.0, 20.0), 0.0), (1, 1), 0.0)
    np.testing.assert_allclose([message.x, message.y, message.z], [21, 12, -5], atol=1e-12)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("setpoint", [AccelerationSetpoint, VelocitySetpoint, PositionSetpoint])
def test_what_is_not_finite_is_never_a_packet(setpoint, value):
    for place in range(3):
        numbers = [0.0] * len(setpoint._fields)
        numbers[place] = value
        with pytest.raises(ValueError, match="finite"):
            packet(setpoint(*numbers), ARDUPILOT, EAST, (1, 1), 0.0)


def test_accelerations_summed_up_are_velocities():
    integral = Integral()
    speeds = [integral.velocity(3.0, 0.0, 0.1) for _ in range(3)]
    np.testing.assert_allclose(speeds, [0.3, 0.6, 0.9])
    for _ in range(50):
        assert integral.velocity(3.0, 0.0, 0.1) <= Integral.lead  # a vehicle that does not move
    integral.forget()
    assert integral.velocity(-3.0, 2.0, 0.1) == pytest.approx(1.7)


@pytest.mark.parametrize("value", [0.0, 5.0, -1.0, 2147483647.0])
def test_integers_of_px4_travel_as_their_bytes(value):
    raw = parameter_raw(PX4, value, dialect.MAV_PARAM_TYPE_INT32)
    assert parameter_value(PX4, raw, dialect.MAV_PARAM_TYPE_INT32) == value
    assert parameter_raw(PX4, 5.0, dialect.MAV_PARAM_TYPE_INT32) == pytest.approx(5 * 2.0**-149)
    assert parameter_raw(ARDUPILOT, value, dialect.MAV_PARAM_TYPE_INT32) == value
    assert parameter_raw(PX4, 0.5, dialect.MAV_PARAM_TYPE_REAL32) == 0.5
