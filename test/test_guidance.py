"""What is asked of the autopilot, for whoever commands."""

from types import SimpleNamespace

import numpy as np
import pytest
from motions import moved, moving

from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.envelope import Limits
from msg_bridge.mavlink.flown import flown
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
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

TASK = flown(SlungLoad(), FlightSettings())
DT = 0.02
LEFT, NEUTRAL, RIGHT = 0, 1, 2
HALL = Limits(box=(-5.0, 5.0, -5.0, 5.0), heights=(1.2, 5.8))


def guidance(profile=PX4, **settings):
    here = SimpleNamespace(place=lambda: (1.0, 0.5, 0.0))
    return Guidance(TASK, profile, FlightSettings(**settings), Limits(), here)


def asked(g, authority, phase=Phase.EPISODE, *, wanted=0.0, target=0.0, stick=0.0, **motion):
    return g.setpoint(
        authority, phase, moved(moving(height=5.0), **motion), wanted=(wanted,),
        target=(target, 0.0, 5.0), stick=(stick, 0.0), dt=DT,
    )  # fmt: skip


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


def both(g, authority, phase=Phase.EPISODE, *, wanted=(0.0, 0.0), stick=(0.0, 0.0), **motion):
    return g.setpoint(
        authority, phase, moved(moving(height=2.8), **motion), wanted=wanted,
        target=(1.0, -2.0, 3.0), stick=stick, dt=DT,
    )  # fmt: skip


def in_the_hall(**settings):
    task = flown(SlungLoad3D(), FlightSettings(height=2.8))
    return Guidance(task, PX4, FlightSettings(height=2.8, **settings), HALL, SimpleNamespace())


def test_along_two_axes_both_accelerations_are_flown_at_the_starts_height():
    g = in_the_hall()
    for _ in range(5):
        found = both(g, Authority.ACTOR, wanted=(3.0, -3.0))
    assert found == AccelerationSetpoint(3.0, -3.0, pytest.approx(0.16), 3.0)
    assert SlungLoad3D.description.actions[g.applied].value == (3.0, -3.0)
    for _ in range(5):
        found = both(g, Authority.NEUTRAL, wanted=(3.0, -3.0))
    assert found[:2] == (0.0, 0.0)
    assert g.applied == SlungLoad3D.description.neutral


def test_at_one_wall_the_other_axis_stays_as_it_was_asked_for():
    g = in_the_hall()
    for _ in range(10):
        found = both(g, Authority.ACTOR, wanted=(3.0, 3.0), across=4.4, drift=2.0)
    assert found[:2] == (3.0, -3.0)
    assert SlungLoad3D.description.actions[g.applied].value == (3.0, -3.0)


def test_in_transit_it_leads_to_the_start_along_both_and_rests_there():
    g = in_the_hall()
    for _ in range(10):
        found = both(g, Authority.BRIDGE, Phase.TRANSIT, x=-3.0, across=3.0)
    assert found.along > 0.5
    assert found.across < -0.5
    there = both(g, Authority.BRIDGE, Phase.TRANSIT, x=1.2, across=-1.8)
    assert there == PositionSetpoint(1.0, -2.0, 3.0)
    assert both(g, Authority.BRIDGE, Phase.TRANSIT, x=1.0, across=-0.7) != there  # off in y


def test_a_stick_flies_both_axes_slower_towards_a_wall():
    g = in_the_hall()
    assert both(g, Authority.PILOT, stick=(0.5, -1.0))[:2] == (1.0, -2.0)
    assert abs(both(g, Authority.PILOT, stick=(0.5, -1.0), across=-4.5).across) < 0.5


def test_velocities_are_summed_up_along_both():
    g = in_the_hall(setpoints="velocity")
    for _ in range(10):
        found = both(g, Authority.ACTOR, wanted=(3.0, -3.0))
    assert found.along == -found.across == pytest.approx((1.6 + 9 * 3.0) * DT)


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
            acceleration = law(moving(**{value: position, rate: velocity}))
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
