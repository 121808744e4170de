"""What is asked of the autopilot, for whoever commands."""

from types import SimpleNamespace

import numpy as np
import pytest

from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.envelope import Limits, Motion
from msg_bridge.mavlink.guidance import Guidance
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import ARDUPILOT, PX4
from msg_bridge.mavlink.setpoints import (
    AccelerationSetpoint,
    PositionSetpoint,
    VelocitySetpoint,
)
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.transit import across, upwards
from sim_nodes.tasks.slung_load import SlungLoad

TASK = SlungLoad()
DT = 0.02
LEFT, NEUTRAL, RIGHT = 0, 1, 2


def guidance(profile=PX4, **settings):
    here = SimpleNamespace(place=lambda: (1.0, 0.5, 0.0))
    return Guidance(TASK, profile, FlightSettings(**settings), Limits(), here)


def asked(g, authority, phase=Phase.EPISODE, *, wanted=0.0, target=0.0, stick=0.0, **motion):
    now = Motion(height=5.0)._replace(**motion)
    return g.setpoint(authority, phase, now, wanted=wanted, target=target, stick=stick, dt=DT)


@pytest.mark.parametrize("authority", [Authority.NOBODY, Authority.LAND])
def test_nothing_is_asked_of_who_is_not_commanded(authority):
    assert asked(guidance(), authority) is None


def test_whoever_acts_is_flown_at_the_height():
    g = guidance()
    for _ in range(5):
        found = asked(g, Authority.ACTOR, wanted=3.0, x=-4.0)
    assert found == AccelerationSetpoint(3.0, 0.0, 0.0, 5.0)
    for _ in range(5):
        found = asked(g, Authority.NEUTRAL, wanted=3.0, x=-4.0)
    assert found.along == 0.0


def test_a_jerk_is_no_intervention_and_the_action_is_that_asked_for():
    g = guidance()
    found = asked(g, Authority.ACTOR, wanted=3.0, x=-4.0)
    assert found.along == pytest.approx(80.0 * DT)
    assert not g.interventions
    assert g.applied == RIGHT
    asked(g, Authority.ACTOR, wanted=-3.0, x=-4.0)
    assert g.applied == LEFT


def test_at_the_wall_the_action_in_force_is_another_one():
    g = guidance()
    for _ in range(10):
        found = asked(g, Authority.ACTOR, wanted=3.0, x=2.5, speed=2.0)
    assert found.along == -3.0
    assert g.applied == LEFT
    assert g.interventions["box"] == 10


def test_an_episode_begins_with_no_acceleration():
    g = guidance()
    for _ in range(10):
        asked(g, Authority.ACTOR, wanted=-3.0, x=-4.0)
    assert g.applied == LEFT
    g.rest()
    assert g.applied == NEUTRAL
    assert asked(g, Authority.ACTOR, wanted=3.0, x=-4.0).along == pytest.approx(80.0 * DT)


def test_it_brakes_then_stays_where_it_stopped():
    g = guidance()
    assert asked(g, Authority.HOLD, speed=2.0) == VelocitySetpoint(0.0, 0.0, 0.0)
    assert asked(g, Authority.HOLD, drift=-0.4) == VelocitySetpoint(0.0, 0.0, 0.0)
    there = PositionSetpoint(1.0, 0.2, 5.0)
    assert asked(g, Authority.HOLD, x=1.0, across=0.2, speed=0.2) == there
    assert asked(g, Authority.HOLD, x=1.3, speed=0.4) == there  # it is carried back
    g.begin()
    assert asked(g, Authority.HOLD, x=1.3) == PositionSetpoint(1.3, 0.0, 5.0)


@pytest.mark.parametrize("authority", [Authority.OTHER, Authority.PILOT])
def test_given_back_it_stays_where_it_was_brought(authority):
    for profile in (PX4, ARDUPILOT):
        g = guidance(profile)
        assert asked(g, Authority.HOLD, x=1.0) == PositionSetpoint(1.0, 0.0, 5.0)
        found = asked(g, authority, x=2.0)
        assert (found is None) is (authority is Authority.OTHER and profile is ARDUPILOT)
        asked(g, authority, x=-3.0)
        assert asked(g, Authority.HOLD, x=-3.0) == PositionSetpoint(-3.0, 0.0, 5.0)


def test_a_pilot_gives_the_speed_and_stays_on_track():
    found = asked(guidance(), Authority.PILOT, stick=-0.5, across=1.0, height=4.0)
    assert found == VelocitySetpoint(-1.0, pytest.approx(-0.8), pytest.approx(0.8))
    far = asked(guidance(), Authority.PILOT, stick=1.0, across=-9.0, height=9.0)
    assert far == VelocitySetpoint(2.0, 1.0, -1.0)


def test_who_climbs_by_setpoints_stands_first_and_then_climbs_straight_up():
    g = guidance(PX4)
    assert asked(g, Authority.BRIDGE, Phase.ARMING) == PositionSetpoint(1.0, 0.5, 0.0)
    assert asked(g, Authority.BRIDGE, Phase.TAKEOFF) == PositionSetpoint(1.0, 0.5, 5.0)
    assert asked(guidance(ARDUPILOT), Authority.BRIDGE, Phase.ARMING) is None
    g = guidance(PX4)
    g._estimator.place = lambda: (float("nan"),) * 3
    assert asked(g, Authority.BRIDGE, Phase.ARMING) is None


def test_velocities_are_the_sum_of_accelerations():
    g = guidance(setpoints="velocity")
    g.rest()
    for _ in range(10):
        found = asked(g, Authority.ACTOR, wanted=3.0, x=-4.0)
    assert isinstance(found, VelocitySetpoint)
    assert found.along == pytest.approx((1.6 + 9 * 3.0) * DT)


@pytest.mark.parametrize(
    ("law", "value", "rate", "most"),
    [
        (across, "across", "drift", 1.5),
        (lambda m: upwards(5.0, m), "height", "climb", 1.0),
    ],
)
def test_track_and_height_are_come_back_to_without_swinging(law, value, rate, most):
    goal = 5.0 if value == "height" else 0.0
    for start in (-3.0, 3.0):
        position, velocity, furthest = goal + start, 0.0, 0.0
        for _ in range(round(12.0 / DT)):
            acceleration = law(Motion()._replace(**{value: position, rate: velocity}))
            assert abs(acceleration) <= most
            velocity += acceleration * DT
            position += velocity * DT
            furthest = max(furthest, -np.sign(start) * (position - goal))
        assert position == pytest.approx(goal, abs=0.02)
        assert abs(velocity) < 0.02
        assert furthest < 0.5


def test_in_transit_it_is_no_faster_from_further_away():
    """The regulator sees no further than 2 m."""

    def at(target):
        return asked(guidance(), Authority.BRIDGE, Phase.TRANSIT, target=target, speed=-1.5).along

    assert at(-6.0) == at(-2.0) != at(-1.9)
