import math

import numpy as np
import pytest

from sim_nodes import pictures
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import DUNK, MISS, RELEASE, SlungLoad
from sim_nodes.tasks.slung_load.dynamics import falling

LOAD, SHAFT = SlungLoad(), Pendulum()


def shapes(task, state):
    return {shape.name: shape for shape in pictures.picture(task, np.array(state))}


def centre(shape):
    return np.array(shape.points[0])


def test_the_load_hangs_below_and_swings_to_the_right():
    hanging = shapes(LOAD, [-3.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(centre(hanging["quadrotor"]), [-3.0, 0.0, 0.0])
    np.testing.assert_allclose(centre(hanging["load"]), [-3.0, 0.0, -1.0])
    level = shapes(LOAD, [-3.0, 0.0, math.pi / 2, 0.0])
    np.testing.assert_allclose(centre(level["load"]), [-2.0, 0.0, 0.0], atol=1e-12)
    ends = np.array(level["cable"].points)
    np.testing.assert_allclose(ends, [centre(level["quadrotor"]), centre(level["load"])])


def test_basket_and_walls_stand_where_the_task_says():
    seen = shapes(LOAD, np.zeros(4))
    sides = [seen["basket, left"], seen["basket, right"]]
    assert [side.points[0][0] for side in sides] == [-1.5, 1.5]  # T Table 2
    for side in sides:
        assert side.points[0][2] + side.size[2] / 2 == pytest.approx(-0.9)
    assert [seen[f"{side} wall"].points[0][0] for side in ("left", "right")] == [-6.5, 3.0]


def test_the_bob_stands_upright_at_zero_and_keeps_its_distance():
    np.testing.assert_allclose(centre(shapes(SHAFT, [0.0, 0.0])["bob"]), [0.0, 0.0, 0.042])
    for angle in np.linspace(-np.pi, np.pi, 9):
        bob = centre(shapes(SHAFT, [angle, 0.0])["bob"])
        assert np.linalg.norm(bob) == pytest.approx(0.042)
        assert math.atan2(bob[0], bob[2]) % math.tau == pytest.approx(angle % math.tau)


@pytest.mark.parametrize("task", [LOAD, SHAFT])
def test_a_picture_always_has_the_same_shapes(task):
    states = np.random.default_rng(0).uniform(
        task.description.low, task.description.high, (50, task.description.n_dims)
    )
    kinds = {tuple((s.name, s.kind, s.size) for s in pictures.picture(task, x)) for x in states}
    assert len(kinds) == 1
    names = [name for name, _, _ in kinds.pop()]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("state", "reward"), [([-1.0, 0.5, 1.0, -1.0], DUNK), ([-4.0, 1.0, 0.6, 2.0], MISS)]
)
def test_what_is_dropped_falls_and_a_dunk_lies_in_the_basket(state, reward):
    state = np.array(state)
    before = state - np.array([0.1, 0.0, 0.0, 0.0])
    after, given, _ = LOAD.step(state, RELEASE)
    assert given == reward
    frames = pictures.film(LOAD, [before, state, after], reward)
    assert len({len(frame) for frame in frames}) == 1
    way = np.array([next(centre(s) for s in frame if s.name == "load") for frame in frames])
    assert (way[1:, 2] <= max(way[1, 2], way[2, 2])).all()
    floor = next(s for s in frames[0] if s.name == "basket, floor")
    if reward == DUNK:
        assert abs(way[-1, 0]) < 1.5
        assert way[-1, 2] - 0.12 == pytest.approx(floor.points[0][2] + floor.size[2] / 2)
    else:
        assert way[-1, 2] < -1.5
    trail = pictures.trail(LOAD, np.array([before, state, after]), reward)
    np.testing.assert_allclose(trail[:2], way[:2, [0, 2]])


def test_a_crash_is_shown_state_by_state_and_a_pendulum_has_no_trail():
    states = np.array([[-6.4, -2.0, 0.0, 0.0], [-6.6, -2.0, 0.0, 0.0]])
    assert len(pictures.film(LOAD, states, -150.0)) == 2
    assert pictures.trail(SHAFT, np.zeros((3, 2)), -1.0) is None
    assert len(pictures.released(SHAFT, np.zeros(2), -10.0, np.zeros(3))) == 0


@pytest.mark.parametrize("time", [0.0, 0.1, 0.37])
def test_a_fall_is_a_parabola_and_lands_where_it_crosses_the_rim(time):
    state = np.array([-2.0, 1.0, 0.7, 2.0])
    start, now, later = falling(state, np.array([0.0, time, time + 1e-5]))
    speed = np.array([1.0 + math.cos(0.7) * 2.0, math.sin(0.7) * 2.0])
    np.testing.assert_allclose(now, start + speed * time - [0.0, 9.81 / 2 * time**2])
    np.testing.assert_allclose((later - now) / 1e-5, speed - [0.0, 9.81 * time], atol=1e-3)
    times = np.linspace(0.0, 2.0, 20_001)
    x, z = falling(state, times).T
    assert LOAD.landing(state) == pytest.approx(x[np.flatnonzero(z > -0.9)[-1]], abs=1e-3)
    assert LOAD.landing(np.array([0.0, 0.0, 0.1, 0.0])) is None
