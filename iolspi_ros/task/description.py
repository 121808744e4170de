"""One small description of a vehicle and of what it is to do; it travels on the topic `task`."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError, check_range
from iolspi_ros.task.symmetry import Symmetry

Array = NDArray[np.float64]

RESERVED = (
    "episode", "step", "sec", "nanosec", "action", "reward", "terminated", "truncated", "source",
)  # fmt: skip
"""Names of other entries of a row on the wire, which no variable may have."""
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.]*")
_POSITION, _VELOCITY = ".position", ".velocity"
MOST_VARIABLES, MOST_ACTIONS, MOST_ENDINGS, MOST_VALUES, MOST_SYMMETRIES = 1000, 1000, 100, 100, 8


@dataclass(frozen=True)
class Variable:
    """One entry of the state.

    Parameters
    ----------
    name : str
        Letters, digits, underscores and points, such as "shaft.position".
    unit : str
        SI, such as "rad/s"; empty for none.
    low, high : float
        Limits of what occurs; infinite where there is none.
    periodic : bool
        Whether `high` is `low` again, as of an angle.
    label : str
        The same for people; the name by default.

    Raises
    ------
    InputError
        Naming the field, its value and what is allowed.
    """

    name: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    periodic: bool = False
    label: str = ""

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name) or self.name in RESERVED or self.name[:5] == "next.":
            raise InputError(
                f"name of a variable is {self.name!r}; allowed: letters, digits, '_' and '.', a "
                f"letter first, and none of {', '.join(RESERVED)} nor next.…"
            )
        if not self.low < self.high:
            raise InputError(
                f"low and high of variable {self.name} are {self.low} and {self.high}; "
                "allowed: low < high"
            )
        if self.periodic and not math.isfinite(self.high - self.low):
            raise InputError(
                f"variable {self.name} is periodic with low {self.low} and high {self.high}; "
                "allowed: two finite limits"
            )

    @property
    def axis(self) -> str:
        """For the axis of a plot: what it is, with its unit."""
        name = self.label or self.name
        return f"{name} [{self.unit}]" if self.unit else name


@dataclass(frozen=True)
class Action:
    """One of the actions.

    Parameters
    ----------
    name : str
        For people.
    value : tuple of float
        What it means to the vehicle, in the task's `action_unit`; empty where no number does.
    """

    name: str
    value: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError("name of an action is ''; allowed: a word for people")
        if not all(map(math.isfinite, self.value)):
            raise InputError(
                f"value of action {self.name} is {list(self.value)}; allowed: finite numbers"
            )


@dataclass(frozen=True)
class Ending:
    """A way in which an episode ends.

    Parameters
    ----------
    name : str
    reward : float, optional
        The reward of the last step that tells it from other ways; without one it is how the task
        ends when no other's reward fits.
    success : bool
        Whether the goal was reached then.
    """

    name: str
    reward: float | None = None
    success: bool = False


@dataclass(frozen=True)
class TaskDescription:
    """What a learner, a demonstrator, a bag reader or a report must know of a vehicle.

    Parameters
    ----------
    name : str
    variables : tuple of Variable
        The state, in this order.
    actions : tuple of Action
        Numbered from 0.
    sampling_time : float
        T_s [s].
    neutral : int
        The action that does nothing.
    episode_steps : int
        Steps after which the clock cuts an episode.
    gamma : float in [0, 1)
        Discount factor of the return.
    endings : tuple of Ending
        The first is that the clock cut the episode.
    success : str
        What an episode that reached its goal did, as in: 95 % of the starts end upright.
    action_unit : str
        Of the actions' values.
    map_variables : tuple of (str, str)
        The two variables over which maps are drawn; the first two by default.
    version : int
        Of the task; two versions are two tasks.
    symmetries : tuple of Symmetry
        What may be exchanged without changing it; those that follow from them need not stand here.

    Raises
    ------
    InputError
        Naming the field, its value and what is allowed.
    """

    name: str
    variables: tuple[Variable, ...]
    actions: tuple[Action, ...]
    sampling_time: float
    neutral: int = 0
    episode_steps: int = 1000
    gamma: float = 0.98
    endings: tuple[Ending, ...] = (Ending("time-out"), Ending("end"))
    success: str = "reach the goal"
    action_unit: str = ""
    map_variables: tuple[str, ...] = ()
    version: int = 1
    symmetries: tuple[Symmetry, ...] = ()

    def __post_init__(self) -> None:
        if not self.name:
            raise InputError("name of the task is ''; allowed: a word")
        for what, entries, least, most in (
            ("variables", self.variables, 1, MOST_VARIABLES),
            ("actions", self.actions, 1, MOST_ACTIONS),
            ("endings", self.endings, 1, MOST_ENDINGS),
            ("symmetries", self.symmetries, 0, MOST_SYMMETRIES),
        ):
            check_range(f"number of {what}", len(entries), least, most)
            names = [entry.name for entry in entries]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise InputError(f"{what} have {twice[0]!r} twice; allowed: each name once")
        lengths = {len(action.value) for action in self.actions}
        if len(lengths) > 1 or max(lengths) > MOST_VALUES:
            raise InputError(
                f"values of the actions have {sorted(lengths)} entries; allowed: the same number "
                f"for each, at most {MOST_VALUES}"
            )
        check_range("sampling_time", self.sampling_time, 0.0, 1e6, low_open=True)
        check_range("neutral", self.neutral, 0, len(self.actions) - 1)
        check_range("episode_steps", self.episode_steps, 1, 10**9)
        check_range("gamma", self.gamma, 0.0, 1.0, high_open=True)
        check_range("version", self.version, 0, 2**31)
        known = [variable.name for variable in self.variables]
        for symmetry in self.symmetries:
            symmetry.check(known, len(self.actions))
        unknown = [name for name in self.map_variables if name not in known]
        if unknown or len(self.map_variables) not in (0, 2):
            raise InputError(
                f"map_variables is {list(self.map_variables)}; allowed: two of {', '.join(known)}"
            )

    @property
    def n_dims(self) -> int:
        """Number of variables."""
        return len(self.variables)

    @property
    def n_actions(self) -> int:
        """Number of actions."""
        return len(self.actions)

    @property
    def episode_time(self) -> float:
        """Vehicle time of an episode that the clock cuts [s]."""
        return self.sampling_time * self.episode_steps

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the variables."""
        return tuple(variable.name for variable in self.variables)

    @cached_property
    def low(self) -> tuple[float, ...]:
        """Lower limits of the variables."""
        return tuple(variable.low for variable in self.variables)

    @cached_property
    def high(self) -> tuple[float, ...]:
        """Upper limits of the variables."""
        return tuple(variable.high for variable in self.variables)

    @cached_property
    def periodic(self) -> tuple[bool, ...]:
        """Which variables wrap around from `high` to `low`."""
        return tuple(variable.periodic for variable in self.variables)

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints whose position and velocity, in turn, are the state; empty when it is no such."""
        positions, velocities = self.names[0::2], self.names[1::2]
        joints = tuple(name.removesuffix(_POSITION) for name in positions)
        paired = tuple(f"{joint}{end}" for joint in joints for end in (_POSITION, _VELOCITY))
        return joints if len(positions) == len(velocities) and paired == self.names else ()

    @property
    def map_dims(self) -> tuple[int, int]:
        """Where the variables over which maps are drawn stand in the state."""
        if self.map_variables:
            x, y = map(self.names.index, self.map_variables)
            return x, y
        return 0, min(1, self.n_dims - 1)

    def ending(self, reward: Any, terminated: Any) -> NDArray[np.int64]:
        """Which of the endings the last steps of episodes were.

        Parameters
        ----------
        reward : float or ndarray of shape (...)
            Of each last step.
        terminated : bool or ndarray of bool, of the same shape
            Whether the task ended there, not the clock.

        Returns
        -------
        ndarray of int, of the same shape
            Places in `endings`; 0 for the clock.
        """
        reward, terminated = np.asarray(reward, float), np.asarray(terminated, bool)
        others = list(enumerate(self.endings))[1:]
        rest = next((n for n, ending in others if ending.reward is None), 0)
        found = np.where(terminated, rest, 0)
        for number, ending in others:
            if ending.reward is not None:
                found[(reward == ending.reward) & terminated] = number
        return found

    def differences(self, other: TaskDescription) -> list[str]:
        """What keeps two descriptions from being of one task, with the values of both sides.

        Words for people (labels, names of actions, what success is called, maps) may differ.
        """
        return list(self._differences(other))

    def _differences(self, other: TaskDescription) -> Iterator[str]:
        mine, theirs = _facts(self), _facts(other)
        for name in mine:
            if mine[name] != theirs.get(name):
                there = repr(theirs[name]) if name in theirs else "missing"
                yield f"{name} is {mine[name]!r} here and {there} there"
        yield from (f"{name} is {theirs[name]!r} there only" for name in theirs if name not in mine)

    def check_same(self, other: TaskDescription, whose: str, others: str) -> None:
        """Raise unless `other` describes the same task.

        Parameters
        ----------
        other : TaskDescription
        whose, others : str
            Where this one and the other one come from.

        Raises
        ------
        InputError
            Naming both sides of each difference.
        """
        found = self.differences(other)
        if found:
            raise InputError(
                f"the task of {others} contradicts that of {whose}: {'; '.join(found)} "
                f"(here: {whose}; there: {others}); allowed: one and the same task"
            )


def _facts(task: TaskDescription) -> dict[str, Any]:
    """What two descriptions of one task have in common, by the name of the field."""
    facts: dict[str, Any] = {"name": task.name, "version": task.version}
    facts["variables"] = ", ".join(task.names)
    for variable in task.variables:
        for field in ("unit", "low", "high", "periodic"):
            facts[f"{field} of {variable.name}"] = getattr(variable, field)
    facts["actions"] = [list(action.value) for action in task.actions]
    for field in ("action_unit", "neutral", "sampling_time", "episode_steps", "gamma"):
        facts[field] = getattr(task, field)
    facts["endings"] = [(ending.reward, ending.success) for ending in task.endings]
    return facts
