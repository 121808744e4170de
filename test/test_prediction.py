"""How likely a load that is let go is told to fall inside."""

import math

import numpy as np
import pytest
from motions import moving

from iolspi_ros.bench.flying import Flying
from msg_bridge.mavlink.flown import flown
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.prediction import chance
from msg_bridge.mavlink.settings import FlightSettings
from sim_nodes.quadrotor.airframe import UTILITY
from sim_nodes.quadrotor.body import LOAD, LOAD_VELOCITY, POSITION
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

PLANE = flown(SlungLoad(), FlightSettings())
SPACE = flown(SlungLoad3D(), FlightSettings())
KNOWN = np.zeros((6, 6))


def inside(place, deviation):
    """Share of a normal distribution within 1.5 m of zero."""
    high, low = ((side * 1.5 - place) / (math.sqrt(2.0) * deviation) for side in (1.0, -1.0))
    return 0.5 * (math.erf(high) - math.erf(low))


def falling_time(angle):
    """Of a load that hangs still at an angle, to 0.9 m below the vehicle [s]."""
    return math.sqrt(2.0 * (0.9 - math.cos(angle)) / 9.81)


@pytest.mark.parametrize("x", [-2.8, -2.2, -1.9, 0.3, 0.8, 1.2])
def test_errors_of_position_and_speed_spread_where_it_lands(x):
    motion, time = moving(x=x, swing=0.7), falling_time(0.7)
    deviation = math.hypot(0.3, 0.4 * (time + 0.05))  # on the mean it opens after 0.05 s
    told = chance(PLANE, motion, KNOWN, (0.3, 0.4))
    assert told == pytest.approx(inside(x + math.sin(0.7), deviation), abs=0.04)


@pytest.mark.parametrize("x", [-2.6, -1.9, 0.3, 1.0])
def test_errors_of_the_swing_spread_where_it_lands(x):
    """Of a rate alone, against the parabola in closed form, drawn at random."""
    spread = np.zeros((6, 6))
    spread[3:, 3:] = 0.8**2 * np.eye(3)
    motion, rng = moving(x=x, swing=0.7), np.random.default_rng(0)
    rates, late = 0.8 * rng.standard_normal(20_000), rng.uniform(0.0, 0.1, 20_000)
    angle = 0.7 + late * rates
    down = np.sin(angle) * rates
    above = np.maximum(0.9 - np.cos(angle), 0.0)
    time = (np.sqrt(down**2 + 2.0 * 9.81 * above) + down) / 9.81
    place = x + np.sin(angle) + np.cos(angle) * rates * time
    true = np.mean((np.abs(place) <= 1.5) & (np.cos(angle) <= 0.9))
    assert chance(PLANE, motion, spread, (0.0, 0.0)) == pytest.approx(true, abs=0.05)


def test_what_is_known_for_sure_is_certain():
    for task, motion in ((PLANE, moving(swing=0.7)), (SPACE, moving(height=3.0))):
        assert chance(task, motion, KNOWN, (0.0, 0.0)) == 1.0
        far = motion._replace(x=4.0)
        assert chance(task, far, KNOWN, (0.0, 0.0)) == 0.0
        assert 0.0 < chance(task, far, KNOWN, (4.0, 0.0)) < 0.6


def test_a_gripper_that_opens_late_lets_a_fast_vehicle_miss():
    """It lands 0.05 m before the basket's edge, at 2 m/s: within the first 0.025 s it is in."""
    time = falling_time(0.7)
    motion = moving(x=1.45 - math.sin(0.7) - 2.0 * time, speed=2.0, swing=0.7)
    assert chance(PLANE, motion, KNOWN, (0.0, 0.0)) == pytest.approx(0.25, abs=0.02)


def kicked(tmp_path, share):
    """How far the swing is off at most, from a second after something pushed the load."""
    with Flying(
        tmp_path, "px4", lambda seen: 1 if seen.step < 25 else 3, initial="narrow",
        load_source="estimate", load_share=share, autopilot={"SIM_LOAD_MASS": 0.3}, seed=2,
    ) as f:  # fmt: skip
        f.until(lambda: f.flight.phase is Phase.EPISODE)
        craft = f.autopilot.body.craft
        craft[LOAD_VELOCITY] += (1.0, -1.0, 0.0)
        f.wait(1.0)
        off = []
        for _ in range(10):
            f.wait(0.1)
            cable = craft[LOAD] - craft[POSITION]
            off.append(np.linalg.norm(f.flight.motion.cable - cable / np.linalg.norm(cable)))
        f.episodes(1)
        assert f.heard("falls inside with a chance of")
        status = f.flight.status()
        assert status["chances"].endswith(" of 1")
        assert status["last chance"].endswith("%")
        return float(max(off))


def test_a_push_that_nobody_told_of_is_felt(tmp_path):
    """Where an accelerometer is listened to; else it is not noticed."""
    assert kicked(tmp_path, 0.3 / UTILITY.mass) < 0.2 < kicked(tmp_path, 0.0)
