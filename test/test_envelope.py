import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from motions import moved, moving

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.envelope import Limits, limit, starts, stick_bounds, violation, widened
from msg_bridge.mavlink.motion import Creep

LIMITS = Limits(braking=2.0)
DT = 0.02


def fly(wanted, x, limits=LIMITS, lag=0.15, seconds=20.0):
    """Somebody's accelerations on a vehicle with a lag, and a load (T Eq. 18): motions."""
    speed = acceleration = before = angle = rate = 0.0
    for k in range(round(seconds / DT)):
        motion = moving(x=x, speed=speed, height=5.0, swing=angle, swing_rate=rate)
        yield motion, before
        before = limit(limits, wanted(k * DT, motion), motion, before, DT).acceleration
        acceleration += (before - acceleration) * DT / lag
        speed += acceleration * DT
        x += speed * DT
        rate -= (math.cos(angle) * acceleration + 9.81 * math.sin(angle)) / limits.cable * DT
        angle += rate * DT


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.sampled_from([-3.0, 0.0, 3.0]), min_size=200, max_size=200),
    st.sampled_from([0.1, 0.3, 0.6, 1.0, 1.4]), st.floats(-5.0, 2.0),
)  # fmt: skip
def test_whoever_acts_the_vehicle_stays_inside(actions, hold, x):
    for motion, acceleration in fly(lambda t, _: actions[int(t / hold) % 200], x):
        assert violation(LIMITS, motion) == ""
        assert LIMITS.box[0] <= motion.x <= LIMITS.box[1]
        assert abs(acceleration) <= LIMITS.acceleration


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_full_acceleration_to_one_side_ends_at_the_box_at_rest(direction):
    last = list(fly(lambda t, _: direction * 3.0, -2.0, seconds=30.0))[-1][0]
    end = LIMITS.box[1] if direction > 0.0 else LIMITS.box[0]
    assert 0.0 <= direction * (end - last.x) < 1.5
    assert abs(last.speed) < 0.1


def test_pumping_the_load_never_swings_it_beyond_its_angle():
    """Who accelerates against its motion adds most energy to it."""
    wide = Limits(box=(-1e4, 1e4), speed=50.0)
    angles = [
        m.swing
        for m, _ in fly(lambda t, m: -3.0 * np.sign(m.plane(0).swing_rate or 1.0), 0.0, wide)
    ]
    assert 0.5 * wide.swing < max(np.abs(angles)) < wide.swing


FAST = Limits(jerk=1e4, braking=2.0)


def flown(motion, wanted, limits=FAST):
    return limit(limits, wanted, motion, 0.0, DT)


@settings(max_examples=300, deadline=None)
@given(st.floats(-6.0, 2.7), st.floats(-5.0, 5.0), st.sampled_from([-3.0, 3.0]))
def test_after_the_response_braking_still_ends_in_the_box(x, speed, wanted):
    """By the bound's own definition: fly it for the response time, then brake."""
    limited = flown(moving(x=x, speed=speed), wanted)
    if limited.reasons != ("box",) or abs(limited.acceleration) > 2.999:
        return
    tau, side = FAST.response, math.copysign(1.0, wanted)
    later = speed + limited.acceleration * tau
    stopped = x + speed * tau + 0.5 * limited.acceleration * tau**2
    stopped += later * abs(later) / (2.0 * FAST.braking)
    end = FAST.box[1] - 0.3 if side > 0.0 else FAST.box[0] + 0.3
    if side * later >= 0.0:
        assert stopped == pytest.approx(end, abs=1e-6)
    else:  # turned round already: the bound is on the safe side
        assert side * stopped <= side * end + 1e-6


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("response", [0.2, 0.4])
def test_towards_the_wall_it_brakes_the_sooner_the_slower_it_responds(side, response):
    """At 1.4 m/s with 1 m of room: v τ + a τ²/2 + (v + a τ)²/(2 b) = 1."""
    limits = Limits(jerk=1e4, response=response, box=(-5.0, 5.0), braking=2.0)
    x, v, b = side * (5.0 - 0.3 - 1.0), 1.4, limits.braking
    a = flown(moving(x=x, speed=side * v), side * 3.0, limits).acceleration * side
    roots = np.roots([response**2 / (2 * b), 0.5 * response**2 + response * v / b,
                      response * v + v**2 / (2 * b) - 1.0])  # fmt: skip
    assert a == pytest.approx(max(roots), abs=1e-9)
    assert -3.0 < a < 3.0


@settings(max_examples=200, deadline=None)
@given(st.floats(-4.0, 2.7), st.floats(-3.0, 3.0), st.sampled_from([-3.0, 3.0]),
       st.floats(0.4, 1.0), st.floats(0.0, 1.0), st.floats(1.0, 5.0))  # fmt: skip
