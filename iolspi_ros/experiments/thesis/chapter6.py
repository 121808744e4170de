"""T chapter 6: what it plans and never did, the drop-off in three dimensions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.slung_load_3d import PILOT, SlungLoad3DRun, drop, with_learner
from iolspi_ros.experiments.slung_load_3d_planned import PlannerRun, plan_ahead
from iolspi_ros.experiments.statistics import Interval, interval, intervals
from iolspi_ros.experiments.thesis import chapter6_claims as says
from iolspi_ros.experiments.thesis import drawing
from iolspi_ros.experiments.thesis.study import Rows, Study

SMALL: Mapping[str, Any] = {"kernels": 250, "buffer_size": 4000}
"""Functions and samples, for many seeds; config/slung_load_3d.yaml has more."""
FORGET = 0.9997
"""η per step: after 100 episodes a sample counts half."""
GRID = [5, 3, 5, 3, 1, 1, 3, 3, 3, 3]
"""Centres of Q-learning's grid: 18,225 functions; the altitude is held, so it has one."""
CHANGES: Mapping[str, Mapping[str, Any]] = {
    "load three times as heavy": {"load": 0.18},
    "cable half as long": {"cable": 0.5},
}
_WIND: Mapping[str, Any] = {"wind": 4.0}
_SEEDS, _FEWER = 20, 5


def studies() -> list[Study]:
    """Every study of this chapter."""
    everything = (*_goals(), *_asked(), *_changing(), *_planned())
    title = "The drop-off in three dimensions"
    return [
        Study("section6-1", title, "6-1, 6-2", everything, table, claims=says.CLAIMS),
        Study(
            "fig6-1", f"{title}: dunks of the greedy policy", "6-1, 6-2",
            (*_goals(), *_asked()), curves,
            drawing.curves(title, "dunks [%]", x_label="episodes"),
        ),
    ]  # fmt: skip


def _goals() -> list[Cell]:
    """What the task was built for."""
    shown = SlungLoad3DRun(learner=SMALL, every=25)
    performed = replace(shown, pilot=replace(PILOT, mode="perform"))
    exploring = {"epsilon": 1.0, "epsilon_decay": 0.98}  # T 11-1, down to ε = 0.01 as well
    settings = {
        says.SHOWN: shown,
        says.NOTHING: with_learner(replace(shown, demonstrations=0), epsilon_min=0.01, **exploring),
        says.SHIELDED: with_learner(shown, shield=True),
        says.HELD: replace(shown, vehicle={**_WIND, "wind_held": True}),
        says.PERFORMED: performed,
        says.PERFORMED_SHIELDED: with_learner(performed, shield=True),
    }
    return [Cell(label, drop, setting, _SEEDS, 20.0) for label, setting in settings.items()]


def _asked() -> list[Cell]:
    """What T 6-1 asks, and what else makes a difference."""
    shown = SlungLoad3DRun(learner=SMALL, every=25)
    settings = {
        says.WINDY: replace(shown, vehicle=_WIND),
        says.ALONE: with_learner(shown, learner="iolspi"),
        says.FEW: replace(shown, demonstrations=10),
        says.Q_LEARNING: replace(shown, learner={"learner": "q_learning", "centers": GRID}),
    }
    return [Cell(label, drop, setting, _FEWER, 19.0) for label, setting in settings.items()]


def _changing() -> list[Cell]:
    """A vehicle that changes in the middle of a run."""
    run = SlungLoad3DRun(learner=SMALL, every=25, change=150)
    return [
        Cell(
            label, drop,
            with_learner(replace(run, changed=CHANGES[what]),
                         forget_factor=FORGET if forgets else 1.0),
            _FEWER, 18.0,
        )
        for (what, forgets), label in says.CHANGES.items()
    ]  # fmt: skip


def _planned() -> list[Cell]:
    """What could be had."""
    return [
        Cell(says.PLANNED, plan_ahead, PlannerRun(), 1, 80.0),
        Cell(says.PLANNED_IN_WIND, plan_ahead, PlannerRun({**_WIND, "wind_held": True}), 1, 80.0),
    ]


def table(data: Data) -> Rows:
    """A row for each number of each setting."""
    rows: Rows = []
    for label, cell in data.items():
        numbers = _planner(cell) if label.startswith("planner") else _learner(label, cell)
        for what, (mean, low, high) in numbers.items():
            rows.append({
                "setting": label, "what": what, "mean": mean, "low": low, "high": high,
                "n": len(cell["ending"]),
            })  # fmt: skip
    return rows


def _planner(cell: says.Cells) -> dict[str, Interval]:
    """Over its 100 starts."""
    ending = cell["ending"][0]
    return {
        "dunks [%]": says.percent(ending == says.DUNK),
        "crashes [%]": says.percent(ending >= says.FIRST_CRASH),
        "score": interval(cell["score"][0]),
        "discounted return": interval(cell["discounted"][0]),
    }


def _learner(label: str, cell: says.Cells) -> dict[str, Interval]:
    share, (episodes, crashed, reached) = says.dunks(cell), says.until(cell)
    found = {
        "dunks before the first episode [%]": interval(share[:, 0]),
        **{
            f"dunks after {count} episodes [%]": interval(share[:, look])
            for look, count in enumerate(cell["after"][0].tolist())
            if count and count % 100 == 0
        },
        "dunks at the end [%]": interval(says.at_the_end(share)),
        "least at the end [%]": interval(share[:, -says.LAST :].min(axis=1)),
        "dunks at the end, mean of four updates' values [%]": interval(
            100.0 * says.share(cell["averaged"][:, -1], says.DUNK)
        ),
        "crashes at the end [%]": interval(says.at_the_end(says.broken(cell))),
        "score at the end": interval(says.at_the_end(cell["judged_score"])),
        "discounted return at the end": interval(says.at_the_end(cell["discounted"])),
        "crashes while learning [%]": says.crashes(cell),
        "of the last 100 episodes [%]": says.crashes(cell, -100),
        f"episodes to {says.LEVEL:g} % dunks": interval(episodes),
        f"crashes to {says.LEVEL:g} % dunks": interval(crashed),
        f"reached {says.LEVEL:g} % dunks [%]": says.percent(reached),
    }  # fmt: skip
    if label in says.CHANGES.values():
        lost, back, came = says.recovered(cell)
        found |= {
            "points lost at the change": interval(lost),
            "episodes until within 5 points": interval(back),
            "came back [%]": says.percent(came),
        }
    return found


def curves(data: Data) -> Rows:
    """Dunks over episodes."""
    rows: Rows = []
    for label, cell in data.items():
        counts, n = cell["after"][0].tolist(), len(cell["after"])
        for count, mean, low, high in zip(counts, *intervals(says.dunks(cell)), strict=True):
            rows.append({
                "curve": label, "x": count, "mean": mean, "low": low, "high": high, "n": n,
            })  # fmt: skip
    return rows
