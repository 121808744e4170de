"""What was measured on PX4 1.17-alpha, row by row, on the embedded autopilot that imitates it.

Each test names the topic of its row; the figures are those of the real one.
"""

import numpy as np
import pytest
from mavlink_peer import ACCELERATION, OFFBOARD, VELOCITY, Peer, flying
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_nodes.autopilot.firmware import WITH_GRIPPER

BARE = {"SIM_LOAD_MASS": 1e-3}  # measured without a load
HEIGHT_AND_PUSH = 0x0D3B


def custom(main, sub=0):
    return main << 16 | sub << 24


OFFBOARD_MODE, HOLD, RTL, LAND, TAKEOFF = (
    custom(6), custom(4, 3), custom(4, 5), custom(4, 6), custom(4, 2)
)  # fmt: skip


def copter(**parameters):
    return flying("px4", parameters=BARE | parameters)


@pytest.fixture
def ready():
    peer = Peer("px4", parameters=BARE)
    peer.run(9.0)
    return peer


def stream(peer, speed=(0, 0, 0)):
    return lambda _: peer.aim(VELOCITY, speed=speed)


def now_in(peer, mode):
    """Whether it does a mode, without waiting for a heartbeat."""
    return peer.autopilot.firmware.modes[peer.autopilot.commander.mode] == mode


def test_heartbeat():
    """Row "heartbeat": type 2, autopilot 12; stays at 1 Hz whatever is asked."""
    peer = Peer("px4")
    assert peer.command(511, 0, 2e5) == [0]
    peer.run(10.0)
    beats = peer.of("HEARTBEAT")
    assert len(beats) == pytest.approx(10, abs=1)
    assert {(b.type, b.autopilot, b.get_srcComponent()) for b in beats} == {(2, 12, 1)}


def test_mode_numbers():
    """Row "external control mode"."""
    peer = copter()
    for main, sub in ((4, 3), (4, 5), (4, 6), (4, 2)):
        assert peer.mode(main, sub) == [0]
        peer.run(1.0)
        assert peer.shown == custom(main, sub)
    peer.run(0.5, stream(peer))
    assert peer.mode(*OFFBOARD) == [0]
    peer.run(1.0, stream(peer))
    assert peer.shown == OFFBOARD_MODE


def test_a_refused_mode_is_acknowledged(ready):
    """Row "mode change": ACK 0 always; only HEARTBEAT tells."""
    assert ready.mode(*OFFBOARD) == [0]
    ready.run(2.0)
    assert ready.shown == HOLD
    assert ready.mode(77) == [0]
    assert ready.texts() == []


def test_arming(ready):
    """Row "arming": ACK 1 in OFFBOARD without a stream; disarms itself 10 s later on the ground."""
    ready.run(0.5, stream(ready))
    ready.mode(*OFFBOARD)
    ready.run(1.5)
    assert ready.command(400, 1) == [1]
    assert ready.command(176, 1, 4, 3) == [0]
    assert ready.command(400, 1) == [0]
    start = ready.now
    ready.until(lambda: not ready.autopilot.commander.armed, 20.0)
    assert ready.now - start == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize(
    ("rate", "modes"), [(0.5, {HOLD}), (2.0, {OFFBOARD_MODE}), (0.9, {OFFBOARD_MODE, RTL})]
)
def test_the_stream_decides(rate, modes):
    """Row "before take-off": 2 Hz will do, 0.5 Hz is refused, 0.9 Hz flaps."""
    peer = copter()
    peer.mode(4, 3)
    peer.run(8.0)
    seen = set()
    peer.run(8.0, stream(peer), rate)
    peer.mode(*OFFBOARD)

    def step(t):
        peer.aim(VELOCITY)

    for _ in range(10):
        for _ in range(round(1.0 / rate / 0.01)):
            peer.run(0.01)
            seen.add(peer.autopilot.firmware.modes[peer.autopilot.commander.mode])
        step(None)
    assert seen == modes


def test_pure_acceleration_does_not_hold_altitude():
    """Row "acceleration setpoint": 1 m in 6.5 s."""
    peer = copter()
    height = peer.body.height
    peer.run(6.5, lambda _: peer.aim(ACCELERATION))
    assert abs(peer.body.height - height) == pytest.approx(1.0, abs=0.2)


