"""A task in one axis and one in two, as a flight knows them."""

import math

import numpy as np
import pytest
from motions import moving

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.envelope import Limits
from msg_bridge.mavlink.flown import OneAxis, TwoAxes, check_room, flown
from msg_bridge.mavlink.motion import Motion
from msg_bridge.mavlink.settings import FlightSettings
from sim_nodes.quadrotor.body import LOAD, LOAD_VELOCITY, POSITION, VELOCITY
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad
from sim_nodes.tasks.slung_load_3d import DUNK, MISS, SlungLoad3D

SETTINGS = FlightSettings()
HALL = Limits(box=(-5.0, 5.0, -5.0, 5.0), heights=(1.2, 5.8))
LOW = FlightSettings(height=2.8)


def truth(task):
    """What would be measured, without error, of the vehicle that a 3-D task flies."""
    state, length = task._episode.craft.state, task._episode.payload.length
    (x, y, z), (vx, vy, vz) = state[POSITION], state[VELOCITY]
    qw, qx, qy, qz = state[6:10]
    up = 2 * (qx * qz + qw * qy), 2 * (qy * qz - qw * qx), 1 - 2 * (qx * qx + qy * qy)
    cable = (state[LOAD] - state[POSITION]) / length
    rate = (state[LOAD_VELOCITY] - state[VELOCITY]) / length
    return Motion(x, vx, y, vy, z, vz, up, tuple(cable), tuple(rate))


@pytest.mark.parametrize("seed", range(4))
def test_what_is_flown_is_seen_and_judged_as_the_task_does_itself(seed):
    task = SlungLoad3D()
    known, rng = flown(task, LOW), np.random.default_rng(seed)
    seen, ended, steps = task.begin(seed), False, 0
    held = int(rng.integers(8))  # for so long that it comes to a wall or the cable up
    while not ended:
        assert known.state(truth(task)) == pytest.approx(seen, abs=1e-9)
        before = truth(task)
        seen, reward, ended, _ = task.advance(held if rng.random() < 0.9 else 4)
        assert known.judge(before, truth(task)) == (pytest.approx(reward, abs=1e-9), ended)
        steps += 1
    assert steps > 5


@pytest.mark.parametrize(("lean", "reward"), [(0.4, -50.0), (0.0, -0.5), (-0.4, -0.5)])
def test_a_cable_comes_into_rotors_that_lean_towards_it(lean, reward):
    """At 75° towards +y: who leans that way has the rotors' near side below the cable."""
    cable = 0.0, math.sin(1.3), -math.cos(1.3)
    after = moving(x=1.0, height=3.0, cable=cable, up=(0.0, math.sin(lean), math.cos(lean)))
    assert flown(SlungLoad3D(), LOW).judge(moving(x=1.0, height=3.0), after)[0] == reward


def test_a_drop_that_nobody_sees_is_judged_as_the_tasks_own():
    task = SlungLoad3D()
    known, found = flown(task, LOW), set()
    for seed in range(60):
        task.begin(seed)
        for _ in range(seed % 15):
            task.advance(seed % 9)
        before = truth(task)
        reward = task.advance(task.actions.release)[1]
        assert known.dropped(before) == reward
        found.add(reward)
    assert found == {DUNK, MISS}


def test_of_one_axis_the_same_is_true():
    task, rng = SlungLoad(), np.random.default_rng(1)
    known, found = flown(task, SETTINGS), set()
    for _ in range(300):
        x, speed, angle, rate = rng.uniform(task.description.low, task.description.high)
        motion = moving(x=x, speed=speed, swing=angle, swing_rate=rate)
        assert known.state(motion) == pytest.approx([x, speed, angle, rate])
        reward = task.step(known.state(motion), RELEASE)[1]
        assert known.dropped(motion) == reward
        found.add(reward)
    assert len(found) == 2


def test_the_swing_across_is_none_of_one_axis_and_a_variable_of_two():
    motion = moving(swing=0.3)._replace(cable=(0.0, math.sin(0.3), -math.cos(0.3)))
    assert flown(SlungLoad(), SETTINGS).state(motion)[2] == 0.0
    assert flown(SlungLoad3D(), LOW).state(motion)[[6, 8]] == pytest.approx([0.0, 0.3])


def test_a_load_is_judged_where_it_was_seen_to_cross_the_rim():
    one, two = flown(SlungLoad(), SETTINGS), flown(SlungLoad3D(basket=(1.0, -2.0, 1.4)), LOW)
    assert one.rim(moving(height=5.0)) == pytest.approx(4.1)
    assert two.rim(moving(height=5.0)) == 1.4
    for place, inside in [((1.0, -0.6), True), ((1.0, -0.4), False), ((-0.1, -3.1), False)]:
        assert two.landed(np.array(place)) == (DUNK if inside else MISS)
    assert one.landed(np.array([1.4, 9.0])) == DUNK
    assert one.landed(None) == two.landed(None) == MISS


@pytest.mark.parametrize(("task", "kind"), [(SlungLoad(), OneAxis), (SlungLoad3D(), TwoAxes)])
def test_starts_are_the_tasks_own(task, kind):
    known = flown(task, LOW)
    assert isinstance(known, kind)
    drawn = np.array([known.draw_start(np.random.default_rng(seed)) for seed in range(200)])
    swept = np.array([known.sweep(number) for number in range(200)])
    low, high = known.heights()
    for places in (drawn, swept):
        assert (places[:, 2] >= low).all()
        assert (places[:, 2] <= high).all()
    if kind is TwoAxes:
        assert swept[7] == pytest.approx(task.begin(7)[[0, 2, 4]])
        assert swept[107] == pytest.approx(swept[7])
        assert (np.ptp(drawn, axis=0) > [7.5, 7.5, 0.7]).all()
    else:
        assert not drawn[:, 1].any()
        assert np.unique(swept[:, 0]) == pytest.approx(np.linspace(-6.0, 0.0, 13))


@pytest.mark.parametrize(
    ("task", "settings", "limits", "why"),
    [
        (SlungLoad(), SETTINGS, HALL, "2 of the horizontal axes, and slung_load moves along 1"),
        (SlungLoad3D(), LOW, Limits(heights=(1.2, 5.8)), "allowed: 4 numbers"),
        (SlungLoad3D(), LOW, Limits(box=(-1, 1, -0.3, 0.3), heights=(1.2, 5.8)), "0.6 m in y"),
        (SlungLoad3D(), LOW, Limits(box=(-5, 5, 1, 5), heights=(1.2, 5.8)), "basket .* y = 0 m"),
        (SlungLoad(), SETTINGS, Limits(box=(-6.5, -1.0)), "basket .* x = 0 m"),
        (SlungLoad(), FlightSettings(height=1.0), Limits(), "height is 1 m; allowed: .* 2 to 9"),
        (SlungLoad3D(), FlightSettings(height=6.0), HALL, "height is 6 m; allowed: .* to 5.8"),
        (SlungLoad3D(), LOW, Limits(box=HALL.box, heights=(2.5, 5.0)), "start .* is 2.4 m"),
    ],
)
def test_a_task_that_does_not_fit_is_refused_in_words(task, settings, limits, why):
    with pytest.raises(InputError, match=why):
        check_room(flown(task, settings), settings, limits)


def test_actions_that_climb_are_refused():
    with pytest.raises(InputError, match="have 3 numbers each; allowed for a flight: 2"):
        flown(SlungLoad3D(vertical=True), LOW)
