"""What may be exchanged in a task without changing it: mirrors, turns."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from iolspi_ros.errors import InputError

_MINUS = "-"


@dataclass(frozen=True)
class Symmetry:
    """States and actions that lead to the same when all are exchanged together.

    Parameters
    ----------
    name : str
        For people.
    variables : tuple of str
        For each variable, in order, which one takes its place; "-" before it turns its sign.
    actions : tuple of int
        For each action, in order, which one takes its place: what `a` does in a state, `actions[a]`
        does in its image.
    about : tuple of float
        State that stays where it is; zeros by default.
    """

    name: str
    variables: tuple[str, ...]
    actions: tuple[int, ...]
    about: tuple[float, ...] = ()

    def places(self, names: Sequence[str]) -> tuple[list[int], list[float]]:
        """Which variable takes each place, and its sign."""
        bare = [name.removeprefix(_MINUS) for name in self.variables]
        signs = [-1.0 if name.startswith(_MINUS) else 1.0 for name in self.variables]
        return [names.index(name) for name in bare], signs

    def check(self, names: Sequence[str], n_actions: int) -> None:
        """Raise unless it exchanges these variables and actions.

        Raises
        ------
        InputError
            Naming the field, its value and what is allowed.
        """
        bare = sorted(name.removeprefix(_MINUS) for name in self.variables)
        if bare != sorted(names):
            raise InputError(
                f"variables of symmetry {self.name} are {list(self.variables)}; allowed: each of "
                f"{', '.join(names)} once, with '-' before it or not"
            )
        if sorted(self.actions) != list(range(n_actions)):
            raise InputError(
                f"actions of symmetry {self.name} are {list(self.actions)}; allowed: each of 0 to "
                f"{n_actions - 1} once"
            )
        if len(self.about) not in (0, len(names)) or not all(map(math.isfinite, self.about)):
            raise InputError(
                f"about of symmetry {self.name} is {list(self.about)}; allowed: a finite number "
                f"for each of {', '.join(names)}"
            )