@pytest.mark.parametrize("push", [3.0, -3.0])
def test_acceleration_with_height(push):
    """Row "acceleration setpoint": mask 0x0D3B holds within 0.3 m; 3 m/s² less its drag."""
    peer = copter()
    speeds = []

    def step(_):
        peer.aim(HEIGHT_AND_PUSH, place=(0, 0, -5), push=(push, 0, 0))
        speeds.append(peer.body.truth[1][0])
        assert abs(peer.body.height - 5.0) < 0.3

    peer.run(2.0, step, 50)
    assert np.sign(speeds[-1]) == np.sign(push)
    assert abs(speeds[49]) == pytest.approx(1.72, rel=0.15)
    assert abs(speeds[-1]) == pytest.approx(2.6, rel=0.15)


def test_acceleration_of_nothing_coasts():
    """Row "acceleration 0": drag aside."""
    peer = copter(SIM_DRAG=0.0)

    def push(size):
        return lambda _: peer.aim(HEIGHT_AND_PUSH, place=(0, 0, -5), push=(size, 0, 0))

    peer.run(1.0, push(3))
    peer.run(1.0, push(0))
    before = peer.body.truth[1][0]
    peer.run(5.0, push(0))
    assert peer.body.truth[1][0] == pytest.approx(before, abs=0.07)


def test_fast_square_waves():
    """Row "fast square waves": a 1 Hz square wave is tracked, less the drag."""
    peer = copter()
    fastest = 0.0

    def step(t):
        nonlocal fastest
        push = 3 if t % 1.0 < 0.5 else -3
        peer.aim(HEIGHT_AND_PUSH, place=(0, 0, -5), push=(push, 0, 0))
        fastest = max(fastest, abs(peer.body.truth[1][0]))

    peer.run(6.0, step, 50)
    assert 0.8 < fastest < 1.5


@pytest.mark.parametrize(("drag", "steady"), [(1.0, 1.64), (0.0, 2.13)])
def test_velocity_setpoint(drag, steady):
    """Row "velocity setpoint 2 m/s": 1.64 with the simulator's drag, 2.13 without."""
    peer = copter(SIM_DRAG=drag)
    peer.run(5.0, stream(peer, (2, 0, 0)))
    assert peer.body.truth[1][0] == pytest.approx(steady, rel=0.05)


@pytest.mark.parametrize(
    ("time_out", "act", "soonest", "latest", "mode"),
    [(1.0, 0, 1.1, 1.6, RTL), (0.2, 5, 0.25, 0.4, HOLD)],
)
def test_stream_stops(time_out, act, soonest, latest, mode):
    """Row "stream stops": failsafe at 1.1 to 1.6 s, RTL by default; OFFBOARD returns by itself.

    HOLD at 0.3 s with act 5: taken to be with a shorter time-out.
    """
    peer = copter(COM_OF_LOSS_T=time_out, COM_OBL_RC_ACT=act)
    peer.run(1.0, stream(peer, (1, 0, 0)))
    peer.aim(VELOCITY, speed=(1, 0, 0))
    took = peer.until(lambda: not now_in(peer, OFFBOARD_MODE), 3.0)
    assert soonest - 0.006 <= took <= latest
    peer.run(1.0)
    assert peer.shown == mode
    peer.run(1.1, stream(peer, (1, 0, 0)))
    assert peer.shown == OFFBOARD_MODE


def test_bad_setpoint():
    """Row "bad setpoint": frame 9 gives a text each, and no stream: failsafe."""
    peer = copter()
    since = peer.now
    peer.run(1.0, lambda _: peer.aim(VELOCITY, frame=9))
    assert len(peer.texts(since)) == 20
    peer.run(1.0, lambda _: peer.aim(VELOCITY, frame=9))
    assert not now_in(peer, OFFBOARD_MODE)


def test_wrong_target():
    """Row "wrong target": no ACK for another system or component."""
    peer = copter()
    assert peer.command(176, 1, 4, 3, system=3) == []
    assert peer.command(176, 1, 4, 3, component=77) == []
    assert peer.command(176, 1, 4, 3, component=0) == [0]


def test_ground_station_lost():
    """Row "GCS heartbeat lost": text only."""
    peer = copter()
    peer.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    since = peer.now
    peer.run(12.0, stream(peer))
    assert "Connection to ground station lost" in peer.texts(since)
    assert peer.shown == OFFBOARD_MODE


def test_manual_control():
    """Row "MANUAL_CONTROL": moves nothing; when it stops, HOLD within 0.9 s."""
    peer = copter()

    def both(_):
        peer.send(mavlink.MAVLink_manual_control_message(1, 1000, 0, 500, 0, 0))
        peer.aim(VELOCITY)

    peer.run(2.0, both)
    assert np.linalg.norm(peer.body.truth[1]) < 0.1
    assert now_in(peer, OFFBOARD_MODE)
    assert peer.until(lambda: now_in(peer, HOLD), 2.0, stream(peer)) <= 0.9


