"""The failure table of docs/sitl.md: what the vehicle does, what a person sees, how it goes on."""

import math
from dataclasses import replace

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.bench.flying import Dying, Flying, lost, pilot, pushes
from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.codec import Codec
from msg_bridge.mavlink.phases import Phase
from sim_nodes.autopilot.autopilot import TICK
from sim_nodes.tasks.slung_load import DUNK, RELEASE

LIKES = ["px4", "ardupilot"]


class Station:
    """Another ground station, on a link of its own."""

    def __init__(self, flying, key=None):
        self.transport = flying.world.connect()
        self.codec = Codec(254, 190, key)
        self.say(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def say(self, message):
        self.transport.write(self.codec.pack(message))

    def command(self, number, *values):
        padded = [*values, *[0.0] * (7 - len(values))]
        self.say(dialect.MAVLink_command_long_message(1, 1, number, 0, *padded))

    def mode(self, profile, mode):
        self.command(dialect.MAV_CMD_DO_SET_MODE, 1.0, *profile.mode_halves(mode))


def hold_mode(profile):
    """HOLD, or BRAKE: LOITER obeys its own sticks, which nobody has lifted."""
    return {"px4": 4 << 16 | 3 << 24, "ardupilot": 17}[profile.name]


@pytest.mark.parametrize("like", LIKES)
def test_learner_killed(tmp_path, like):
    with Flying(tmp_path, like, initial="narrow") as f:
        f.act = dying = Dying(f.task, 3)
        late, distance = lost(f, dying)
        assert late < 0.07  # a setpoint, and two more that the jerk is limited over
        assert distance < 1.0
        assert f.heard("hold: the learner is silent")
        dying.alive = True
        f.episodes(1)


def test_learner_frozen(tmp_path):
    """It wakes up and answers what is long past: nobody listens to that."""
    with Flying(tmp_path, "px4", initial="narrow") as f:
        missed, asleep = [], False
        fly = pilot(f.task)

        def act(seen):
            nonlocal asleep
            asleep = asleep or (seen.step == 4 and not missed)
            if asleep:
                missed.append(seen)
                return None
            return fly(seen)

        f.act = act
        f.until(lambda: asleep)
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        f.until(lambda: f.speed < 0.15)
        since, asleep = f.clock.now(), False
        for seen in missed:
            assert not f.flight.act(seen.episode, seen.step, 2, since) or seen is missed[-1]
        f.wait(0.5)
        assert not any(m.afy > 2.9 for _, m in f.setpoints(since) if pushes(m))
        assert f.episodes(1)[0].reward == DUNK


@pytest.mark.parametrize(("loss", "dunks"), [(0.1, 2), (0.5, 0)])
def test_packets_lost(tmp_path, loss, dunks):
    """A tenth does not matter; with half of them nothing goes well, but nothing breaks."""
    with Flying(tmp_path, "ardupilot", autopilot={"SIM_LOSS": 0.0}) as f:
        f.in_episode()
        f.change("SIM_LOSS", loss)
        if dunks:
            assert sum(end.reward == DUNK for end in f.episodes(3)) >= dunks
        for _ in range(20):
            f.wait(1.0)
            assert f.inside()
        f.change("SIM_LOSS", 0.0)
        f.episodes(1)
        assert not f.broken


@pytest.mark.parametrize("like", LIKES)
def test_delay_of_300_ms(tmp_path, like):
    """Loops through such a link would not be stable: the autopilot holds the vehicle itself."""
    with Flying(tmp_path, like, initial="narrow") as f:
        f.in_episode()
        f.change("SIM_DELAY", 0.3)
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        f.wait(6.0)
        assert f.speed < 0.3
        assert f.inside()
        assert f.heard("the link is slow")
        f.change("SIM_DELAY", 0.0)
        f.episodes(1)


@pytest.mark.parametrize("like", LIKES)
@pytest.mark.parametrize("seconds", [0.5, 3.0, 30.0])
def test_link_cut(tmp_path, like, seconds):
    """The autopilot itself stops the vehicle: its time-outs were set to that."""
    with Flying(tmp_path, like, initial="narrow") as f:
        f.act = dying = Dying(f.task, 10**6)
        f.in_episode(step=4)
        start = f.body()[0]
        f.change("SIM_CUT", seconds)
        f.wait(seconds)
        if seconds > 1.0:
            assert f.speed < 0.3
            assert np.linalg.norm(f.body()[0][:2] - start[:2]) < 9.0
        f.until(lambda: f.telemetry.position_time > f.clock.now() - 0.2)
        assert f.inside()
        dying.alive = True
        f.episodes(1)
        assert f.heard("nothing heard for") or seconds <= f.flight.timeouts.telemetry_timeout


@pytest.mark.parametrize("like", LIKES)
def test_bridge_killed(tmp_path, like):
    """Nobody sends anything any more: no landing, no good-bye. The next one flies on."""
    with Flying(tmp_path, like, initial="narrow") as f:
        f.act = Dying(f.task, 10**6)
        f.in_episode(step=4)
        f.kill()
        f.wait(4.0)
        assert f.speed < 0.6  # the load still swings the vehicle about
        assert f.inside()
        f.act.alive = True
        f.start()
        f.episodes(1)
        assert f.inside()


@pytest.mark.parametrize("like", LIKES)
def test_autopilot_restarted(tmp_path, like):
    """It comes back with heartbeats alone, as real ones do: messages are asked for again."""
    with Flying(tmp_path, like) as f:
        f.in_episode()
        firmware = f.autopilot.firmware
        f.autopilot.firmware = replace(firmware, rates={"HEARTBEAT": 1.0})
        f.autopilot.boot()
        f.until(lambda: f.flight.phase is Phase.DOWN)
        since = f.clock.now()
        assert f.heard("activate the bridge again to fly on: iolspi manage bridge fly")
        f.until(lambda: f.telemetry.position_time > since)
        f.wait(2.0)
        assert not f.setpoints(since + 0.1)
        assert f.heard("the autopilot was restarted")
        f.flight.begin(f.clock.now())
        f.episodes(1)


@pytest.mark.parametrize("like", LIKES)
def test_mode_changed_by_another_ground_station(tmp_path, like):
    with Flying(tmp_path, like) as f:
        f.in_episode()
        other = Station(f)
        other.mode(f.profile, hold_mode(f.profile))
        f.until(lambda: f.flight.ruling.authority is Authority.OTHER)
        f.wait(5.0)
        assert f.telemetry.mode == hold_mode(f.profile)  # nobody argues
        assert f.speed < 0.3
        assert f.heard("somebody changed the mode")
        other.mode(f.profile, f.profile.controlled)
        f.episodes(1)


@pytest.mark.parametrize("like", LIKES)
def test_disarming_in_flight_is_refused_by_the_autopilot_and_nothing_changes(tmp_path, like):
    with Flying(tmp_path, like) as f:
        f.in_episode()
        Station(f).command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0)
        f.episodes(1)
        assert f.telemetry.armed
        assert not f.heard("disarmed")


