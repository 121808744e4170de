"""A graph that is harmed all the time goes on, keeps what it had, and figures say how it was."""

import numpy as np
import pytest

from iolspi_ros.bench import soak
from iolspi_ros.saving import checkpoint


@pytest.mark.slow
def test_a_harmed_graph_goes_on_with_what_it_had(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(soak, "FULL", 4.0)
    monkeypatch.setattr(soak, "SAVE_EVERY", 1.0)
    run = soak.fly(tmp_path, "pendulum", 4_500, 6, told.append, harmed=True, kill_every=4.0)
    assert run.steps >= 4_500
    assert run.kills.total() >= 1
    assert run.complaints == run.full >= 1
    assert told == sorted(told)
    assert np.isfinite(run.scores).all()
    logs = {name: (tmp_path / f"{name}.log").read_text() for name in ("learner", "simulator")}
    assert "Traceback" not in "".join(logs.values())
    begun = sum(logs["learner"].count(w) for w in ("resumed from", "no whole checkpoint"))
    assert 1 <= begun <= 1 + run.kills["learner"]  # one that was killed at once said neither
    assert checkpoint.read(tmp_path / "checkpoint.npz").about["parts"]["learner"]["step"] > 0


def test_a_slope_is_that_of_each_life_from_its_own_level():
    rng = np.random.default_rng(0)
    lives = []
    for level in (100.0, 250.0, 180.0):
        time = np.arange(0.0, 600.0) + rng.uniform(0, 1e4)
        start = np.where(time - time[0] < soak.SETTLED, -50.0, 0.0)  # does not count
        busy = np.where(rng.random(600) < 0.4, 0.05 * (time - time[0]), 0.0)  # for a moment
        memory = level + 36.0 * (time - time[0]) / 3600.0 + start + busy
        lives.append(np.column_stack([time, memory + 0.01 * rng.standard_normal(600)]))
    middle, width = soak.slope(lives, 1)
    assert abs(middle - 36.0) < 3 * width < 1.0
    assert soak.slope([life[:200] for life in lives], 1) is None


@pytest.mark.parametrize(("more", "holds"), [(20.0, True), (60.0, False)])
def test_where_others_are_killed_a_node_may_need_some_more_memory(more, holds):
    time = np.arange(0.0, 400.0)

    def run(levels):
        found = soak.Run(scores=[1.0] * 8, steps=1)
        for life, level in enumerate(levels):
            grows = np.minimum(time / 10.0, 15.0)  # at first
            rows = np.column_stack([time, level + grows, np.full(400, 9.0)])
            found.vitals["learner", life] = rows.tolist()
        return found

    rows = soak.rows(run([100.0]), run([100.0, 100.0 + more]))
    row = next(r for r in rows if r.name == "harmed: learner, the most that a life needs")
    assert row.value == 115.0 + more
    assert row.holds == holds


def test_what_never_changes_grows_by_nothing():
    life = np.column_stack([np.arange(0.0, 400.0), np.full(400, 24.0)])
    assert soak.slope([life, life + 3.0], 1) == (0.0, 0.0)


def test_a_return_is_that_of_an_episode_heard_whole_and_each_reward_counts_once():
    returns = soak.Returns()
    rows = (
        (0, 0, 0.0, False), (0, 1, -1.0, False), (0, 1, -1.0, False), (0, 2, -2.0, True),
        (0, 2, -2.0, True),  # -3; sent again, as a vehicle in lockstep does
        (1, 0, 0.0, False), (1, 2, -5.0, True),  # step 1 is missing
        (2, 0, 0.0, False), (2, 1, -7.0, False),
        (0, 0, 0.0, False), (0, 1, -4.0, True),  # the vehicle was killed, and counts anew
    )  # fmt: skip
    found = [returns.take(*row) for row in rows]
    assert [value for value in found if value is not None] == [-3.0, -4.0]


@pytest.mark.parametrize(
    ("level", "holds"), [(-100.0, True), (-101.0, True), (-110.0, False), (np.nan, False)]
)
def test_a_return_that_suffers_is_said(level, holds):
    clean = soak.Run(scores=[-100.0 + (-1) ** k for k in range(400)], steps=1)
    harmed = soak.Run(scores=[level + (-1) ** k for k in range(400)], steps=1)
    row = next(r for r in soak.rows(clean, harmed) if r.name.startswith("return lost"))
    assert row.holds == holds
    assert row.value == pytest.approx(-100.0 - level, nan_ok=True)
