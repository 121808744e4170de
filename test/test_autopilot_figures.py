"""The embedded autopilots fly as the table of the real ones' figures says, row by row."""

import functools
import math

import pytest

from iolspi_ros.bench import measuring
from iolspi_ros.bench.stand import Stand
from iolspi_ros.bench.worlds import Stepped
from sim_nodes.autopilot.figures import FIGURES, Figure
from sim_nodes.autopilot.firmware import FIRMWARES, WITH_GRIPPER

BARE = {"SIM_LOAD_MASS": 1e-3, "SIM_LOAD_RATE": 0.0, "SIM_WANDER": 1.0}
ROWS = [(like, name) for like, table in FIGURES.items() for name in table]


@pytest.fixture(scope="module")
def flown():
    """What was measured of each; it is flown when it is first asked for."""
    return functools.cache(_fly)


def _fly(like):
    world = Stepped(like, BARE | WITH_GRIPPER[like], ready_after=None)
    values = world.autopilot.parameters
    before = {name: values[name] for name in values.names}
    samples = measuring.measure(Stand(world.connect(), world.clock), lambda _: None)
    assert not world.autopilot.body.broken
    assert {name: values[name] for name in before} == before, "parameters were not given back"
    return samples


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("like", "name"), ROWS)
def test_row(flown, like, name):
    line = measuring.compare(flown(like), FIGURES[like])[list(FIGURES[like]).index(name)]
    assert line.name == name
    assert line.samples, "not measured"
    assert line.holds, line.cells()


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("like", FIGURES)
def test_nothing_comes_unasked_that_the_table_does_not_say(flown, like):
    rates = {name for name in flown(like) if name.startswith("unasked")}
    assert rates <= set(FIGURES[like])
    assert set(FIRMWARES[like].rates) >= {name.removeprefix("unasked ") for name in rates}


def test_a_difference_is_told():
    table = {
        "way": Figure(2.0, "m"),
        "drag": Figure(0.0, "1/s", allowance=0.1),
        "peak": Figure(1, ""),
    }
    lines = measuring.compare({"way": [2.5, 2.4, 9.0], "drag": [0.05], "new": [1.0]}, table)
    assert [line.holds for line in lines] == [False, True, None, None]
    assert math.isnan(lines[2].median)
    text = measuring.markdown(lines)
    assert "| way | 2.5 | 2.4 to 9 | 2 m ± 0.3 | DIFFERS |" in text
    assert "| new | 1 |  | - | not in the table |" in text
    assert "not measured" in text