@pytest.mark.parametrize("like", LIKES)
def test_estimator_lost(tmp_path, like):
    with Flying(tmp_path, like) as f:
        f.in_episode()
        f.change("SIM_EKF_FAIL", 1)
        f.until(lambda: f.flight.phase is Phase.DOWN)
        assert f.heard("position estimate") or f.heard("the autopilot's own failsafe changed")
        assert f.body()[0][2] < 0.2
        assert not f.broken


@pytest.mark.parametrize("how", [1, 2])
@pytest.mark.parametrize("like", LIKES)
def test_gripper_refused(tmp_path, like, how):
    """1: it says no; 2: it says yes, and the load stays where it is."""
    with Flying(tmp_path, like) as f:
        f.in_episode()
        f.change("SIM_GRIP_FAIL", how)
        word = "gripper was refused" if how == 1 else "was not seen to fall"
        f.until(lambda: f.heard(word))
        assert not f.ends
        f.change("SIM_GRIP_FAIL", 0)
        f.episodes(1)


@pytest.mark.parametrize("where", ["in_air", "in_episode"])
def test_load_feed_lost(tmp_path, where):
    with Flying(tmp_path, "px4") as f:
        getattr(f, where)()
        f.change("SIM_LOAD_RATE", 0.0)
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        f.wait(3.0)
        assert f.flight.ruling.authority is Authority.HOLD
        assert f.speed < 0.3
        assert f.heard("the load is not heard")
        f.change("SIM_LOAD_RATE", 20.0)
        f.episodes(1)


@pytest.mark.parametrize("jump", [5.0, -5.0])
def test_clock_jump(tmp_path, jump):
    with Flying(tmp_path, "ardupilot") as f:
        f.in_episode()
        f.change("SIM_CLOCK_JUMP", jump)
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        assert f.heard("clock has jumped")
        f.episodes(1)


