"""What real autopilots said, recorded, through the bridge's own parsing: nothing is ours here.

What must be found is read from the same file by pymavlink alone, or known from how it was flown.
"""

import struct
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.codec import Codec
from msg_bridge.mavlink.motion import Motion
from msg_bridge.mavlink.telemetry import NEVER, Telemetry, parameter_value

DATA = Path(__file__).parent / "data"
LIKES = ("px4", "ardupilot")
GRIPPER, ARM, SET_MODE = 211, 400, 176


def packets(path):
    """(time [s], bytes) of a .tlog of MAVLink 2."""
    raw, at = path.read_bytes(), 0
    while at < len(raw):
        (stamp,) = struct.unpack_from(">Q", raw, at)
        size = 12 + raw[at + 9] + 13 * (raw[at + 10] & 1)
        yield stamp * 1e-6, raw[at + 8 : at + 8 + size]
        at += 8 + size


class Replay:
    """One recording, taken in as the bridge does; with what pymavlink says of it."""

    def __init__(self, like):
        self.profile = profiles.PROFILES[like]
        self.telemetry, codec = Telemetry(1, 2), Codec(255, 190)
        plain = mavlink.MAVLink(None)
        plain.robust_parsing = True
        self.raw, self.states, start = [], [], None
        for stamp, data in packets(DATA / f"{like}.tlog"):
            start = stamp if start is None else start
            now = stamp - start
            self.raw += [(now, m) for m in plain.parse_buffer(data)]
            for message in codec.read(data, whole=True):
                t = self.telemetry
                if t.take(message, now):
                    tilt = Motion(up=tuple(t.up)).tilt
                    self.states.append((now, message.get_type(), t.mode, t.armed, t.position.copy(),
                                        t.velocity.copy(), dict(t.acks), tilt))  # fmt: skip
        self.rejected = codec.rejected

    def of(self, kind):
        return [(now, m) for now, m in self.raw if m.get_type() == kind and m.get_srcSystem() == 1]

    def after(self, kind):
        """States just after each message of a kind."""
        return [state for state in self.states if state[1] == kind]


@pytest.fixture(scope="module")
def replays():
    return {like: Replay(like) for like in LIKES}


@pytest.fixture(params=LIKES)
def replay(request, replays):
    return replays[request.param]


def test_who_it_is(replay):
    assert replay.telemetry.autopilot == replay.profile.autopilot
    assert replay.rejected == 0
    assert replay.telemetry.ready
    assert replay.telemetry.restarts == 0
    assert replay.telemetry.jump_time == NEVER


def test_modes_and_arming_are_those_of_its_heartbeats(replay):
    beats = [(m.custom_mode, bool(m.base_mode & 128)) for _, m in replay.of("HEARTBEAT")
             if m.get_srcComponent() == 1]  # fmt: skip
    seen = [(mode, armed) for _, _, mode, armed, *_ in replay.after("HEARTBEAT")]
    assert seen == beats
    modes = [mode for mode, _ in seen]
    flown = modes.index(replay.profile.controlled)
    assert replay.profile.landing in modes[flown:]
    armed = [state for _, state in seen]
    assert armed == sorted(armed[: armed.index(True)]) + armed[armed.index(True) :]
    assert not armed[0]
    assert not armed[-1]


def test_the_mode_that_is_left_at_the_end(replays):
    """ArduCopter stays in LAND; PX4 shows OFFBOARD once more."""
    assert replays["ardupilot"].telemetry.mode == profiles.ARDUPILOT.landing
    assert replays["px4"].telemetry.mode == profiles.PX4.controlled


def test_positions_are_those_of_the_file(replay):
    """North, east, down in the file; east, north, up here."""
    raw = replay.of("LOCAL_POSITION_NED")
    seen = replay.after("LOCAL_POSITION_NED")
    assert len(seen) == len(raw) > 100
    for (_, m), (_, _, _, _, position, velocity, _, _) in zip(raw, seen, strict=True):
        np.testing.assert_allclose(position, [m.y, m.x, -m.z])
        np.testing.assert_allclose(velocity, [m.vy, m.vx, -m.vz])


def test_the_flight_is_seen(replay):
    """To 5 m, eastwards with up to 2.5 m/s, and down again."""
    path = np.array([[now, *position, *velocity] for now, kind, _, _, position, velocity, *_ in
                     replay.states if kind == "LOCAL_POSITION_NED"])  # fmt: skip
    ground = path[0, 3]
    assert path[:, 3].max() - ground == pytest.approx(5.0, abs=0.7)
    assert abs(path[-1, 3] - ground) < 0.6
    assert 1.2 < path[:, 4].max() < 3.2
    lift = path[np.argmax(path[:, 3] > ground + 0.5), 0]
    armed = next(now for now, _, _, armed, *_ in replay.states if armed)
    assert 1.0 < lift - armed < 6.0
    tilts = [tilt for *_, tilt in replay.after("ATTITUDE")]
    assert 0.2 < max(tilts) < 0.6


def test_answers(replays):
    """Refused arming is an ACK 4 there; DO_GRIPPER is done at once, or first in progress."""
    for like, gripper in (("ardupilot", {0}), ("px4", {5, 0})):
        raw = [(m.command, m.result) for _, m in replays[like].of("COMMAND_ACK")]
        seen = replays[like].after("COMMAND_ACK")
        for (command, result), (_, _, _, _, _, _, acks, _) in zip(raw, seen, strict=True):
            assert acks[command][1] == result
        assert {result for command, result in raw if command == GRIPPER} == gripper
        assert (ARM, 0) in raw
        assert (SET_MODE, 0) in raw
    assert (ARM, 4) in [(m.command, m.result) for _, m in replays["ardupilot"].of("COMMAND_ACK")]


def test_words(replays):
    texts = [text for _, _, text in replays["ardupilot"].telemetry.texts]
    assert any("Gripper load released" in text for text in texts)
    assert any("Arm: Need Position Estimate" in text for text in texts)
    assert any("Takeoff detected" in text for _, _, text in replays["px4"].telemetry.texts)


def test_parameters_are_numbers_whatever_they_travel_as(replays):
    """PX4 sends an integer's bytes in a float, ArduCopter the number."""
    found = replays["ardupilot"].telemetry.parameters["GUID_TIMEOUT"]
    assert parameter_value(profiles.ARDUPILOT, *found) == 3.0
    found = replays["px4"].telemetry.parameters["COM_OBL_RC_ACT"]
    assert parameter_value(profiles.PX4, *found) == 0.0
