"""What sensors say and cannot be so: found, and nothing that is so is taken for it."""

import itertools
import math

import numpy as np
import pytest

from iolspi_ros.bench.flying import Flying
from iolspi_ros.errors import InputError
from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.payload import Seen
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.plausibility import LoadCheck, VehicleCheck

DT = 0.02
G = 9.81


class Truth:
    """A vehicle that follows accelerations late, with drag and an estimate that is noisy."""

    def __init__(self, seed=0, lag=0.3, drag=0.0, noise=(0.0, 0.0), wind=0.0):
        self.rng = np.random.default_rng(seed)
        self.lag, self.drag, self.noise, self.wind = lag, drag, noise, wind
        self.x = self.v = self.a = self.t = self.boot = 0.0
        self.error = np.zeros(2)
        self.check = VehicleCheck()

    def step(self, wanted, report=lambda x, v, rng: (x, v)):
        self.a += (wanted - self.a) * DT / self.lag
        self.v += (self.a - self.drag * self.v + self.wind) * DT
        self.x += self.v * DT
        self.t += DT
        keep = math.exp(-DT)  # noise that forgets within a second
        fresh = math.sqrt(1.0 - keep**2) * np.array(self.noise)
        self.error = keep * self.error + fresh * self.rng.standard_normal(2)
        grain = 1e-4 * self.rng.standard_normal(2)
        x, v = report(
            self.x + self.error[0] + grain[0], self.v + self.error[1] + grain[1], self.rng
        )
        self.check.see(self.t, self.t + self.boot, np.array([x, 0.0, 5.0]), np.array([v, 0.0, 0.0]))
        self.check.ask(self.t, (wanted,), (v,))
        return self.check.impossible()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("how", [
    {}, {"drag": 1.2, "noise": (0.08, 0.12)}, {"lag": 0.1, "wind": 0.7}, {"lag": 0.4, "wind": -0.7},
])  # fmt: skip
def test_what_is_so_is_believed(how, seed):
    """Two minutes of accelerations held for any time, within ±5 m/s."""
    truth = Truth(seed, **how)
    wanted, left = 0.0, 0.0
    while truth.t < 120.0:
        left -= DT
        if left <= 0.0:
            left = truth.rng.exponential(0.5)
            wanted = truth.rng.choice([-3.0, 0.0, 3.0])
        if abs(truth.v) > 4.0:
            wanted = -3.0 * np.sign(truth.v)
        assert truth.step(wanted) == ""


@pytest.mark.parametrize("jump", [2.0, 100.0])
def test_a_position_that_jumps_is_found_at_once(jump):
    truth = Truth()
    for _ in range(100):
        assert truth.step(0.0) == ""
    assert "from where its velocity leads" in truth.step(0.0, lambda x, v, _: (x + jump, v))


@pytest.mark.parametrize("gap", [1.5, 5.0])
def test_also_over_a_gap(gap):
    for jump, found in ((2.0, False), (100.0, True)):
        truth = Truth()
        for _ in range(50):
            truth.step(0.0)
        truth.t += gap
        assert bool(truth.step(0.0, lambda x, v, _, jump=jump: (x + jump, v))) is found


def when_found(truth, wanted, report, limit=3.0):
    begun = truth.t
    while not (why := truth.step(wanted, report)):
        assert truth.t - begun < limit
    return truth.t - begun, why


@pytest.mark.parametrize("wanted", [0.0, 3.0])
def test_a_frozen_position_is_found_within_half_a_second(wanted):
    truth = Truth()
    for _ in range(50):
        truth.step(wanted)
    held = truth.x, truth.v
    took, why = when_found(truth, wanted, lambda *_: held)
    assert took < 0.5
    assert "by a bit" in why or "from where" in why


def test_a_position_that_stays_while_its_velocity_goes_on_is_found():
    truth = Truth()
    for _ in range(40):
        truth.step(3.0)
    x, v = truth.x, truth.v
    took, why = when_found(
        truth, 0.0, lambda *_: (x + 1e-3 * truth.rng.standard_normal(), v), limit=2.0
    )
    assert "from where" in why
    assert took < 1.4 / v


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("report", [
    lambda x, v, rng: tuple(1e-2 * rng.standard_normal(2)),  # stands, with noise
    lambda x, v, rng: (-x, -v),  # moves against what was asked for
])  # fmt: skip
def test_who_does_not_do_what_is_asked_is_found(report, side):
    took, why = when_found(Truth(), 3.0 * side, report)
    assert took < 1.0
    assert "asked to accelerate" in why


