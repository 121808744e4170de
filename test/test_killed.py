"""A bridge that is killed at any moment of an episode leaves the vehicle inside the walls."""

import copy
import copyreg
import struct

import numpy as np
import pytest
from motions import moving

from iolspi_ros.bench.flying import Flying
from iolspi_ros.bench.reckless import reckless
from msg_bridge.mavlink.envelope import Limits, limit
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import ARDUPILOT, PX4
from sim_nodes.autopilot.autopilot import TICK

copyreg.pickle(struct.Struct, lambda s: (struct.Struct, (s.format,)))  # of pymavlink's parsers
REST = 12.0  # after so long everything stands [s]


def alone(f):
    """The least and the greatest x of the vehicle from now on, if nobody sends any more."""
    autopilot = copy.deepcopy(f.autopilot)
    east = []
    for _ in range(round(REST / (10 * TICK))):
        autopilot.advance(10 * TICK)
        east.append(float(autopilot.body.truth[0][1]))
        for link in autopilot.links:
            link.out.clear()
    assert not autopilot.body.broken
    assert abs(autopilot.body.truth[1][1]) < 0.6
    return min(east), max(east)


def kills(tmp_path, like, seed, n, act=None):
    """Moments of episodes at which the bridge dies, and how far the vehicle then goes."""
    rng = np.random.default_rng([seed, 17])
    found = []
    with Flying(tmp_path, like, act or reckless(rng), seed=seed) as f:
        while len(found) < n:
            f.until(lambda: f.flight.phase is Phase.EPISODE)
            f.wait(float(rng.uniform(0.05, 2.0)))
            if f.flight.phase in (Phase.EPISODE, Phase.RELEASE, Phase.BRAKE):
                x, speed = f.body()[0][0], f.body()[1][0]
                found.append((x, speed, *alone(f)))
    return np.array(found)


def inside(found):
    low, high = Limits().box
    assert found[:, 2].min() > low, found[np.argmin(found[:, 2])]
    assert found[:, 3].max() < high, found[np.argmax(found[:, 3])]


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_killed_at_any_moment(tmp_path, like):
    inside(kills(tmp_path, like, 0, 12))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_killed_at_many_moments(tmp_path, like, seed):
    found = kills(tmp_path, like, seed, 40)
    inside(found)
    fast = {"px4": 1.2, "ardupilot": 1.5}[like]  # PX4's own was killed at up to 1.3
    assert np.abs(found[:, 1]).max() > fast


# From real simulators: speed at the last setpoint [m/s], its acceleration [m/s²], way to rest [m].
MEASURED = {
    "ardupilot": (ARDUPILOT, [(2.4, 3.0, 7.65), (2.5, 0.0, 2.96)]),
    "px4": (PX4, [(1.2, 3.0, 2.9), (2.4, 3.0, 4.51), (1.75, 0.0, 2.36)]),
}


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("name", MEASURED)
def test_room_is_left_for_the_way_that_was_measured(name, side):
    """Where the real one would not come to rest inside, that acceleration is not allowed."""
    profile, flights = MEASURED[name]
    limits = Limits(box=(-20.0, 20.0), jerk=1e4, held=profile.held, leaning=profile.leaning,
                    braking=profile.stopping)  # fmt: skip
    for speed, acceleration, way in flights:
        for room in np.linspace(0.1, way - 0.05, 20):  # between the vehicle and the wall
            motion = moving(x=side * (20.0 - room), speed=side * speed)
            allowed = limit(limits, side * acceleration, motion, 0.0, 0.02)
            assert side * allowed.acceleration < acceleration - 0.01