@pytest.mark.parametrize("like", LIKES)
@pytest.mark.parametrize("seconds", [0.6, 3.0])
def test_bridge_frozen(tmp_path, like, seconds):
    """What comes of it is not put down to the autopilot's clock, or to somebody."""
    with Flying(tmp_path, like, initial="narrow") as f:
        f.in_episode()
        end = f.clock.now() + seconds
        while f.clock.now() < end:
            f.world.advance()
        f.episodes(1)
        assert f.inside()
        assert f.heard(f"hold: the bridge itself stood still for {seconds:.1f} s")
        assert not f.heard("clock")
        assert not f.heard("nothing heard")
        assert not f.heard("somebody")
        if like == "px4" and seconds > 1.0:
            assert f.heard("the autopilot's own failsafe changed the mode to HOLD")


@pytest.mark.parametrize("like", LIKES)
def test_a_bridge_that_was_frozen_stops_the_vehicle_where_it_is_by_now(tmp_path, like):
    """It was about to accelerate from rest; by what was heard before, it would be flown back."""
    with Flying(tmp_path, like, initial="narrow") as f:
        f.act = Dying(f.task, 10**6)
        f.in_episode(step=1)
        start = f.body()[0][0]
        for _ in range(round(1.2 / TICK)):
            f.world.advance()
        woken = f.clock.now()
        assert abs(f.body()[0][0] - start) > 0.3
        f.wait(0.06)
        there = f.body()[0][0]
        asked = [m.y for _, m in f.setpoints(woken) if not m.type_mask & 0b11]
        assert all(abs(y - there) < 0.3 for y in asked), (start, there, asked)


def test_starts_are_kept_away_from_the_walls_as_far_as_the_noise_asks(tmp_path):
    """PX4 is wrong by 0.2 m and 0.3 m/s: 0.3 m, three times both together, and 0.1 m."""
    low = -6.5 + 0.3 + 3 * math.hypot(0.2, 0.3) + 0.1
    with Flying(tmp_path, "px4", order="sweep") as f:
        f.in_air()
        assert f.flight._machine.target[0] == pytest.approx(low)  # the task's own first is -6.0
        f.in_episode(step=0)
        assert f.flight.status()["margin [m]"] >= 1.38


def test_wrong_system_id(tmp_path):
    """Of the autopilot: the preflight says whom it heard. Of a stranger: nobody listens to it."""
    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        stranger = Codec(7, 1)
        lie = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)  # disarmed
        for message in f.link.codec.read(stranger.pack(lie), whole=True):
            f.telemetry.take(message, f.clock.now())
        assert f.telemetry.strangers == {7: 1}
        f.episodes(1)
        assert not f.heard("disarmed")


@pytest.mark.parametrize("like", LIKES)
def test_a_companion_on_the_vehicle_is_not_the_autopilot(tmp_path, like):
    """Its heartbeats say neither that the motors stand still nor that the mode has changed."""
    with Flying(tmp_path, like) as f:
        f.in_episode()
        companion = Codec(1, dialect.MAV_COMP_ID_ONBOARD_COMPUTER)
        heartbeat = dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
        for _ in range(20):
            for message in f.link.codec.read(companion.pack(heartbeat), whole=True):
                f.telemetry.take(message, f.clock.now())
            f.wait(0.05)
        f.episodes(1)
        assert not f.heard("disarmed")
        assert not f.heard("changed the mode")


def test_nobody_has_ever_answered(tmp_path):
    """It asks again and again at the same place, and lands after a minute."""
    with Flying(tmp_path, "px4", lambda seen: None, autopilot={"SIM_WANDER": 0.0}) as f:
        f.in_air()
        since = f.clock.now()
        f.until(lambda: f.flight.phase is Phase.DOWN)
        landed = next(change for change in f.changes if change.phase is Phase.LANDING)
        assert f.heard("land: nobody has answered for 60 s")
        assert 50.0 < landed.time - since < 90.0
        asked = [seen for _, seen in f.seen if seen.step == 0]
        assert len(asked) > 20
        assert np.ptp([seen.state[0] for seen in asked]) < 0.3
        assert f.flight.abandoned == f.flight.flown == 0
        f.act = pilot(f.task)
        f.flight.begin(f.clock.now())
        f.episodes(1)


def test_who_lets_the_deadmans_button_go_holds_it(tmp_path):
    """But for the climb: nobody is left halfway up."""
    with Flying(tmp_path, "ardupilot") as f:
        f.flight.supervise(deadman=False)
        f.in_air()
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        assert f.body()[0][2] > 4.5
        assert f.heard("the deadman's button was let go")
        f.flight.supervise(deadman=True)
        f.in_episode()
        f.flight.supervise(deadman=False)
        f.until(lambda: f.speed < 0.15)
        assert f.flight.abandoned == 1
        f.flight.supervise(deadman=True)
        f.episodes(1)