@pytest.mark.parametrize("boot", [-0.5, 5.0, 100.0])
def test_another_clock_is_no_way_to_another_place(boot):
    truth = Truth()
    for _ in range(50):
        truth.step(0.0)
    truth.boot += boot
    assert truth.step(0.0) == ""
    truth.boot += boot
    assert "from where" in truth.step(0.0, lambda x, v, _: (x + 60.0, v))
    for _ in range(200):  # and staying there does not make it right
        assert "from where" in truth.step(0.0, lambda x, v, _: (x + 60.0, v))
    truth.check.forget()
    assert truth.step(0.0) == ""


def pendulum(angle, cable=1.0, step=0.05):
    """Where a load is that swings from an angle (T Eq. 18, at rest), by small steps."""
    rate, n = 0.0, 50
    while True:
        yield np.array([cable * math.sin(angle), 0.0, -cable * math.cos(angle)])
        for _ in range(n):
            rate -= G / cable * math.sin(angle) * step / n
            angle += rate * step / n


@pytest.mark.parametrize("cable", [0.5, 1.0, 4.0])
@pytest.mark.parametrize("step", [0.02, 0.1, 0.3])
def test_a_load_that_swings_is_believed(cable, step):
    rng, check = np.random.default_rng(0), LoadCheck(cable)
    for k, offset in zip(range(400), pendulum(1.5, cable, step), strict=False):
        assert check.see(k * step, offset + 0.02 * rng.standard_normal(3)) == ""


@pytest.mark.parametrize(
    ("offset", "word"),
    [
        ((37.0, 0.0, -1.0), "37.0 m from the vehicle"),  # another drone
        ((0.0, 0.0, -4.0), "4.0 m from the vehicle"),  # it fell
        ((0.1, 0.0, 1.0), "1.0 m above"),  # floats: a simulator does that
        ((0.0, 0.0, 0.0), "0.00 m from"),  # the vehicle itself
        ((0.9, 0.0, -0.5), "jumped by 1.0 m in 0.02 s"),
    ],
)
def test_a_load_that_is_none_is_not_believed(offset, word):
    check = LoadCheck(1.0)
    assert check.see(1.0, np.array([0.0, 0.0, -1.0])) == ""
    assert word in check.see(1.02, np.array(offset))


# ------------------------------------------------------------ in flight


def tampered(f, kind, system, change):
    """From now on what the bridge hears of somebody is another thing; or nothing, for a False."""
    take = f.telemetry.take

    def lie(message, now):
        whose = message.get_type() == kind and message.get_srcSystem() == system
        return not (whose and change(message) is False) and take(message, now)

    f.telemetry.take = lie


def jumped(message):
    message.y += 100.0


def frozen():
    first = []

    def change(message):
        names = ("x", "y", "z", "vx", "vy", "vz")
        first[:] = first or [[getattr(message, name) for name in names]]
        for name, value in zip(names, first[0], strict=True):
            setattr(message, name, value)

    return change


def backwards(message):
    message.y, message.vy = -message.y, -message.vy


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
@pytest.mark.parametrize(("change", "soon"), [
    (lambda: jumped, 0.5), (frozen, 0.5), (lambda: backwards, 0.5)
])  # fmt: skip
def test_an_impossible_vehicle_is_landed_inside_and_said(tmp_path, like, change, soon):
    with Flying(tmp_path, like) as f:
        f.in_episode(step=6)
        tampered(f, "LOCAL_POSITION_NED", 1, change())
        begun = f.clock.now()
        f.until(lambda: f.flight.phase is Phase.LANDING)
        assert f.heard("land: what the autopilot says cannot be:")
        assert f.clock.now() - begun <= soon
        reached = []
        while f.flight.phase is not Phase.DOWN:
            reached.append(f.body()[0][0])
            f.wait(0.1)
        assert f.limits.box[0] < min(reached)
        assert max(reached) < f.limits.box[1]
        assert not f.broken


def elsewhere(message):
    jumped(message)
    message.time_boot_ms += 100_000


def in_turn():
    """Another vehicle of the same number, behind the same address."""
    turns = itertools.cycle((lambda message: None, elsewhere))
    return lambda message: next(turns)(message)


