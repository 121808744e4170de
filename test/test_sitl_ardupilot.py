"""What was measured on ArduCopter 4.7-dev, row by row, on the embedded autopilot that imitates it.

Each test names the topic of its row. The figures are those of the real one, with tolerances; where
the imitation is milder or the real one was seen to vary, the test says so.
"""

import hashlib
import math

import numpy as np
import pytest
from mavlink_peer import ACCELERATION, GUIDED, VELOCITY, Peer, flying
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_nodes.autopilot.firmware import WITH_GRIPPER

GUIDED_MODE, LOITER, RTL, LAND, BRAKE, STABILIZE = 4, 5, 6, 9, 17, 0
BARE = {"SIM_LOAD_MASS": 1e-3, "SIM_LOAD_RATE": 0.0}  # measured without a load


def copter(**parameters):
    return flying("ardupilot", parameters=BARE | parameters)


@pytest.fixture
def ready():
    peer = Peer("ardupilot", parameters=BARE)
    peer.run(43.0)
    return peer


def slope(peer, push, start=0.8, end=2.0):
    times, speeds = [], []

    def step(t):
        peer.aim(ACCELERATION, push=(push, 0, 0))
        times.append(t)
        speeds.append(peer.body.truth[1][0])

    peer.run(end, step, 50)
    late = np.array(times) > start
    return np.polyfit(np.array(times)[late], np.array(speeds)[late], 1)[0]


def test_heartbeat():
    """Row "heartbeat": type 2, autopilot 3; 1 Hz, 5 Hz on request."""
    peer = Peer("ardupilot")
    peer.run(10.0)
    beats = peer.of("HEARTBEAT")
    assert len(beats) == pytest.approx(10, abs=1)
    assert {(b.type, b.autopilot, b.get_srcComponent()) for b in beats} == {(2, 3, 1)}
    assert peer.command(511, 0, 2e5) == [0]
    since = peer.now
    peer.run(10.0)
    assert len(peer.of("HEARTBEAT", since)) == pytest.approx(50, abs=2)


def test_mode_numbers():
    """Row "external control mode"."""
    peer = copter()
    for number in (LOITER, RTL, LAND, BRAKE, GUIDED_MODE):
        assert peer.mode(number) == [0]
        peer.run(1.0)
        assert peer.shown == number


def test_mode_refused():
    """Row "mode change": refused with ACK 4 and a text; GUIDED before the EKF is ready: ACK 0."""
    peer = Peer("ardupilot")
    peer.run(2.0)
    assert peer.mode(*GUIDED) == [0]
    assert peer.mode(99) == [4]
    assert peer.texts()
    peer = copter()
    peer.set("SIM_EKF_FAIL", 1)
    assert peer.mode(LOITER) == [4]
    assert "Mode change to LOITER failed: requires position" in peer.texts()


def test_arming_refused_until_42_s_after_boot():
    """Row "arming"."""
    peer = Peer("ardupilot")
    peer.mode(*GUIDED)
    assert peer.command(400, 1) == [4]
    assert peer.texts() == ["Arm: Need Position Estimate"]
    peer.until(lambda: peer.command(400, 1) == [0], 60.0)
    assert peer.now == pytest.approx(42.0, abs=1.0)


def test_setpoints_do_nothing_before_a_take_off_of_5_s(ready):
    """Row "before take-off"."""
    ready.mode(*GUIDED)
    ready.command(400, 1)
    ready.run(4.0, lambda _: ready.aim(VELOCITY, speed=(1, 0, -2)))
    assert (ready.body.truth[0] == 0.0).all()
    assert ready.command(22, 0, 0, 0, 0, 0, 0, 5) == [0]
    assert ready.until(lambda: ready.body.height > 4.75, 20.0) == pytest.approx(5.3, abs=0.4)


def test_acceleration_setpoints():
    """Row "acceleration setpoint": slopes near 3 with altitude held; larger ones saturate."""
    for push, real in ((3.0, 3.17), (-3.0, -3.06), (5.0, 4.3), (8.0, 4.3)):
        peer = copter()
        peer.run(2.0)
        height = peer.body.height
        assert slope(peer, push) == pytest.approx(real, abs=0.2)
        assert abs(peer.body.height - height) < 0.02


def test_saturation_follows_the_parameter():
    """Row "acceleration setpoint": it is ANGLE_MAX that limits."""
    peer = copter(ANGLE_MAX=1500)
    assert slope(peer, 8.0) < 2.3


