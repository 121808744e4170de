"""The embedded autopilot on a link: protocol, failures on demand, and what it withstands."""

import math

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from mavlink_peer import GUIDED, VELOCITY, Peer, flying
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from iolspi_ros.errors import InputError
from sim_nodes.autopilot.firmware import WITH_GRIPPER

LIKES = ["px4", "ardupilot"]
SEEK = (Phase.explicit, Phase.generate)  # no shrinking: a flight takes too long


@pytest.fixture(params=LIKES)
def like(request):
    return request.param


def stream(peer, speed=(0, 0, 0)):
    return lambda _: peer.aim(VELOCITY, speed=speed)


def mode(peer):
    return peer.autopilot.commander.mode.name


# ------------------------------------------------------------ one seed, one flight


def flight(seed):
    bad = {"SIM_NOISE": 0.05, "SIM_WIND_SPD": 3.0, "SIM_WIND_TURB": 1.0, "SIM_LOSS": 0.1,
           "SIM_DELAY": 0.05, "GRIP_ENABLE": 1}  # fmt: skip
    peer = Peer("ardupilot", seed=seed, parameters=bad)
    bytes_out = []

    for _ in range(20):
        for number, *numbers in ((176, 1, 4), (400, 1), (22, 0, 0, 0, 0, 0, 0, 4)):
            numbers += [0] * (7 - len(numbers))
            message = mavlink.MAVLink_command_long_message(1, 1, number, 0, *numbers)
            peer.autopilot.receive(peer.link, bytes(message.pack(peer.mav)))
        peer.autopilot.advance(3.0)
        bytes_out += peer.link.out
        peer.link.out.clear()
    assert peer.body.height > 3.0
    return bytes_out


def test_one_seed_gives_the_same_bytes():
    assert flight(3) == flight(3)
    assert flight(3) != flight(4)


# ------------------------------------------------------------ protocol


def values(peer):
    return {m.param_id: m for m in peer.of("PARAM_VALUE")}


def test_parameters_are_listed_read_and_set(like):
    peer = Peer(like)
    names = peer.autopilot.parameters.names
    peer.send(mavlink.MAVLink_param_request_list_message(1, 1))
    found = peer.of("PARAM_VALUE")
    assert [m.param_id for m in found] == names
    assert [m.param_index for m in found] == list(range(len(names)))
    assert {m.param_count for m in found} == {len(names)}
    peer.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 3))
    assert peer.of("PARAM_VALUE")[-1].param_id == names[3]
    name = {"px4": "COM_OF_LOSS_T", "ardupilot": "GUID_TIMEOUT"}[like]
    peer.set(name, 0.5)
    assert values(peer)[name].param_value == 0.5
    peer.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    assert peer.of("PARAM_VALUE")[-1].param_value == 0.5
    peer.set(name, math.nan)
    assert peer.of("PARAM_VALUE")[-1].param_value == 0.5
    before = len(peer.of("PARAM_VALUE"))
    peer.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    assert len(peer.of("PARAM_VALUE")) == before


def test_whole_numbers_travel_as_each_autopilot_sends_them():
    copter, px4 = Peer("ardupilot"), Peer("px4")
    copter.set("ANGLE_MAX", 4500)
    assert values(copter)["ANGLE_MAX"].param_value == 4500.0
    px4.set("COM_OBL_RC_ACT", 5)
    raw = values(px4)["COM_OBL_RC_ACT"].param_value
    assert np.float32(raw).view(np.int32) == 5
    assert px4.autopilot.parameters["COM_OBL_RC_ACT"] == 5
    px4.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", 3.0, 9))  # as a float
    assert px4.autopilot.parameters["COM_OBL_RC_ACT"] == 5


def test_messages_come_when_asked_for(like):
    peer = Peer(like)
    peer.run(1.0)
    assert peer.command(512, 148) == [0]
    version = peer.of("AUTOPILOT_VERSION")[-1]
    bit = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    assert bool(version.capabilities & bit) is (like == "px4")
    assert peer.command(511, 30, 1e4) == [0]
    since = peer.now
    peer.run(2.0)
    assert len(peer.of("ATTITUDE", since)) == pytest.approx(200, abs=2)
    assert peer.command(511, 30, -1) == [0]
    since = peer.now
    peer.run(1.0)
    assert peer.of("ATTITUDE", since) == []
    assert peer.command(510, 30) == [0]
    assert peer.of("MESSAGE_INTERVAL")[-1].interval_us == -1
    assert peer.command(31999) == [3]


