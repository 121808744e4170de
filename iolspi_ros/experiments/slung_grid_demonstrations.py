"""Demonstrations for the slung load on a grid, flown by a scripted pilot (T Table 5-3).

T's were flown by a person. This pilot holds each input for one to four steps, as a hand does,
and has practised: of what it tries it shows flights of the kind that a set asks for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iolspi_ros.methods.tabular import Episode, fly
from sim_nodes.tasks.slung_grid import PENALTY, SlungGrid

FLIGHTS = 5
"""Demonstrations in a set (T 5-3-1)."""
_LEFT, _RIGHT = 0, 2
_LONGEST_HOLD = 4
_TRIES, _VARIATIONS = 100_000, 30


@dataclass(frozen=True)
class Kind:
    """What a set of demonstrations is like.

    Attributes
    ----------
    begins : int
        First action; -1 for any.
    steps : (int, int)
        Least and most steps to the basket, the load swinging in from the left; empty when the
        flights may end anyhow.
    alike : bool
        Whether the flights differ from the first by one input only.
    """

    begins: int
    steps: tuple[int, ...]
    alike: bool


KINDS = {
    1: Kind(_RIGHT, (11, 13), True),
    2: Kind(_RIGHT, (11, 14), True),
    3: Kind(_LEFT, (12, 16), False),
    4: Kind(-1, (), False),
}
"""T Table 5-3: 1 and 2 try to perform best, 3 first steers to the left, 4 is deliberately poor."""


def demonstrate(grid: SlungGrid, number: int, seed: int) -> list[Episode]:
    """Flights of one set from the start; another seed gives another set of its kind."""
    kind, rng = KINDS[number], np.random.default_rng([seed, number])
    found = [_practised(grid, kind, rng)]
    while len(found) < FLIGHTS:
        found.append(_varied(grid, kind, found[0], rng) if kind.alike
                     else _practised(grid, kind, rng))  # fmt: skip
    return found


def _practised(grid: SlungGrid, kind: Kind, rng: np.random.Generator) -> Episode:
    """The first flight that is of the kind."""
    for _ in range(_TRIES):
        action = kind.begins if kind.begins >= 0 else int(rng.integers(3))
        actions: list[int] = []
        while len(actions) < grid.task.horizon:
            actions += [action] * int(rng.integers(1, _LONGEST_HOLD + 1))
            action = (action + int(rng.integers(1, 3))) % 3
        flight = fly(grid.task, grid.start, actions)
        if _is_of(kind, grid, flight):
            return flight
    raise AssertionError(f"{kind} is not flown in {_TRIES} tries")


def _varied(grid: SlungGrid, kind: Kind, flight: Episode, rng: np.random.Generator) -> Episode:
    """The flight with one input of it changed, as long as it gets there; else the same again."""
    for _ in range(_VARIATIONS):
        actions = flight.actions.copy()
        actions[rng.integers(1, len(actions))] = rng.integers(3)
        again = fly(grid.task, grid.start, actions.tolist())
        if _is_of(kind, grid, again):
            return again
    return flight


def _is_of(kind: Kind, grid: SlungGrid, flight: Episode) -> bool:
    if not kind.steps:
        return True
    least, most = kind.steps
    last = flight.states[-1:]
    fits = bool(grid.task.goal[last[0]]) and least <= len(flight.actions) <= most
    return fits and grid.states(last)[0, 2] > 0.0 and flight.rewards[:-1].min() > PENALTY