def test_one_ignore_bit_ignores_the_vector():
    """Row "partial masks": z position with ax flies as acceleration only."""
    peer = copter()
    peer.run(2.0, lambda _: peer.aim(0x0C3B, place=(0, 0, -20), push=(2, 0, 0)))
    assert peer.body.truth[1][0] > 3.0
    assert peer.body.height == pytest.approx(5.0, abs=0.1)
    peer = copter()
    peer.run(2.0, lambda _: peer.aim(0x0DCF, speed=(2, 0, 0)))  # vx ignored
    assert np.linalg.norm(peer.body.truth[1]) < 0.1


def test_acceleration_of_nothing_coasts():
    """Row "acceleration 0": 3.50 to 3.43 m/s in 5 s."""
    peer = copter()
    peer.run(1.2, lambda _: peer.aim(ACCELERATION, push=(3, 0, 0)))
    peer.run(1.0, lambda _: peer.aim(ACCELERATION))
    before = peer.body.truth[1][0]
    peer.run(5.0, lambda _: peer.aim(ACCELERATION))
    assert -0.15 < peer.body.truth[1][0] - before < 0.05


@pytest.mark.parametrize(("jerk", "lowest", "highest"), [(5.0, 6.9, 7.9), (20.0, 2.4, 3.2)])
def test_fast_square_waves(jerk, lowest, highest):
    """Row "fast square waves": 1 Hz, ±3 m/s²: 7.4 m/s after 6 s with jerk 5, 2.8 with 20."""
    peer = copter(PSC_JERK_XY=jerk)
    fastest = 0.0

    def step(t):
        nonlocal fastest
        peer.aim(ACCELERATION, push=(3 if t % 1.0 < 0.5 else -3, 0, 0))
        fastest = max(fastest, abs(peer.body.truth[1][0]))

    peer.run(6.0, step, 50)
    assert lowest < fastest < highest


def test_velocity_setpoint():
    """Row "velocity setpoint 2 m/s": latency 0.26 s, 10-90 % in 1.0 s, steady 2.00; 1 Hz suffices.

    The imitation rises in 0.8 s.
    """
    peer = copter()
    peer.run(2.0)
    times, speeds, heights = [], [], []
    for i in range(1000):
        if i % 200 == 0:
            peer.aim(VELOCITY, speed=(2, 0, 0))
        peer.run(0.005)
        times.append(0.005 * (i + 1))
        speeds.append(peer.body.truth[1][0])
        heights.append(peer.body.height)
    times, speeds = np.array(times), np.array(speeds)
    ten, ninety = times[np.argmax(speeds > 0.2)], times[np.argmax(speeds > 1.8)]
    assert times[np.argmax(speeds > 0.1)] == pytest.approx(0.26, abs=0.1)
    assert ninety - ten == pytest.approx(1.0, abs=0.3)
    assert speeds[-1] == pytest.approx(2.0, abs=0.03)
    assert max(speeds) < 2.05
    assert np.ptp(heights) < 0.02


@pytest.mark.parametrize(("time_out", "fastest"), [(3.0, 9.3), (0.5, 4.3)])
def test_the_last_setpoint_is_held(time_out, fastest):
    """Row "stream stops": 1 s of 3 m/s² and silence; the mode stays."""
    peer = copter(GUID_TIMEOUT=time_out)
    peer.run(1.0, lambda _: peer.aim(ACCELERATION, push=(3, 0, 0)))
    speeds = []
    for _ in range(160):
        peer.run(0.05)
        speeds.append(peer.body.truth[1][0])
    assert max(speeds) == pytest.approx(fastest, rel=0.1)
    peer.run(4.0)
    assert abs(peer.body.truth[1][0]) < 0.1
    assert peer.shown == GUIDED_MODE


@pytest.mark.parametrize(
    "bad",
    [
        {"mask": VELOCITY, "speed": (2, 0, 0), "frame": 12},
        {"mask": VELOCITY, "speed": (math.nan, 0, 0)},
        {"mask": ACCELERATION | 1 << 9, "push": (2, 0, 0)},
        {"mask": 0x0FFF},
    ],
)
def test_a_bad_setpoint_stops_it_in_silence(bad):
    """Row "bad setpoint"."""
    peer = copter()
    peer.run(3.0, lambda _: peer.aim(VELOCITY, speed=(2, 0, 0)))
    since = peer.now
    peer.run(3.0, lambda _: peer.aim(**bad))
    assert np.linalg.norm(peer.body.truth[1]) < 0.1
    assert peer.texts(since) == []
    assert peer.shown == GUIDED_MODE