def test_held_then_braked_late_it_stands_before_the_wall(x, speed, wanted, held, late, braking):
    """By small steps: the acceleration is held, then nothing for a while, then it brakes."""
    limits = Limits(jerk=1e4, held=held, leaning=late, braking=braking)
    side = math.copysign(1.0, wanted)
    limited = flown(moving(x=x, speed=speed), wanted, limits)
    if side * limited.acceleration < -2.999:
        return  # too late already: as much as there is
    place, v, h = x, speed, 1e-3
    for k in range(20_000):
        t = k * h
        a = limited.acceleration if t < held else 0.0 if t < held + late else -side * braking
        if t >= held and side * v <= 0.0:
            break
        place += v * h + 0.5 * a * h**2
        v += a * h
    end = limits.box[1] - 0.3 if side > 0.0 else limits.box[0] + 0.3
    assert side * place <= side * end + 0.02


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("response", [0.2, 0.4])
def test_the_speed_after_the_response_is_the_limit(side, response):
    limits = Limits(jerk=1e4, response=response, speed=2.0, box=(-1e4, 1e4))
    limited = flown(moving(speed=side * 1.8), side * 3.0, limits)
    assert limited.reasons == ("speed",)
    assert side * 1.8 + limited.acceleration * response == pytest.approx(side * 2.0)


@pytest.mark.parametrize("rate", [-1.8, 1.8])
@pytest.mark.parametrize("response", [0.2, 0.4])
def test_the_energy_after_the_response_is_that_of_the_limit(rate, response):
    """Of the swing, linearly: the load's energy grows with -a ω cos θ / L."""
    limits = Limits(jerk=1e4, response=response, box=(-1e4, 1e4), cable=1.5)
    angle = 0.3
    limited = flown(moving(swing=angle, swing_rate=rate), -3.0 * np.sign(rate), limits)
    assert limited.reasons == ("swing",)
    pull = 9.81 / limits.cable
    energy = 0.5 * rate**2 + pull * (1.0 - math.cos(angle))
    gained = -limited.acceleration * rate * math.cos(angle) / limits.cable * response
    most = pull * (1.0 - math.cos(0.6 * limits.swing))
    assert energy + gained == pytest.approx(most)


def test_the_jerk_is_limited_from_the_setpoint_before():
    assert limit(LIMITS, 3.0, moving(x=-3.0), -1.0, DT) == (-1.0 + 80.0 * DT, ("jerk",))


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_counts_as_no_acceleration(wanted):
    limited = limit(LIMITS, wanted, moving(), 0.0, DT)
    assert limited == (0.0, ("not finite",))


def test_inside_nothing_is_changed():
    assert limit(LIMITS, 3.0, moving(x=-3.0), 2.5, DT) == (3.0, ())


@pytest.mark.parametrize(
    ("motion", "word"),
    [
        (moving(x=9.0, height=5.0), "x is"),
        (moving(across=-2.5, height=5.0), "distance from the track"),
        (moving(height=1.0), "height"),
        (moving(speed=-8.0, height=5.0), "speed"),
        (moving(tilt=0.9, height=5.0), "tilt"),
        (moving(swing=-1.5, height=5.0), "swing"),
        (moving(x=math.nan, height=5.0), "x is nan"),
    ],
)
def test_a_violation_is_named(motion, word):
    assert word in violation(LIMITS, motion)


@pytest.mark.parametrize(
    ("name", "edge", "outwards"),
    [
        ("x", 3.3, 1.0), ("x", -6.8, -1.0), ("across", 2.0, 1.0), ("across", -2.0, -1.0),
        ("height", 2.0, -1.0), ("height", 9.0, 1.0), ("speed", 6.9, 1.0), ("speed", -6.9, -1.0),
        ("tilt", 0.8, 1.0), ("swing", 1.45, 1.0), ("swing", -1.45, -1.0),
    ],
)  # fmt: skip
def test_where_the_envelope_ends(name, edge, outwards):
    inside = moving(height=5.0)
    assert not violation(LIMITS, moved(inside, **{name: edge - 0.01 * outwards}))
    assert violation(LIMITS, moved(inside, **{name: edge + 0.01 * outwards}))


@pytest.mark.parametrize(
    "box", [(3.0, -3.0), (-3.0, 3.0, 2.0, -2.0), (-3.0, 3.0, -3.0), (), (math.nan, 1.0)]
)
def test_a_box_has_its_least_ends_first(box):
    with pytest.raises(InputError, match=r"the least first|finite numbers"):
        Limits(box=box)