def lands_inside(f):
    f.until(lambda: f.flight.phase is Phase.LANDING, 10.0)
    assert f.heard("m from where its velocity leads")
    while f.flight.phase is not Phase.DOWN:
        assert f.limits.box[0] < f.body()[0][0] < f.limits.box[1]
        f.wait(0.1)


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
@pytest.mark.parametrize("change", [lambda: elsewhere, in_turn])
def test_another_clock_does_not_make_another_place_possible(tmp_path, like, change):
    with Flying(tmp_path, like) as f:
        f.in_episode(step=6)
        tampered(f, "LOCAL_POSITION_NED", 1, change())
        lands_inside(f)
        assert sum("restarted" in text for _, _, text in f.said) <= 2


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_a_jump_is_found_as_it_rises(tmp_path, like):
    with Flying(tmp_path, like) as f:
        f.until(lambda: f.flight.phase is Phase.TAKEOFF and f.body()[0][2] > 1.5)
        tampered(f, "LOCAL_POSITION_NED", 1, jumped)
        lands_inside(f)


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_a_jump_is_found_that_came_while_somebody_else_commanded(tmp_path, like):
    with Flying(tmp_path, like) as f:
        f.in_episode()
        f.link.ask_mode(f.profile, {"px4": (4 << 16) | (3 << 24), "ardupilot": 17}[like])
        f.until(lambda: f.flight.ruling.authority is Authority.OTHER)
        tampered(f, "LOCAL_POSITION_NED", 1, jumped)
        f.wait(2.0)
        assert f.flight.ruling.authority is Authority.OTHER
        f.link.ask_mode(f.profile, f.profile.controlled)
        lands_inside(f)


def aside(metres):
    def change(message):
        message.lon += round(metres / 0.0075)  # about, at this latitude

    return change


def test_another_drone_is_not_flown_with_as_the_load(tmp_path):
    with Flying(tmp_path, "px4") as f:
        f.flight.land(f.clock.now(), "on the ground still")
        f.until(lambda: not f.telemetry.armed)
        f.flight.check()
        tampered(f, "GLOBAL_POSITION_INT", 2, aside(37.0))
        f.wait(0.5)
        with pytest.raises(InputError, match=r"system 2 is 3\d\.\d m from the vehicle"):
            f.flight.check()


def above(message):
    message.alt += 2000
    message.relative_alt += 2000


@pytest.mark.parametrize("change", [aside(37.0), above])
def test_an_impossible_load_is_not_flown(tmp_path, change):
    with Flying(tmp_path, "px4") as f:
        f.in_episode(step=6)
        tampered(f, "GLOBAL_POSITION_INT", 2, change)
        begun = f.clock.now()
        f.until(lambda: f.flight.ruling.authority is Authority.HOLD)
        assert f.heard("hold: what is heard of cannot be the load: it is")
        assert f.clock.now() - begun <= 0.5
        for _ in range(50):
            f.wait(0.1)
            assert f.inside()
            assert f.flight.phase is not Phase.EPISODE


def lower(message):
    message.alt -= 600
    message.relative_alt -= 600


def late():
    before = []

    def change(message):
        before.append((message.time_boot_ms, message.lat, message.lon, message.relative_alt))
        while len(before) > 1 and before[1][0] <= message.time_boot_ms - 300:
            before.pop(0)
        _, message.lat, message.lon, height = before[0]
        message.alt += height - message.relative_alt
        message.relative_alt = height

    return change


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
@pytest.mark.parametrize(("change", "always"), [
    (lambda: lower, True), (late, True), (lambda: aside(37.0), False)
])  # fmt: skip
def test_a_fall_is_seen_by_what_falls(tmp_path, like, change, always):
    """Of a gripper that says yes and stays shut nothing falls, wherever the feed has the load."""
    with Flying(tmp_path, like) as f:
        f.in_air()
        f.change("SIM_GRIP_FAIL", 2)
        harm = change()
        tampered(
            f, "GLOBAL_POSITION_INT", 2,
            lambda m: harm(m) if always or f.flight.phase is Phase.RELEASE else None,
        )  # fmt: skip
        f.until(lambda: f.flight.phase in (Phase.RELOAD, Phase.DOWN) or f.flight.abandoned > 0)
        assert not f.ends
        assert Seen.FALL not in f.flight.status()["releases"]


def test_an_output_that_is_first_heard_afterwards_has_not_moved(tmp_path):
    released = []
    with Flying(tmp_path, "px4", autopilot={"SIM_LOAD_RATE": 0.0}, load_source="estimate",
                test_release=False) as f:  # fmt: skip
        tampered(f, "SERVO_OUTPUT_RAW", 1, lambda message: None if released else False)
        f.in_air()
        f.change("SIM_GRIP_FAIL", 2)
        f.until(lambda: f.flight.phase is Phase.RELEASE)
        released.append(True)
        f.until(lambda: f.flight.abandoned > 0)
        assert f.heard("not seen to move")
        assert not f.ends


@pytest.mark.parametrize(("gap", "doubted"), [(0.02, True), (0.25, False)])
def test_a_vehicle_is_not_doubted_for_what_we_did_not_say(gap, doubted):
    """Who stood still for a moment has heard as little as it has said: it looks anew."""
    check, now = VehicleCheck(), 0.0
    for k in range(60):
        now += gap if k == 50 else 0.02
        check.ask(now, (3.0,), (0.0,))
    assert bool(check.impossible()) is doubted