def test_a_person_takes_over_and_gives_back(tmp_path):
    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        f.flight.supervise(stick=(-1.0, 0.0))
        f.until(lambda: f.body()[1][0] < -1.2)
        assert f.flight.ruling.authority is Authority.PILOT
        f.flight.supervise(stick=(0.0, 0.0))
        f.until(lambda: f.speed < 0.15)
        f.flight.supervise(stick=None)
        f.episodes(1)
        assert f.heard("pilot: a person has taken over")


def test_a_release_is_not_taken_from_who_does_not_command(tmp_path):
    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        _, seen = f.seen[-1]
        f.act = lambda seen: None
        f.until(lambda: f.seen[-1][1].step > seen.step)
        _, seen = f.seen[-1]
        f.flight.supervise(paused=True)
        f.flight.act(seen.episode, seen.step, RELEASE, f.clock.now())
        f.wait(1.0)
        assert f.autopilot.body.attached
        assert f.flight.ruling.authority is Authority.HOLD


def test_beyond_the_envelope_it_brakes_and_holds(tmp_path):
    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        f.flight.limits = replace(f.limits, heights=(0.5, 2.0))
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        assert f.heard("hold: envelope: height is")
        assert (f.flight.violations, f.flight.abandoned) == (1, 1)
        f.flight.limits = f.limits
        f.episodes(1)
        assert f.flight.violations == 1


def test_a_fault_of_our_own_does_not_end_the_flight(tmp_path, monkeypatch):
    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        tick, faults = f.flight.tick, []

        def faulty(now):
            if len(faults) < 5:
                faults.append(now)
                raise RuntimeError("not thought of")
            tick(now)

        monkeypatch.setattr(f.flight, "tick", faulty)
        f.episodes(1)
        assert len(faults) == 5
        (said,) = [text for _, _, text in f.said if "a fault in the bridge" in text]  # once
        assert "not thought of" in said


KEY, WRONG = bytes(range(32)), bytes(32)


def test_unsigned_and_wrongly_signed_packets(tmp_path):
    with Flying(tmp_path, "px4", keys=(KEY, KEY)) as f:
        f.in_episode()
        for key in (None, WRONG):
            liar = Codec(1, 1, key)
            lie = dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)
            assert not list(f.link.codec.read(liar.pack(lie), whole=True))
            Station(f, key).mode(f.profile, hold_mode(f.profile))
        f.episodes(1)
        assert f.telemetry.mode == f.profile.controlled
        assert not f.heard("disarmed")
        assert not f.heard("changed the mode")
        assert f.link.codec.rejected >= 2


def test_a_million_random_and_mutated_bytes(tmp_path):
    """In flight, on the bridge's own parser, between the packets that matter."""
    rng = np.random.default_rng(0)
    sample = Codec(1, 1)
    good = [
        sample.pack(dialect.MAVLink_local_position_ned_message(0, 1, 2, 3, 4, 5, 6)),
        sample.pack(dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 3, 3)),
        sample.pack(dialect.MAVLink_command_ack_message(211, 4)),
        sample.pack(dialect.MAVLink_statustext_message(0, b"a" * 50)),
    ]

    def junk():
        total = 0
        while total < 1_000_000:
            if rng.random() < 0.5:
                data = rng.bytes(int(rng.integers(1, 600)))
            else:
                packet = bytearray(good[rng.integers(len(good))])
                for _ in range(rng.integers(1, 8)):
                    packet[rng.integers(len(packet))] = rng.integers(256)
                data = bytes(packet)
            total += len(data)
            yield data

    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        before = f.telemetry.armed, f.telemetry.mode
        taken = 0
        for n, data in enumerate(junk()):
            if n % 10 == 0:
                f.world.wait()
            for message in f.link.codec.read(data, whole=True):
                taken += message.get_type() != "HEARTBEAT"
        assert taken <= 3  # a checksum of 16 bits lets one in 65,536 through
        assert (f.telemetry.armed, f.telemetry.mode) == before
        assert f.flight.phase is not Phase.DOWN
        f.until(lambda: f.flight.flown + f.flight.abandoned > 0)
        assert not f.heard("a fault in the bridge")


def test_a_state_that_is_no_number_is_not_believed(tmp_path):
    with Flying(tmp_path, "px4") as f:
        f.in_episode()
        nan = dialect.MAVLink_local_position_ned_message(0, *[math.nan] * 6)
        nan._header.srcSystem = 1
        f.telemetry.take(nan, f.clock.now())
        f.episodes(1)
        assert all(np.isfinite(seen.state).all() for _, seen in f.seen)