@pytest.mark.parametrize(
    ("noise", "speed_noise", "margin"),
    [(0.0, 0.0, 0.3), (0.05, 0.0, 0.45), (0.2, 0.0, 0.9), (0.0, 0.2, 0.9), (0.3, 0.4, 1.5),
     (0.12, 0.16, 0.9), (9.0, 0.0, 1.5)],
)  # fmt: skip
def test_the_margin_to_the_walls_grows_with_what_is_wrong(noise, speed_noise, margin):
    limits = widened(LIMITS, noise, speed_noise)
    assert limits.margin == pytest.approx(margin)
    low, high = starts(limits)
    for x in (low, high):  # who is at rest there is left alone
        assert limit(limits, 0.0, moving(x=x), 0.0, DT) == (0.0, ())
    assert low - limits.box[0] == pytest.approx(limits.box[1] - high)
    assert 0.0 < low - limits.box[0] - margin < 0.2


def test_a_margin_that_was_chosen_is_never_made_smaller():
    assert widened(Limits(margin=1.7), 0.2, 0.3).margin == 1.7


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_it_comes_to_rest_by_the_margin_further_from_the_wall(side):
    limits = Limits(braking=2.0, margin=0.9)
    last = list(fly(lambda t, _: side * 3.0, -2.0, limits, seconds=30.0))[-1][0]
    end = limits.box[1] if side > 0.0 else limits.box[0]
    assert 0.9 <= side * (end - last.x) + 0.05 < 2.1


@settings(max_examples=30, deadline=None)
@given(
    st.floats(-0.5, 0.5), st.lists(st.sampled_from([-3.0, 0.0, 3.0]), min_size=200, max_size=200),
    st.sampled_from([0.3, 1.0]), st.floats(1.0, 12.0),
)  # fmt: skip
def test_a_speed_that_is_wrong_takes_nobody_out_whoever_dies_and_when(wrong, actions, hold, end):
    """Then its own position hold goes by the wrong speed, too, with PX4's gain of 0.95 1/s."""
    limits = widened(replace(LIMITS, held=0.5, leaning=0.3), 0.0, abs(wrong) / 3.0)
    x, speed, acceleration, before, creep, stays = -1.75, 0.0, 0.0, 0.0, Creep(), None
    for _ in range(round(3.0 / DT)):
        creep.see(x, -wrong, DT)  # as the bridge does from its first setpoint on, long before
    for k in range(round((end + 15.0) / DT)):
        now, told = k * DT, speed - wrong
        behind = creep.see(x, told, DT)
        if now < end:
            seen, wanted = moving(x=x, speed=told, height=5.0), actions[int(now / hold) % 200]
            before = limit(limits, wanted, seen, before, DT, creep=behind).acceleration
        if now < end + limits.held + 0.5 * limits.leaning:  # its lag does the rest
            acceleration += (before * (now < end + limits.held) - acceleration) * DT / 0.15
        elif stays is None and abs(told) > 0.05:
            acceleration = -math.copysign(limits.braking, told)
        else:
            stays = x if stays is None else stays
            acceleration = 3.0 * (0.95 * (stays - x) - told)
        speed += acceleration * DT
        x += speed * DT
        # The bounds know no gain of 0.95, which is 5 % more than a metre for each m/s: a centimetre
        # (of 8,400 flights at random one is beyond, by 0.9 mm).
        assert limits.box[0] - 0.01 <= x <= limits.box[1] + 0.01


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_who_creeps_to_a_wall_without_telling_a_speed_is_held_up_before_the_margin(side):
    x, speed, before, creep = -1.75, side * 0.5, 0.0, Creep()
    for _ in range(2000):
        behind = creep.see(x, speed - side * 0.5, DT)
        seen = moving(x=x, speed=speed - side * 0.5, height=5.0)
        before = limit(LIMITS, 0.0, seen, before, DT, creep=behind).acceleration
        speed += before * DT
        x += speed * DT
        beyond = max(LIMITS.box[0] - x, x - LIMITS.box[1]) + LIMITS.margin
        assert beyond < 0.01


@pytest.mark.parametrize("creep", [-0.4, 0.0, 0.3])
def test_a_stick_is_slower_to_the_wall_that_is_crept_to_and_as_fast_from_it(creep):
    slow, fast = stick_bounds(LIMITS, moving(x=-1.0))
    expected = (slow + 0.4, fast) if creep < 0.0 else (slow, fast - creep)
    assert stick_bounds(LIMITS, moving(x=-1.0), 0, creep) == pytest.approx(expected)


@pytest.mark.parametrize("wrong", [-0.4, 0.0, 0.3])
def test_creeping_is_how_much_faster_a_position_changes_than_is_told(wrong):
    creep, found = Creep(), 0.0
    for k in range(500):
        t = k * DT
        found = creep.see(2.0 * math.sin(t) + wrong * t, 2.0 * math.cos(t), DT)
    assert found == pytest.approx(wrong, abs=0.05)
    assert creep.see(50.0, 0.0, DT) == 0.0  # a jump is none
    assert creep.see(50.1, 0.0, DT) == pytest.approx(0.1, abs=0.01)
    assert creep.see(7.0, 1.0, 60.0) == 0.0  # and after a silence it begins anew