def test_an_acceleration_of_nan_aborts_it():
    """Row "bad setpoint"."""
    peer = copter()
    peer.aim(ACCELERATION, push=(0, math.nan, 0))
    since = peer.now
    peer.autopilot.advance(3.0)
    peer.listen()
    assert peer.autopilot.commander.aborted
    assert not [m for at, m in peer.heard if at > since]


def test_wrong_target():
    """Row "wrong target": another system is ignored without an ACK; any component will do."""
    peer = copter()
    assert peer.command(176, 1, LOITER, system=3) == []
    assert peer.command(176, 1, LOITER, component=77) == [0]


def test_a_second_sender_is_obeyed():
    """Row "second sender": setpoints and modes of another system."""
    peer = copter()
    other = Peer("ardupilot", system=42, share=peer.autopilot)
    other.run(3.0, lambda _: other.aim(VELOCITY, speed=(0, 2, 0)))
    assert peer.body.truth[1][1] == pytest.approx(2.0, abs=0.1)
    assert other.mode(BRAKE) == [0]
    peer.run(1.0)
    assert peer.shown == BRAKE


@pytest.mark.parametrize("enabled", [0, 1])
def test_ground_station_lost(enabled):
    """Row "GCS heartbeat lost": nothing by default; with 1 RTL after 4.9 s while streaming."""
    peer = copter(FS_GCS_ENABLE=enabled)
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    peer.run(3.0, lambda _: peer.send(beat), 1.0)
    seen = peer.autopilot.commander.ground_station_seen

    def stream(_):
        peer.aim(VELOCITY, speed=(0.2, 0, 0))

    if not enabled:
        peer.run(8.0, stream)
        assert peer.shown == GUIDED_MODE
        return
    peer.until(lambda: peer.shown == RTL, 8.0, stream)
    assert peer.now - seen == pytest.approx(5.4, abs=0.6)  # its heartbeat comes up to 1 s late
    peer.send(beat)
    peer.run(2.0, stream)
    assert peer.shown == RTL


def test_override_of_the_stick():
    """Row "RC override": in GUIDED pitch is ignored and yaw obeyed; channel 5 changes the mode."""
    peer = copter()

    def stick(width5):
        widths = [1500, 1200, 1500, 1700, width5, 0, 0, 0]
        peer.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *widths))

    def both(_):
        stick(1800)
        peer.aim(VELOCITY, speed=(0, 0, 0))

    peer.run(1.0, both)
    assert np.linalg.norm(peer.body.truth[1]) < 0.1
    assert peer.body.attitude[0, 2] > 0.3
    stick(1650)  # position 5: LOITER
    peer.run(1.1)
    assert peer.shown == LOITER


def test_a_lapsed_override_crashes_it():
    """Rows "RC override" (it lapses after 3.06 s) and "seen mistakes"."""
    peer = copter()
    widths = [1500, 1500, 1500, 1500, 1650, 0, 0, 0]
    peer.send(mavlink.MAVLink_rc_channels_override_message(1, 1, *widths))
    peer.run(0.1)
    start = peer.now - 0.1
    peer.until(lambda: peer.autopilot.commander.mode.name == "MANUAL", 5.0)
    assert peer.now - start == pytest.approx(3.06, abs=0.1)
    fastest = 0.0
    while not peer.body.broken:
        assert peer.now < start + 10.0
        fastest = max(fastest, peer.body.truth[1][2])
        peer.run(0.005)
    assert fastest == pytest.approx(8.9, abs=1.0)
    peer.run(0.1)
    assert not peer.autopilot.commander.armed
    assert "Crash: Disarming" in peer.texts()


def pulse(peer):
    return peer.of("SERVO_OUTPUT_RAW")[-1].servo9_raw


