"""What a step earns and whether it ends the episode, by expressions of a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from iolspi_ros.errors import InputError
from iolspi_ros.task.description import Action, TaskDescription
from iolspi_ros.task.expressions import Expression
from iolspi_ros.task.text import make

KEYS = ("reward", "terminated", "truncated")
"""Of a file that has rules; its `endings` may have `when`."""


class Judgement(NamedTuple):
    """What a step came to.

    Attributes
    ----------
    reward : float
    terminated, truncated : bool
        Whether the task ended there; whether something else cut the episode.
    """

    reward: float
    terminated: bool
    truncated: bool


class _Goal(NamedTuple):
    """An ending that a rule finds, and the reward of the step that leads there, if it has one."""

    when: Expression
    reward: float | None


class Rules:
    """Judges steps.

    The names in an expression are those of the variables, before the step; `next.` and the same
    for after it; `action`, the number of the action; and `value`, what it means, or `value0`,
    `value1`, … when that is more than one number.

    Parameters
    ----------
    task : TaskDescription
    content : mapping
        `reward`, `terminated` and `truncated`.
    whens : sequence of (str, expression)
        The rule of each of the task's endings; None where it has none.
    """

    def __init__(
        self, task: TaskDescription, content: Mapping[str, Any], whens: Sequence[Any]
    ) -> None:
        self._task = task
        self._values = [action_values(action) for action in task.actions]
        names = [*task.names, *(f"next.{name}" for name in task.names), "action", *self._values[0]]
        if "reward" not in content:
            raise InputError("the task has no reward; it must have one, such as 0.0")
        self._reward = Expression(content["reward"], names, "reward")
        self._terminated = Expression(content.get("terminated", "false"), names, "terminated")
        self._truncated = Expression(content.get("truncated", "false"), names, "truncated")
        self._goals = [
            _Goal(Expression(when, names, f"when of ending {ending.name}"), ending.reward)
            for ending, when in zip(task.endings, whens, strict=True)
            if when is not None
        ]

    def judge(self, state: Sequence[float], action: int, after: Sequence[float]) -> Judgement:
        """What a step from one state to another came to.

        Raises
        ------
        InputError
            When an expression cannot be computed there.
        """
        names = self._task.names
        values: dict[str, Any] = dict(zip(names, map(float, state), strict=True))
        values |= {f"next.{n}": float(v) for n, v in zip(names, after, strict=True)}
        values |= {"action": action, **self._values[action]}
        for goal in self._goals:
            if goal.when(values):
                reward = self._reward.number(values) if goal.reward is None else goal.reward
                return Judgement(reward, True, False)
        ended = bool(self._terminated(values))
        cut = not ended and bool(self._truncated(values))
        return Judgement(self._reward.number(values), ended, cut)


def read_rules(content: Mapping[str, Any], where: str) -> tuple[TaskDescription, Rules]:
    """A task and its rules, from a file that has both.

    Parameters
    ----------
    content : mapping
        Fields of a task description, with `when` in its endings, and `KEYS`.
    where : str
        For messages.

    Raises
    ------
    InputError
        Naming the place, the field, its value and what is allowed.
    """
    described = {key: value for key, value in content.items() if key not in KEYS}
    endings = described.get("endings")
    whens: list[Any] = []
    if isinstance(endings, list):
        whens = [one.get("when") if isinstance(one, Mapping) else None for one in endings]
        described["endings"] = [
            {k: v for k, v in one.items() if k != "when"} if isinstance(one, Mapping) else one
            for one in endings
        ]
    task = make(described, where)
    try:
        _check_endings(task, whens)
        return task, Rules(task, content, whens or [None] * len(task.endings))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _check_endings(task: TaskDescription, whens: Sequence[Any]) -> None:
    if whens and whens[0] is not None:
        raise InputError(
            f"ending {task.endings[0].name} is the first, which is the clock's, and has a when; "
            "allowed: none there"
        )
    unnamed = [ending.name for ending in task.endings[1:] if ending.reward is None]
    if len(unnamed) > 1:
        raise InputError(
            f"endings {', '.join(unnamed)} have no reward, so nobody can tell them apart; "
            "allowed: one without"
        )


def action_values(action: Action) -> dict[str, float]:
    """What an action means, by the names that expressions know."""
    if len(action.value) == 1:
        return {"value": action.value[0]}
    return {f"value{number}": value for number, value in enumerate(action.value)}