def answers(peer, since):
    return [m.result for m in peer.of("COMMAND_ACK", since) if m.command == 211]


def test_gripper():
    """Row "DO_GRIPPER(211)": ACK 5 at once, then 0 after `PD_GRIPPER_TO`."""
    peer = Peer("px4", parameters=WITH_GRIPPER["px4"])
    start = peer.now
    assert peer.command(211, 1, 0) == [5]
    peer.until(lambda: answers(peer, start) == [5, 0], 4.0)
    assert peer.now - start == pytest.approx(3.0, abs=0.02)
    assert not peer.body.attached
    assert peer.command(211, 1, 0) == [0]  # it is open


def test_without_a_gripper_it_does_not_even_answer():
    """Measured: of 69 commands none was acknowledged; nor before a restart."""
    peer = Peer("px4")
    assert peer.command(211, 1, 0) == []
    peer.set("PD_GRIPPER_EN", 1)
    assert peer.command(211, 1, 0) == []
    peer.run(4.0)
    assert answers(peer, 0.0) == []
    assert peer.body.attached
    assert peer.command(246, 1) == [0]
    assert peer.command(211, 1, 0) == [5]


def test_a_gripper_at_work_rejects_the_same_and_is_cancelled_by_the_opposite():
    """As in its source: `payload_deliverer.cpp`."""
    peer = Peer("px4", parameters=WITH_GRIPPER["px4"])
    start = peer.now
    assert peer.command(211, 1, 0) == [5]
    assert peer.command(211, 1, 0) == [1]
    assert peer.command(211, 1, 1) == [6, 5]
    peer.run(4.0)
    assert answers(peer, start) == [5, 1, 6, 5, 0]
    assert peer.body.attached


def test_its_output_is_seen_to_move_in_flight_alone():
    """Outputs that are not armed stay as they are (`mixer_module.cpp`)."""
    peer = flying("px4", parameters=WITH_GRIPPER["px4"])
    assert peer.command(211, 1, 0) == [5]
    peer.run(0.2, lambda _: peer.aim(ACCELERATION))
    assert peer.of("SERVO_OUTPUT_RAW")[-1].servo5_raw == 1000
    ground = Peer("px4", parameters=WITH_GRIPPER["px4"])
    ground.command(211, 1, 0)
    ground.run(0.2)
    assert ground.of("SERVO_OUTPUT_RAW")[-1].servo5_raw == 0


def test_servo_and_actuator(ready):
    """Row "DO_SET_SERVO(183)": ACK 3; DO_SET_ACTUATOR(187) instead."""
    assert ready.command(183, 9, 1100) == [3]
    assert ready.body.attached
    assert ready.command(187, 1.0) == [0]
    ready.run(0.1)
    assert not ready.body.attached
    assert ready.command(187, -1.0) == [0]
    ready.run(0.1)
    assert ready.body.attached


def test_it_has_no_load_feed_of_its_own():
    """Row "slung load in the simulator": none; a feed from outside may stand in."""
    peer = copter()
    assert not peer.of("GLOBAL_POSITION_INT", system=2)
    peer.set("SIM_LOAD_RATE", 10.0)
    peer.run(1.0)
    assert len(peer.of("GLOBAL_POSITION_INT", system=2)) == pytest.approx(10, abs=1)


def test_failsafes_of_several_losses_end_one_by_one():
    peer = copter(NAV_DLL_ACT=2)
    peer.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    peer.run(11.0, stream(peer))
    assert now_in(peer, RTL)
    peer.set("SIM_EKF_FAIL", 1)
    peer.run(0.1, stream(peer))
    assert now_in(peer, LAND)
    peer.set("SIM_EKF_FAIL", 0)
    peer.run(0.1, stream(peer))
    assert now_in(peer, RTL)
    peer.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
    peer.run(0.1, stream(peer))
    assert now_in(peer, OFFBOARD_MODE)


def test_it_disarms_on_the_ground_also_in_offboard():
    peer = copter()
    peer.until(
        lambda: not peer.autopilot.commander.armed,
        20.0,
        lambda _: peer.aim(VELOCITY, speed=(0, 0, 1)),
    )
    assert not peer.body.broken


def test_who_asks_for_what_a_failsafe_does_keeps_it():
    peer = copter(COM_OBL_RC_ACT=5)
    peer.run(1.5)
    assert now_in(peer, HOLD)
    assert peer.mode(4, 3) == [0]
    peer.run(1.0, stream(peer))
    assert now_in(peer, HOLD)
