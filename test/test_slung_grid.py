import numpy as np
import pytest

from iolspi_ros.experiments import slung_grid_demonstrations
from iolspi_ros.methods.tabular import fly, greedy, initial, learn, optimal_values
from sim_nodes.tasks.slung_grid import SlungGrid

GRID = SlungGrid()
LEFT, NOTHING, RIGHT = range(3)


def by_the_thesis(state, action):
    """T Eqs. 5-1 to 5-6 in degrees, then the nearest entry of Table 5-5."""
    x, v, q, w = state
    new_v = np.clip(v + 0.2 * (action - 1) * 10.0, -5, 5)
    new_x = np.clip(x + 0.2 * new_v, -2, 8)
    pull = -np.cos(np.deg2rad(q)) * (new_v - v) / 0.2 - np.sin(np.deg2rad(q)) * 9.81
    new_w = np.clip(w + 0.2 * np.rad2deg(pull), -540, 540)
    new_q = np.clip(q + 0.2 * new_w, -110, 110)
    return [np.round(new_x * 2) / 2, np.round(new_v), np.round(new_q / 10) * 10,
            np.round(new_w / 20) * 20]  # fmt: skip


def test_a_table_holds_every_step():
    rng = np.random.default_rng(0)
    assert GRID.task.successor.size == 876_645  # T 5-4-1
    numbers, actions = rng.integers(GRID.size, size=3000), rng.integers(3, size=3000)
    followers = GRID.states(GRID.task.successor[numbers, actions].astype(int))
    for state, action, following in zip(GRID.states(numbers), actions, followers, strict=True):
        np.testing.assert_allclose(following, by_the_thesis(state, action), atol=1e-9)
    np.testing.assert_array_equal(GRID.numbers(GRID.states(numbers)), numbers)


def test_the_finer_grid_of_table_5_1_has_the_same_reachable_points():
    """Every half metre per second is an entry there; only whole ones are ever reached."""
    seen, fresh = {(0.0, 0.0, 0.0, 0.0)}, [(0.0, 0.0, 0.0, 0.0)]
    for _ in range(5):
        fresh = {tuple(by_the_thesis(s, a)) for s in fresh for a in range(3)} - seen
        seen |= fresh
    speeds = {v for _, v, _, _ in seen}
    assert speeds <= set(np.arange(-5.0, 6.0))
    assert len(speeds) > 6


@pytest.mark.parametrize(
    ("state", "inside"),
    [
        ((4.5, 0.0, 40.0, -20.0), True),
        ((4.5, 0.0, 40.0, 20.0), False),  # rising
        ((5.0, 0.0, -50.0, 20.0), True),
        ((5.0, 0.0, 60.0, -20.0), False),  # at the rim, not below it
        ((5.0, 0.0, 30.0, -20.0), False),  # too low
        ((6.0, 0.0, 40.0, -20.0), False),  # beside
    ],
)
def test_what_is_in_the_basket(state, inside):
    assert GRID.in_basket(np.array([state]))[0] == inside


def test_the_start_and_the_scattered_ones():
    assert GRID.states(np.array([GRID.start])).tolist() == [[0.0, 0.0, 0.0, 0.0]]
    spread = GRID.states(GRID.scattered())
    assert len(np.unique(spread, axis=0)) == 21 * 23
    assert not spread[:, [1, 3]].any()


def test_steep_angles_cost_each_time_and_missing_costs_50():
    still = fly(GRID.task, GRID.start, [NOTHING])
    assert (len(still.actions), still.score) == (25, -50.0)
    wild = fly(GRID.task, GRID.start, ([LEFT] * 4 + [RIGHT] * 4) * 3)
    angles = GRID.states(wild.states[1:])[:, 2]
    steep = np.count_nonzero(np.abs(angles) >= 90)
    assert steep > 0
    assert wild.score == pytest.approx(-50.0 - 10.0 * steep)


def test_the_best_flight_is_the_one_that_q_learning_of_the_thesis_found():
    """T Table 5-4: -1.96, in 1.4 s, the load to the left of the quadrotor; to the right -2.56."""
    best = optimal_values(GRID.task)[0, GRID.start]
    assert best == pytest.approx(-1.96)
    ways = [[a, b, c, d, e, f, g] for a in range(3) for b in range(3) for c in range(3)
            for d in range(3) for e in range(3) for f in range(3) for g in range(3)]  # fmt: skip
    flights = [fly(GRID.task, GRID.start, way) for way in ways]
    winners = [flight for flight in flights if flight.score > best - 1e-9]
    assert winners
    for flight in winners:
        assert len(flight.actions) == 7
        assert GRID.states(flight.states[-1:])[0, 2] < 0.0
    assert max(flight.score for flight in flights) == pytest.approx(best)


def test_q_learning_from_zeros_finds_it_too():
    found = learn(GRID.task, initial(GRID.task, 0.0), np.array([GRID.start]), 30_000,
                  epsilon=0.01, alpha=0.01, rng=np.random.default_rng(0))  # fmt: skip
    assert greedy(GRID.task, found.q, GRID.start).score == pytest.approx(-1.96)


@pytest.mark.parametrize("number", slung_grid_demonstrations.KINDS)
def test_demonstrations_are_of_their_kind(number):
    flights = slung_grid_demonstrations.demonstrate(GRID, number, 3)
    assert len(flights) == 5
    again = slung_grid_demonstrations.demonstrate(GRID, number, 3)
    assert [f.score for f in flights] == [f.score for f in again]
    for flight in flights:
        if number == 4:
            continue
        assert GRID.task.goal[flight.states[-1]]
        assert flight.score == pytest.approx(-((0.2 * len(flight.actions)) ** 2))
        assert flight.actions[0] == (LEFT if number == 3 else RIGHT)