def test_gripper():
    """Row "DO_GRIPPER(211)": ACK 4; ACK 0 and nothing until a boot; then at once, and a text."""
    peer = Peer("ardupilot")
    peer.run(1.0)
    assert peer.command(211, 1, 0) == [4]
    for name, value in WITH_GRIPPER["ardupilot"].items():
        assert peer.command(211, 1, 0) in ([4], [0])
        peer.set(name, value)
    assert peer.command(211, 1, 0) == [0]
    peer.run(2.0)
    assert peer.body.attached
    assert peer.command(246, 1) == [0]
    peer.run(1.0)
    peer.command(511, 36, 1e4)
    assert pulse(peer) == 1500
    start = peer.now
    assert peer.command(211, 1, 0) == [0]
    peer.run(0.05)
    assert pulse(peer) == 1100
    assert not peer.body.attached
    peer.until(lambda: "Gripper load released" in peer.texts(start), 2.0)
    assert peer.now - start == pytest.approx(0.56, abs=0.03)
    assert peer.command(211, 1, 1) == [0]
    peer.run(1.0)
    assert peer.body.attached


@pytest.mark.parametrize("lacking", ["GRIP_TYPE", "SERVO9_FUNCTION"])
def test_half_a_gripper_says_yes_and_moves_nothing(lacking):
    peer = Peer("ardupilot", parameters=WITH_GRIPPER["ardupilot"] | {lacking: 0})
    assert peer.command(211, 1, 0) == [0]
    peer.run(2.0)
    assert peer.body.attached
    assert not peer.texts()


def test_servo():
    """Row "DO_SET_SERVO(183)": a free channel takes any width, a motor's channel none."""
    peer = Peer("ardupilot")
    peer.command(511, 36, 1e4)
    assert peer.command(183, 9, 5000) == [0]
    peer.run(0.1)
    assert pulse(peer) == 5000
    assert peer.command(183, 2, 1500) == [4]
    assert peer.command(183, 9, 1100) == [0]
    peer.run(0.1)
    assert not peer.body.attached


def signed(key, stamp, component=190):
    mav = mavlink.MAVLink(None, 255, component)
    mav.signing.secret_key, mav.signing.sign_outgoing = key, True
    mav.signing.timestamp = stamp
    return mav


def test_signing():
    """Row "signing": unsigned, wrong key and stale stamps are dropped; refused while armed."""
    key = hashlib.sha256(b"a key for a test").digest()
    peer = Peer("ardupilot", key=key)
    peer.run(1.0)
    peer.mav.signing.secret_key = key  # else it would take what it hears for unsigned
    stamp = int((peer.autopilot.unix_microseconds * 1e-6 - 1420070400) * 1e5)

    def asks(mav):
        since = peer.now
        message = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 5, 0, 0, 0, 0, 0)
        data = bytes(message.pack(mav))
        peer.autopilot.receive(peer.link, data)
        peer.run(0.01)
        return data, [m.result for m in peer.of("COMMAND_ACK", since)]

    assert asks(mavlink.MAVLink(None, 255, 190))[1] == []
    assert asks(signed(hashlib.sha256(b"another").digest(), stamp, 191))[1] == []
    assert asks(signed(key, stamp - 100 * 100_000, 192))[1] == []
    good = signed(key, stamp)
    data, results = asks(good)
    assert results == [0]
    assert peer.of("COMMAND_ACK")[-1].get_signed()
    since = peer.now
    peer.run(0.01)
    peer.autopilot.receive(peer.link, data)  # the same again
    assert peer.of("COMMAND_ACK", since + 0.005) == []


def test_signing_is_not_set_up_while_armed():
    """Row "signing"."""
    peer = copter()
    setup = mavlink.MAVLink_setup_signing_message(1, 1, [7] * 32, 0)
    peer.send(setup)
    assert peer.mode(LOITER) == [0]
    assert not peer.of("COMMAND_ACK")[-1].get_signed()


def test_the_load_is_a_second_system():
    """Row "slung load in the simulator": sysid 2, comp 35, GLOBAL_POSITION_INT at 10 Hz."""
    peer = flying("ardupilot", 3.0)
    peer.command(511, 33, 1e5)
    since = peer.now
    peer.run(10.0)
    found = peer.of("GLOBAL_POSITION_INT", since, system=2)
    assert {m.get_srcComponent() for m in found} == {35}
    assert len(found) == pytest.approx(100, abs=2)
    own = peer.of("GLOBAL_POSITION_INT", since)[-1]
    assert found[-1].relative_alt - own.relative_alt == pytest.approx(-1000, abs=20)
    assert abs(found[-1].lat - own.lat) < 5
    stamps = np.diff([m.time_boot_ms for m in found])
    assert (np.abs(stamps - 100) <= 5).all()
