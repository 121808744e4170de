"""From telemetry to the task's track; and what a load is judged by that was let go."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from motions import moved, swung
from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.estimator import StateEstimator
from msg_bridge.mavlink.flown import flown
from msg_bridge.mavlink.payload import Payload, PayloadReport
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import ARDUPILOT
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.status import StatusReporter
from msg_bridge.mavlink.telemetry import Telemetry
from sim_nodes.tasks.slung_load import DUNK, MISS, SlungLoad

TASK = flown(SlungLoad(), FlightSettings())


class Heard:
    """Telemetry of a vehicle, and a load that a system of its own reports, by plain numbers."""

    def __init__(self, *, feed=True, cable=1.0, track=None, share=0.0):
        self.telemetry = Telemetry(1, 2)
        self.estimator = StateEstimator(
            self.telemetry, track or Track(heading=0.0), cable, feed=feed, share=share
        )
        self.sent = []
        self.link = SimpleNamespace(
            telemetry=self.telemetry, command=lambda *values: self.sent.append(values)
        )
        settings = FlightSettings(load_source="feed" if feed else "estimate")
        self.payload = Payload(TASK, self.link, ARDUPILOT, settings, self.estimator)

    def vehicle(self, t, x, height, speed=0.0, climb=0.0):
        """LOCAL_POSITION_NED: x to the east."""
        self.hear(
            dialect.MAVLink_local_position_ned_message(
                round(t * 1e3), 0.0, x, -height, 0.0, speed, -climb
            ), t, 1,
        )  # fmt: skip

    def load(self, t, x, height):
        self.hear(
            dialect.MAVLink_local_position_ned_message(
                round(t * 1e3), 0.0, x, -height, 0.0, 0.0, 0.0
            ), t, 2,
        )  # fmt: skip

    def ack(self, t, result=dialect.MAV_RESULT_ACCEPTED):
        self.hear(dialect.MAVLink_command_ack_message(dialect.MAV_CMD_DO_GRIPPER, result), t, 1)

    def hear(self, message, t, system):
        message._header.srcSystem, message._header.srcComponent = system, 1
        assert self.telemetry.take(message, t)

    def flying(self, x=0.0, height=5.0, speed=0.0):
        """Flown so fast for a second with its load below, every 0.02 s, up to 1 s."""
        for k in range(51):
            t = 0.02 * k
            here = x - speed * (1.0 - t)
            self.vehicle(t, here, height, speed)
            self.load(t, here, height - 1.0)
        return self


def swing(heard, angle, rate):
    """Let the load be thought to swing."""
    fields = swung(angle, rate)
    heard.estimator.load.direction = np.array(fields["cable"])
    heard.estimator.load.rate = np.array(fields["cable_rate"])


# ------------------------------------------------------------ the vehicle


def test_a_position_is_carried_on_along_its_velocity_but_not_for_ever():
    heard = Heard().flying(x=3.0, speed=2.0)
    now = heard.estimator.motion(1.1)
    assert (now.x, now.speed) == (pytest.approx(3.2, abs=1e-6), pytest.approx(2.0, abs=1e-6))
    assert heard.estimator.motion(9.0).x == pytest.approx(3.0 + 2.0 * 0.5, abs=1e-6)


def test_the_speed_is_carried_on_by_the_acceleration():
    heard = Heard()
    for k in range(101):
        t = 0.02 * k
        heard.vehicle(t, 0.75 * t**2, 5.0, 1.5 * t)
    now = heard.estimator.motion(2.1)
    assert now.speed == pytest.approx(1.5 * 2.1, abs=0.01)


def test_heights_count_from_where_it_stood():
    heard = Heard()
    heard.vehicle(0.0, 0.0, 12.0)
    heard.estimator.stand()
    heard.vehicle(0.02, 0.0, 17.0)
    assert heard.estimator.motion(0.02).height == pytest.approx(5.0)
    assert heard.estimator.place()[2] == pytest.approx(5.0)
    assert heard.estimator.up(5.0) == pytest.approx(17.0)


# ------------------------------------------------------------ the load


def test_a_load_on_its_cable_is_heard_of_or_old():
    heard = Heard().flying()
    assert heard.estimator.hangs()
    assert heard.estimator.load_age(1.3) == pytest.approx(0.3)
    assert Heard(feed=False).estimator.load_age(9.0) == 0.0
    heard.load(1.02, 0.0, 3.6)  # 1.4 m below a cable of 1 m
    assert not heard.estimator.hangs()
    heard.payload.release(heard.estimator.motion(1.02), 1.02)
    assert heard.estimator.load_age(9.0) == 0.0


def test_the_swing_is_carried_on_to_now():
    heard = Heard(feed=False)
    heard.flying()
    swing(heard, 0.3, 2.0)
    now = heard.estimator.motion(1.1)
    assert now.plane(0).swing == pytest.approx(
        0.3 + 0.2 - 0.5 * 9.81 * math.sin(0.4) * 0.01, abs=0.01
    )


def pulled(heard, t, ahead, left=0.0):
    """ATTITUDE and SCALED_IMU of a vehicle that looks east: what pulls along its axes [m/s²].

    It leans against that, and does not accelerate.
    """
    heard.hear(
        dialect.MAVLink_attitude_message(
            round(t * 1e3), left / 9.81, ahead / 9.81, math.pi / 2, 0.0, 0.0, 0.0
        ), t, 1,
    )  # fmt: skip
    counts = [round(v / 9.80665 * 1e3) for v in (ahead, -left, -9.81)]
    heard.hear(dialect.MAVLink_scaled_imu_message(round(t * 1e3), *counts, 0, 0, 0, 0, 0, 0), t, 1)


def test_what_the_accelerometer_feels_is_where_the_load_pulls_to():
    """It holds its place while a load swings that weighs a fifth of it."""
    heard = Heard(feed=False, share=0.2)
    for k in range(500):
        t = 0.02 * k
        angle = 0.15 * math.sin(math.sqrt(9.81) * t)
        heard.vehicle(t, 0.0, 5.0)
        pulled(heard, t, 0.2 * 9.81 * angle, 0.1 * 9.81 * angle)
    now = heard.estimator.motion(t)
    assert now.plane(0).swing == pytest.approx(angle, abs=0.04)
    assert now.plane(1).swing == pytest.approx(0.5 * angle, abs=0.04)
    rate = 0.15 * math.sqrt(9.81) * math.cos(math.sqrt(9.81) * t)
    assert now.plane(0).swing_rate == pytest.approx(rate, abs=0.1)


def test_where_the_accelerometer_falls_silent_velocities_carry_the_load_on():
    heard = Heard(feed=False, share=0.2)
    for k in range(26):
        heard.vehicle(0.02 * k, 0.0, 5.0)
        pulled(heard, 0.02 * k, 0.0)
    for k in range(26, 76):
        t = 0.02 * k
        heard.vehicle(t, 0.0, 5.0, 2.0 * (t - 0.5))
    alone = Heard(feed=False)
    for k in range(36, 76):
        t = 0.02 * k
        alone.vehicle(t, 0.0, 5.0, 2.0 * (t - 0.5))
    assert heard.estimator.motion(t).plane(0).swing == pytest.approx(
        alone.estimator.motion(t).plane(0).swing, abs=0.05
    )
    assert abs(heard.estimator.motion(t).plane(0).swing) > 0.1


def fall(heard, speed, height=5.0, drop=0.0):
    """Let go at 1 s; a parabola seen 50 times a second from a vehicle that flies on."""
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.ack(1.01)
    for k in range(1, 26):
        t = 0.02 * k
        heard.vehicle(1.0 + t, speed * t, height, speed)
        # The load is reported between two positions of the vehicle.
        t += 0.01
        down = height - 1.0 + drop - 0.5 * 9.81 * t**2
        heard.load(1.0 + t, speed * t, down)
        report = heard.payload.report(Phase.RELEASE, 1.0 + t)
        if report.reward is not None or report.failure:
            return report, 1.0 + t
    raise AssertionError("it never came down")


def test_a_load_that_hangs_below_the_rim_has_missed():
    """Let go at rest it is 1 m below the vehicle, the rim 0.9 m: no plane is crossed."""
    report, _ = fall(Heard().flying(), 0.0)
    assert report == PayloadReport(gone=True, reward=MISS)


@pytest.mark.parametrize(("x", "reward"), [(0.0, DUNK), (1.4, DUNK), (1.6, MISS), (-1.6, MISS)])
def test_a_load_is_judged_where_it_crosses_the_rim(x, reward):
    """Swung up to 60°, at rest in the air: it falls straight down from 0.5 m below us."""
    heard = Heard().flying(x=x)
    offset = math.sin(math.pi / 3)
    heard.load(1.0, x, 4.5)
    motion = moved(heard.estimator.motion(1.0), swing=math.pi / 3, x=x - offset)
    heard.payload.release(motion, 1.0)
    heard.ack(1.0)
    plane = heard.estimator.fall.plane
    assert plane == pytest.approx(5.0 - 0.9)
    assert heard.estimator.fall.lowest == pytest.approx(4.5)
    for k in range(1, 40):
        t = 0.02 * k
        heard.vehicle(1.0 + t, x - offset, 5.0)
        height = 4.5 - 0.5 * 9.81 * t**2
        heard.load(1.0 + t, x, height)
        report = heard.payload.report(Phase.RELEASE, 1.0 + t)
        assert not report.failure
        if report.reward is not None:
            assert height < plane
            break
        assert height > plane - 0.6  # seen once it is off the cable
    assert report.reward == reward
    assert heard.estimator.fall.landing[0] == pytest.approx(x, abs=1e-6)


def test_vehicle_and_load_are_of_one_moment():
    """The load falls straight down while the vehicle flies on at 5 m/s."""
    heard = Heard().flying(speed=5.0)
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.vehicle(1.10, 0.5, 5.0, 5.0)
    seen = []
    heard.estimator.fall.see = lambda place, height: seen.append(place.tolist())
    heard.load(1.14, 0.4, 3.0)
    assert seen == [pytest.approx([0.4, 0.0, 3.0], abs=1e-6)]


def test_while_it_falls_nothing_moves_the_swing():
    heard = Heard().flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    for k in range(1, 10):
        heard.vehicle(1.0 + 0.02 * k, 0.0, 5.0, 0.06 * k)
    assert not heard.estimator.load.rate.any()


# ------------------------------------------------------------ the gripper


def test_a_gripper_that_does_not_answer_is_asked_again_and_given_up():
    heard = Heard().flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    for t in np.arange(1.02, 1.99, 0.02):
        assert not heard.payload.report(Phase.RELEASE, t).failure
    assert 8 <= len(heard.sent) <= 10
    report = heard.payload.report(Phase.RELEASE, 2.02)
    assert report.failure == "the gripper did not answer for 1 s"
    assert not heard.payload.report(Phase.BRAKE, 2.04).gone  # it hangs there still


def test_a_load_that_left_without_an_answer_is_gone():
    heard = Heard().flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.estimator.fall.lowest = math.inf
    heard.load(1.1, 0.0, 3.5)
    heard.estimator.fall.lowest = math.inf  # off the cable, and not yet below the rim
    assert heard.payload.report(Phase.RELEASE, 2.2).failure
    assert heard.payload.report(Phase.BRAKE, 2.2).gone


def test_a_yes_after_which_the_load_stays_is_a_failure_after_two_seconds():
    heard = Heard().flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.ack(1.05)
    assert not heard.payload.report(Phase.RELEASE, 2.9).failure
    report = heard.payload.report(Phase.RELEASE, 3.1)
    assert "was not seen to fall" in report.failure
    assert not report.gone


def test_without_a_feed_the_answer_is_believed_and_the_parabola_judged():
    for result, found in ((0, True), (5, True), (4, False)):
        heard = Heard(feed=False).flying(x=0.0)
        motion = moved(heard.estimator.motion(1.0), swing=1.0, x=-0.8)
        heard.payload.release(motion, 1.0)
        assert heard.payload.report(Phase.RELEASE, 1.02) == PayloadReport(gone=True)
        heard.ack(1.05, result)
        report = heard.payload.report(Phase.RELEASE, 1.06)
        assert (report.reward == DUNK) is found
        assert ("MAV_RESULT_FAILED" in report.failure) is not found


def test_a_gripper_that_is_asked_again_while_at_it_is_no_refusal():
    """PX4 rejects what it is doing already, and says so of what was cancelled by the next."""
    heard = Heard(feed=False).flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.ack(1.02, 6)  # of shutting it, before
    assert heard.payload.report(Phase.RELEASE, 1.15).reward is None
    assert len(heard.sent) == 2
    heard.ack(1.16, dialect.MAV_RESULT_TEMPORARILY_REJECTED)
    report = heard.payload.report(Phase.RELEASE, 1.17)
    assert report.reward is not None
    assert not report.failure
    heard = Heard(feed=False).flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.ack(1.02, dialect.MAV_RESULT_TEMPORARILY_REJECTED)
    assert "TEMPORARILY_REJECTED" in heard.payload.report(Phase.RELEASE, 1.03).failure


def test_a_new_load_is_one_that_was_seen_after_the_gripper_was_shut():
    heard = Heard().flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    swing(heard, 0.4, 1.0)
    heard.payload.reload(2.0)
    for t in np.arange(2.02, 2.5, 0.02):
        assert not heard.payload.report(Phase.RELOAD, t).reloaded
    assert len(heard.sent) >= 5  # asked again
    heard.ack(2.5)
    heard.vehicle(2.5, 0.0, 5.0)
    assert not heard.payload.report(Phase.RELOAD, 2.5).reloaded
    heard.load(2.52, 0.0, 3.0)
    assert not heard.payload.report(Phase.RELOAD, 2.52).reloaded  # not on the cable
    heard.load(2.54, 0.0, 4.0)
    assert heard.payload.report(Phase.RELOAD, 2.54).reloaded
    assert not heard.payload.report(Phase.BRAKE, 2.56).gone
    assert heard.estimator.load.direction.tolist() == [0.0, 0.0, -1.0]
    assert not heard.estimator.load.rate.any()


def test_a_load_seen_just_after_the_gripper_was_shut_may_be_the_old_one():
    heard = Heard().flying()
    heard.payload.release(heard.estimator.motion(1.0), 1.0)
    heard.payload.reload(1.0)
    heard.ack(1.02)
    heard.load(1.1, 0.0, 4.0)
    assert not heard.payload.report(Phase.RELOAD, 1.1).reloaded
    assert not heard.payload.report(Phase.RELOAD, 5.9).lacking
    assert "no load is seen" in heard.payload.report(Phase.RELOAD, 6.1).lacking


# ------------------------------------------------------------ words


def test_what_the_autopilot_says_is_passed_on_once():
    heard, said = Heard(), []
    reporter = StatusReporter(heard.telemetry, lambda level, text: said.append((level, text)))

    def text(severity, words):
        heard.hear(dialect.MAVLink_statustext_message(severity, words), 1.0, 1)

    text(4, b"one")
    text(6, b"two")
    reporter.relay()
    reporter.relay()
    text(6, b"two")  # at the same moment
    reporter.relay()
    assert said == [
        ("warning", "autopilot: one"), ("info", "autopilot: two"), ("info", "autopilot: two"),
    ]  # fmt: skip