def test_commands_come_as_int_too(like):
    peer = Peer(like)
    peer.send(mavlink.MAVLink_command_int_message(1, 1, 0, 512, 0, 0, 1, 0, 0, 0, 0, 0, 0))
    assert peer.of("COMMAND_ACK")[-1].command == 512


def test_clocks(like):
    peer = Peer(like, epoch=1.7e9)
    peer.order(511, 2, 1e6)
    peer.run(10.0)
    stamp = peer.of("SYSTEM_TIME")[-1]
    assert stamp.time_unix_usec / 1e6 - stamp.time_boot_ms / 1e3 == pytest.approx(1.7e9, abs=1e-3)
    peer.send(mavlink.MAVLink_timesync_message(0, 777))
    answer = peer.of("TIMESYNC")[-1]
    assert (answer.ts1, answer.tc1) == (777, 10_000_000_000)
    peer.set("SIM_CLOCK_JUMP", -4.0)
    peer.send(mavlink.MAVLink_timesync_message(0, 778))
    assert peer.of("TIMESYNC")[-1].tc1 == 6_000_000_000


def test_a_reboot_keeps_the_parameters_and_is_refused_in_flight(like):
    peer = flying(like, 3.0)
    peer.set("SIM_WIND_SPD", 0.5)
    assert peer.command(246, 1) == [4]
    assert peer.command(246, 1, 0, 0, 0, 0, 20190226) == [0]
    assert peer.now < 0.1
    assert not peer.autopilot.commander.armed
    assert peer.body.height == 0.0
    assert peer.autopilot.parameters["SIM_WIND_SPD"] == 0.5


# ------------------------------------------------------------ flight


def test_disarming_in_flight_is_refused(like):
    peer = flying(like, 3.0)
    assert peer.command(400, 0) in ([1], [4])
    assert peer.autopilot.commander.armed
    assert peer.command(400, 0, 21196) == [0]
    peer.run(3.0)
    assert peer.body.broken


def test_it_flies_home_and_lands(like):
    peer = flying(like, 3.0)
    peer.run(4.0, stream(peer, (1.5, 1.0, 0)))
    away = np.hypot(*peer.body.truth[0][:2])
    assert away > 4.0
    assert peer.command(20) == [0]
    peer.until(lambda: not peer.autopilot.commander.armed, 90.0)
    assert np.hypot(*peer.body.truth[0][:2]) < 0.5
    assert peer.body.landed
    assert not peer.body.broken


def test_it_brakes_and_holds_in_wind(like):
    peer = flying(like, 3.0, parameters={"SIM_WIND_SPD": 4.0, "SIM_WIND_TURB": 0.5})
    peer.run(3.0, stream(peer, (2, 0, 0)))
    peer.mode(*{"px4": (4, 3), "ardupilot": (17,)}[like])  # its LOITER sinks
    peer.run(15.0)
    place = peer.body.truth[0].copy()
    peer.run(10.0)
    assert np.linalg.norm(peer.body.truth[0] - place) < 0.5


def test_a_new_load_hangs_below():
    peer = flying("px4", 4.0, parameters=WITH_GRIPPER["px4"])
    hold = stream(peer)
    peer.order(211, 1, 0)
    peer.run(2.0, hold)
    assert peer.body.load[0][2] == 0.0
    peer.order(211, 1, 1)
    peer.run(0.1, hold)
    np.testing.assert_allclose(peer.body.load[0] - peer.body.truth[0], [0, 0, 1], atol=0.05)


# ------------------------------------------------------------ failures on demand


def test_estimator_lost(like):
    peer = flying(like, 3.0)
    peer.order(511, {"px4": 230, "ardupilot": 193}[like], 2e5)
    peer.set("SIM_EKF_FAIL", 1)
    since = peer.now
    peer.run(1.5, stream(peer))
    assert mode(peer) == "LAND"
    assert peer.of("LOCAL_POSITION_NED", since + 0.05) == []
    assert peer.texts(since)
    assert not peer.of("ESTIMATOR_STATUS" if like == "px4" else "EKF_STATUS_REPORT")[-1].flags & 16
    peer.until(lambda: not peer.autopilot.commander.armed, 30.0, stream(peer))
    assert not peer.body.broken
    assert peer.command(400, 1) in ([1], [4])


@pytest.mark.parametrize(("failure", "first"), [(1, 4), (2, None)])
def test_gripper_refused_or_stuck(like, failure, first):
    peer = Peer(like, parameters={"SIM_GRIP_FAIL": failure} | WITH_GRIPPER[like])
    answer = peer.command(211, 1, 0)
    assert answer == [first or {"px4": 5, "ardupilot": 0}[like]]
    peer.run(2.0)
    assert peer.body.attached


