"""One measured figure beside its goal."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Row:
    """A figure.

    Attributes
    ----------
    name : str
    value : float
    unit : str
    goal : str
        Empty when there is none.
    holds : bool, optional
        Whether the goal is met; None without a goal.
    """

    name: str
    value: float
    unit: str
    goal: str = ""
    holds: bool | None = None


def at_most(name: str, value: float, unit: str, goal: float) -> Row:
    """A figure that should not be larger than its goal."""
    return Row(name, value, unit, f"at most {goal:g}", bool(value <= goal))


def at_least(name: str, value: float, unit: str, goal: float) -> Row:
    """A figure that should not be smaller than its goal."""
    return Row(name, value, unit, f"at least {goal:g}", bool(value >= goal))
