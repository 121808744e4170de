"""Learners side by side: the same vehicle, seeds and samples, judged at the same times."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iolspi_ros import resources
from iolspi_ros.core.learner import learner_class
from iolspi_ros.errors import InputError
from iolspi_ros.experiments import deep
from iolspi_ros.experiments.cells import Cell
from iolspi_ros.experiments.evaluate import has_reference
from iolspi_ros.experiments.headless import make_vehicle
from iolspi_ros.experiments.interventions import ALONE
from iolspi_ros.experiments.life import LOOKS, Life, Yardstick, best, learn
from iolspi_ros.experiments.samplesets import NOTHING, bag
from iolspi_ros.methods.traits import TRAITS
from iolspi_ros.settings import from_mapping
from sim_nodes.world import WorldSettings

SHOWN = "set 5"
ALONE_CASE, SHOWN_CASE, JUMP_CASE = "from nothing", f"from {SHOWN}", "after a jump of g"
CASES = (ALONE_CASE, SHOWN_CASE, JUMP_CASE)
G_AFTER = 19.81
"""T IV-A-4 [m/s²]."""
SECONDS = {"pendulum": 60.0, "cart_pole": 300.0, "slung_load": 400.0}
USUAL_SECONDS = 300.0
PACE = {"policy_search": 4, "fitted_q": 4, "apprentice": 4}
"""Learn again so many times more seldom than the task's file says: each time takes long."""
CRASHES = ("crash", "fall")
"""How the names of endings begin that break something."""
DEEP = "dqn"


class Case(NamedTuple):
    """One situation of one task, and who is in it.

    Attributes
    ----------
    task : TaskDescription
    name : str
        One of `CASES`.
    cells : dict of str to Cell
        By learner; None in place of those that cannot be in it.
    best : Cell, optional
        Of the near-optimal policy.
    jump : float
        When g jumps [s]; 0 for never.
    """

    task: Any
    name: str
    cells: dict[str, Cell | None]
    best: Cell | None
    jump: float

    @property
    def all_cells(self) -> list[Cell]:
        """Everything to compute."""
        return [cell for cell in (self.best, *self.cells.values()) if cell]


def plan(
    task: str, learners: Sequence[str], seeds: int, seconds: float | None, everybody: bool
) -> list[Case]:
    """The cases of a task.

    Parameters
    ----------
    task : str
        A registered task whose numbers are settings.
    learners : sequence of str
    seeds : int
    seconds : float, optional
        Vehicle time; usual for the task by default.
    everybody : bool
        Nobody was asked for by name: one that cannot is left out in place of an error.

    Raises
    ------
    InputError
        When a learner asked for cannot learn this task, or the task cannot be compared on.
    """
    file = resources.config(task)
    simulated = resources.parameters(file, "simulator") if file else {}
    model = make_vehicle(task, file)
    if not hasattr(model, "__dataclass_fields__"):
        raise InputError(
            f"task is {task!r}; allowed for a comparison: a task whose class is a dataclass of "
            f"its settings, such as {', '.join(SECONDS)}"
        )
    world = from_mapping(WorldSettings, simulated, str(file))
    length = seconds or SECONDS.get(task, USUAL_SECONDS)
    if round(length / model.description.sampling_time) < LOOKS:
        least = LOOKS * model.description.sampling_time
        raise InputError(f"seconds is {length:g}; allowed: {least:g} or more")
    known = [name for name in learners if not everybody or _can(name, model, file)]
    cases = [_case(ALONE_CASE, model, world, known, seeds, length, file)]
    if _shipped(task):
        cases.append(_case(SHOWN_CASE, model, world, known, seeds, length, file))
    if hasattr(model, "g_change_start"):
        jumping = replace(model, g_after=G_AFTER, g_change_start=length)
        cases.append(_case(JUMP_CASE, jumping, world, known, seeds, 2 * length, file))
    return cases


def _case(
    name: str, model: Any, world: WorldSettings, learners: Sequence[str], seeds: int,
    seconds: float, file: Path | None,
) -> Case:  # fmt: skip
    """Who is in a case, and who cannot be: `None`."""
    cells: dict[str, Cell | None] = {}
    for learner in learners:
        traits = TRAITS.get(learner)
        shown = name != ALONE_CASE and (traits is None or traits.demonstrations)
        if (name == SHOWN_CASE and not shown) or (name == ALONE_CASE and learner == "apprentice"):
            cells[learner] = None
            continue
        settings = settings_of(learner, model, file, alone=not shown)
        source = SHOWN if shown and _shipped(model.description.name) else NOTHING
        life = Life(learner, settings, model, world, source, seconds)
        if name == JUMP_CASE:
            life = replace(life, looks=2 * LOOKS)
        cells[learner] = Cell(learner, realisation(learner), life, seeds, seconds / 4.0)
    yardstick = Yardstick(model, (0.0, seconds))
    measured = Cell("best", best, yardstick, 1, 5.0) if has_reference(model) else None
    return Case(model.description, name, cells, measured, getattr(model, "g_change_start", 0.0))


def _shipped(task: str) -> bool:
    """Whether the demonstrations are there."""
    try:
        return bag(SHOWN, task) is not None
    except InputError:
        return False


def realisation(learner: str) -> Callable[[Any, int], Mapping[str, Any]]:
    """The function that realises a learner's life."""
    return deep.learn if learner == DEEP else learn


def settings_of(learner: str, model: Any, file: Path | None, alone: bool = False) -> Any:
    """A learner's settings for a task, as its file says; checked by making one.

    Raises
    ------
    InputError
        When there is no such learner, or it cannot learn this task.
    """
    about = model.description
    if learner == DEEP:
        return deep.settings(about)
    values = resources.parameters(file, "learner") if file else {}
    if alone and "release" in {action.name for action in about.actions}:
        values |= ALONE  # from nothing T explores much longer there
    values["update_interval"] = values.get("update_interval", 1000) * PACE.get(learner, 1)
    cls = learner_class(learner)
    settings = from_mapping(cls.Settings, values, str(file))
    cls(about, settings, np.random.default_rng(0))
    return settings


def _can(learner: str, model: Any, file: Path | None) -> bool:
    try:
        settings_of(learner, model, file)
    except InputError:
        return False
    return True