def test_load_feed_lost():
    peer = Peer("ardupilot")
    peer.run(1.0)
    peer.set("SIM_LOAD_RATE", 0.0)
    since = peer.now
    peer.run(2.0)
    assert peer.of("GLOBAL_POSITION_INT", since + 0.01, system=2) == []


def test_link_cut(like):
    peer = Peer(like)
    peer.run(1.0)
    peer.set("SIM_CUT", 3.0)
    since = peer.now
    peer.run(5.0)
    gone = [at for at, _ in peer.heard if since < at]
    assert gone[0] - since == pytest.approx(3.0, abs=0.2)


def test_packet_loss_and_delay(like):
    peer = Peer(like, parameters={"SIM_LOSS": 0.3, "SIM_DELAY": 0.3})
    peer.run(1.0)
    since = peer.now
    peer.command(511, 30, 1e4)
    for _ in range(20):
        peer.order(511, 30, 1e4)
    peer.run(20.0)
    heard = [(at, m) for at, m in peer.heard if m.get_type() == "ATTITUDE" and at > since + 0.7]
    assert len(heard) == pytest.approx(0.7 * 1930, rel=0.1)
    for at, message in heard:
        assert at - message.time_boot_ms / 1e3 == pytest.approx(0.3, abs=0.006)


def test_noise_is_as_large_as_asked_for():
    peer = flying("ardupilot")
    peer.set("SIM_NOISE", 0.1)
    errors = []
    for _ in range(120):
        peer.run(1.0)
        errors.append(peer.body.position - peer.body.truth[0])
    assert np.std(errors) == pytest.approx(0.1, rel=0.2)


# ------------------------------------------------------------ what it withstands


@settings(max_examples=30, deadline=None, phases=SEEK)
@given(st.binary(max_size=600), st.integers(0, 2**32 - 1))
def test_random_and_mutated_bytes(noise, seed):
    peer = Peer("ardupilot")
    rng = np.random.default_rng(seed)
    peer.autopilot.receive(peer.link, noise)
    for _ in range(20):
        good = mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        bad = bytearray(good.pack(peer.mav))
        for place in rng.integers(0, len(bad), 3):
            bad[place] ^= 1 << int(rng.integers(0, 8))
        peer.autopilot.receive(peer.link, bytes(bad[: int(rng.integers(1, len(bad) + 1))]))
    peer.run(0.1)
    assert peer.command(*(176, 1, *GUIDED)) == [0]


COMMANDS = [20, 21, 22, 176, 183, 187, 211, 246, 400, 510, 511, 512]


@settings(max_examples=100, deadline=None, phases=SEEK)
@given(
    st.sampled_from(LIKES), st.sampled_from(COMMANDS),
    st.lists(st.floats(width=32), min_size=7, max_size=7),
)  # fmt: skip
def test_commands_with_any_numbers(like, number, numbers):
    peer = Peer(like)
    peer.order(number, *numbers)
    whole = [int(x) if math.isfinite(x) and abs(x) < 2**31 else 0 for x in numbers[4:6]]
    peer.send(mavlink.MAVLink_command_int_message(
        1, 1, 0, number, 0, 0, *numbers[:4], *whole, numbers[6]))  # fmt: skip
    peer.run(0.5)
    assert np.isfinite(peer.body.craft).all()


numbers = st.tuples(*[st.floats(width=32)] * 3)


@settings(max_examples=25, deadline=None, phases=SEEK)
@given(st.sampled_from(LIKES), st.integers(0, 65535), st.integers(0, 20), numbers, numbers, numbers)
def test_setpoints_with_any_numbers(like, mask, frame, place, speed, push):
    peer = flying(like, 2.0)
    peer.run(1.0, lambda _: peer.aim(mask, place, speed, push, frame))
    assert np.isfinite(peer.body.craft).all()
    assert np.abs([*peer.body.truth, *peer.body.load]).max() < 100.0


@pytest.mark.parametrize(
    ("name", "value"), [("NO_SUCH", 1.0), ("SIM_LOSS", 2.0), ("SIM_DELAY", math.nan)]
)
def test_bad_parameters_are_refused(name, value):
    with pytest.raises(InputError, match=name):
        Peer("px4", parameters={name: value})
    if name in Peer("px4").autopilot.parameters:
        peer = Peer("px4")
        peer.set(name, value)
        assert peer.autopilot.parameters[name] == 0.0