# ------------------------------------------------------------ two axes

HALL = Limits(box=(-5.0, 5.0, -4.0, 4.0), heights=(1.2, 5.8), braking=2.0)


def fly_about(wanted, place, limits=HALL, lag=0.15, seconds=20.0):
    """Somebody's accelerations along both axes, with a load on a sphere: motions."""
    place, velocity, pushes = np.array(place), np.zeros(2), np.zeros(2)
    before, u, w = np.zeros(2), np.array([0.0, 0.0, -1.0]), np.zeros(3)
    for k in range(round(seconds / DT)):
        motion = moving(
            x=place[0], speed=velocity[0], across=place[1], drift=velocity[1], height=2.8,
            cable=tuple(u), cable_rate=tuple(w),
        )  # fmt: skip
        yield motion, before
        asked = wanted(k * DT, motion)
        before = np.array(
            [limit(limits, asked[i], motion, before[i], DT, i).acceleration for i in (0, 1)]
        )
        pushes += (before - pushes) * DT / lag
        velocity = velocity + pushes * DT
        place = place + velocity * DT
        pull = np.array([*pushes, 9.81])
        w = w + DT * ((pull @ u) * u - pull - (w @ w) * limits.cable * u) / limits.cable
        u = (u + w * DT) / np.linalg.norm(u + w * DT)
        w = w - (w @ u) * u


@settings(max_examples=20, deadline=None)
@given(
    st.lists(st.tuples(*[st.sampled_from([-3.0, 0.0, 3.0])] * 2), min_size=100, max_size=100),
    st.sampled_from([0.2, 0.4, 0.8, 1.4]), st.floats(-4.0, 4.0), st.floats(-3.0, 3.0),
)  # fmt: skip
def test_whoever_acts_along_both_the_vehicle_stays_in_the_box(actions, hold, x, y):
    for motion, push in fly_about(lambda t, _: actions[int(t / hold) % 100], (x, y)):
        assert violation(HALL, motion) == ""
        for place, (low, high) in zip(motion.place, HALL.sides, strict=False):
            assert low <= place <= high
        assert (np.abs(push) <= HALL.acceleration).all()


def test_pumping_along_both_never_swings_the_load_beyond_its_angle():
    wide = Limits(box=(-1e4, 1e4) * 2, speed=50.0)

    def against(t, m):
        return -3.0 * np.sign(np.array(m.cable_rate[:2]) + 1e-9)

    swings = [m.swing for m, _ in fly_about(against, (0.0, 0.0), wide)]
    assert 0.5 * wide.swing < max(swings) < wide.swing


def test_the_energy_after_the_response_is_that_of_the_limit_when_both_axes_push_at_theirs():
    limits = Limits(jerk=1e4, box=(-1e4, 1e4) * 2, cable=1.5)
    cable, rate = np.array([0.4, 0.3, -math.sqrt(0.75)]), np.array([0.96, 0.9, 0.0])
    rate[2] = -(cable[:2] @ rate[:2]) / cable[2]
    motion = moving(cable=tuple(cable), cable_rate=tuple(rate))
    found = [limit(limits, -3.0, motion, 0.0, DT, axis) for axis in (0, 1)]
    assert [limited.reasons for limited in found] == [("swing",)] * 2
    pushes = np.array([limited.acceleration for limited in found])
    energy = 0.5 * rate @ rate + 9.81 / limits.cable * (1.0 + cable[2])
    gained = -(pushes @ rate[:2]) / limits.cable * limits.response
    most = 9.81 / limits.cable * (1.0 - math.cos(0.6 * limits.swing))
    assert energy + gained == pytest.approx(most)


def test_each_axis_is_limited_by_its_own_side():
    near = moving(x=0.0, across=3.5, drift=2.0)
    assert limit(HALL, 3.0, near, 3.0, DT, 0).acceleration == pytest.approx(3.0)
    braked = limit(replace(HALL, jerk=1e4), 3.0, near, 3.0, DT, 1)
    assert braked.acceleration == -3.0
    assert "box" in braked.reasons
    assert starts(HALL, 1) == (pytest.approx(-3.6), pytest.approx(3.6))


@pytest.mark.parametrize(
    ("where", "word"),
    [({"across": 4.4}, "y is 4.40 m"), ({"drift": -7.0}, "speed in y"), ({"x": -5.4}, "x is"),
     ({"cable": (0.7, 0.71, -0.08)}, "swing is 1.49")],
)  # fmt: skip
def test_beyond_the_box_it_is_named_which_side(where, word):
    inside = moving(height=2.8)
    assert violation(HALL, inside) == ""
    assert violation(HALL, inside._replace(across=3.0)) == ""  # no corridor
    assert word in violation(HALL, inside._replace(**where))
