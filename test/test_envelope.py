import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.envelope import Limits, Motion, limit, violation

LIMITS = Limits()
DT = 0.02


def fly(wanted, x, limits=LIMITS, lag=0.15, seconds=20.0):
    """Somebody's accelerations on a vehicle with a lag, and a load (T Eq. 18): motions."""
    speed = acceleration = before = angle = rate = 0.0
    for k in range(round(seconds / DT)):
        motion = Motion(x=x, speed=speed, height=5.0, swing=angle, swing_rate=rate)
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
    st.floats(-5.0, 2.0),
)
def test_whoever_acts_the_vehicle_stays_inside(actions, x):
    for motion, acceleration in fly(lambda t, _: actions[int(t / 0.1) % 200], x):
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
    angles = [m.swing for m, _ in fly(lambda t, m: -3.0 * np.sign(m.swing_rate or 1.0), 0.0, wide)]
    assert 0.6 * wide.swing < max(np.abs(angles)) < wide.swing


@pytest.mark.parametrize("wanted", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_counts_as_no_acceleration(wanted):
    limited = limit(LIMITS, wanted, Motion(), 0.0, DT)
    assert limited == (0.0, ("not finite",))


def test_inside_nothing_is_changed():
    assert limit(LIMITS, 3.0, Motion(x=-3.0), 2.5, DT) == (3.0, ())


@pytest.mark.parametrize(
    ("motion", "word"),
    [
        (Motion(x=9.0, height=5.0), "x is"),
        (Motion(across=-2.5, height=5.0), "distance from the track"),
        (Motion(height=1.0), "height"),
        (Motion(speed=-8.0, height=5.0), "speed"),
        (Motion(tilt=0.9, height=5.0), "tilt"),
        (Motion(swing=-1.5, height=5.0), "swing"),
        (Motion(x=math.nan, height=5.0), "x is nan"),
    ],
)
def test_a_violation_is_named(motion, word):
    assert word in violation(LIMITS, motion)


def test_a_box_has_its_least_end_first():
    with pytest.raises(InputError, match="the least first"):
        Limits(box=(3.0, -3.0))
