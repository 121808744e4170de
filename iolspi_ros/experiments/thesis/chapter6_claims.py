"""What T 6-1 asks of the drop-off in three dimensions, and what it was built for, from data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.statistics import Interval, difference, interval, proportion
from iolspi_ros.experiments.thesis import claims
from iolspi_ros.experiments.thesis.claims import OURS, Claim, Finding
from iolspi_ros.experiments.thesis.compare import Decide, every
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

Array = NDArray[np.float64]
Cells = Mapping[str, NDArray[Any]]

SHOWN, NOTHING = "50 shown", "from nothing"
SHIELDED = "50 shown, shield"
HELD, WINDY = "50 shown, wind held against", "50 shown, wind"
ALONE = "50 shown, without symmetries"
FEW, PERFORMED = "10 shown", "50 shown, all performed"
PERFORMED_SHIELDED = f"{PERFORMED}, shield"
Q_LEARNING = "50 shown, Q-learning on a grid"
PLANNED, PLANNED_IN_WIND = "planner on the true model", "planner on the true model, wind"
CHANGES = {
    (what, forgets): f"{what}, {'forgetting' if forgets else 'η = 1'}"
    for what in ("load three times as heavy", "cable half as long")
    for forgets in (False, True)
}

ENDINGS = [ending.name for ending in SlungLoad3D.description.endings]
DUNK = ENDINGS.index("dunk")
FIRST_CRASH = DUNK + 2
LEVEL, BACK = 80.0, 5.0
"""Dunks [%] that are wanted first; points below those before a change that count as back."""
LAST = 4
"""Looks at the end over which policies are judged: one alone says little where they swing."""


def share(counts: NDArray[Any], *endings: int) -> Array:
    """Of episodes that ended so, by counts of shape (..., n_endings)."""
    part: Array = counts[..., list(endings)].sum(axis=-1) / counts.sum(axis=-1)
    return part


def dunks(cell: Cells) -> Array:
    """Judged dunks at each look [%], shape (seeds, looks)."""
    return 100.0 * share(cell["judged"], DUNK)


def broken(cell: Cells) -> Array:
    """Judged crashes at each look [%], shape (seeds, looks)."""
    return 100.0 * share(cell["judged"], *range(FIRST_CRASH, len(ENDINGS)))


def at_the_end(values: Array) -> Array:
    """Mean of the last looks, shape (seeds,)."""
    mean: Array = values[:, -LAST:].mean(axis=1)
    return mean


def percent(happened: NDArray[np.bool_]) -> Interval:
    """Share of those where it did [%]."""
    found = proportion(int(happened.sum()), happened.size)
    return Interval(*(100.0 * value for value in found))


def crashes(cell: Cells, first: int = 0, last: int | None = None) -> Interval:
    """Crashes while learning, of all seeds' episodes together [%]."""
    return percent(cell["ending"][:, first:last] >= FIRST_CRASH)


def until(cell: Cells, level: float = LEVEL) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Episodes and crashes before the first look with so many dunks [%], and whether it came.

    Where it did not, those of the whole run.
    """
    good = dunks(cell) >= level
    reached: NDArray[np.bool_] = np.any(good, axis=1)
    looks = np.where(reached, good.argmax(axis=1), good.shape[1] - 1)
    episodes = np.take_along_axis(cell["after"], looks[:, None], axis=1)[:, 0]
    crashed = np.cumsum(cell["ending"] >= FIRST_CRASH, axis=1)
    before = np.where(episodes > 0, crashed[np.arange(len(episodes)), episodes - 1], 0)
    return episodes.astype(float), before.astype(float), reached


def recovered(cell: Cells) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Points lost at a change, episodes until all but 5 are back, and whether they came back."""
    after, dunked = cell["after"][0], dunks(cell)
    place = int(np.flatnonzero(np.diff(after) == 0)[0])  # two looks in one place
    level = dunked[:, place - LAST + 1 : place + 1].mean(axis=1)
    back = dunked[:, place + 1 :] >= level[:, None] - BACK
    came: NDArray[np.bool_] = np.any(back, axis=1)
    looks = np.where(came, back.argmax(axis=1), back.shape[1] - 1)
    episodes = after[place + 1 :][looks] - after[place]
    return level - dunked[:, place + 1], episodes.astype(float), came


def _dunks(label: str, least: float) -> Decide:
    def decide(data: Data) -> list[Finding]:
        what = f"{label}: dunks at the end [%]"
        return [claims.above(what, interval(at_the_end(dunks(data[label]))), least)]

    return decide


def _broken(label: str, most: float) -> Decide:
    """Of the last policies' episodes, all seeds together."""

    def decide(data: Data) -> list[Finding]:
        found = interval(at_the_end(broken(data[label])))
        return [claims.below(f"{label}: greedy crashes at the end [%]", found, most)]

    return decide


def _crashed(label: str, most: float) -> Decide:
    return lambda data: [
        claims.below(f"{label}: crashes while learning [%]", crashes(data[label]), most)
    ]


def _more(first: str, second: str, by: float = 0.0) -> Decide:
    def decide(data: Data) -> list[Finding]:
        gain = difference(at_the_end(dunks(data[first])), at_the_end(dunks(data[second])))
        return [claims.above(f"{first} minus {second}, dunks at the end [%]", gain, by)]

    return decide


def _scored(first: str, second: str) -> Decide:
    def decide(data: Data) -> list[Finding]:
        gain = difference(data[first]["score"].mean(axis=1), data[second]["score"].mean(axis=1))
        return [claims.above(f"{first} minus {second}, score while learning", gain)]

    return decide


def _saved(data: Data) -> list[Finding]:
    """What demonstrations save until the level is reached."""
    (shown, shown_crashes, _), (alone, alone_crashes, _) = until(data[SHOWN]), until(data[NOTHING])
    to = f"to {LEVEL:g} % dunks, {NOTHING} minus {SHOWN}"
    return [
        claims.above(f"episodes {to}", difference(alone, shown)),
        claims.above(f"crashes {to}", difference(alone_crashes, shown_crashes)),
    ]


def _back(what: str) -> Decide:
    """Forgetting brings it back sooner."""

    def decide(data: Data) -> list[Finding]:
        kept, forgotten = (recovered(data[CHANGES[what, how]])[1] for how in (False, True))
        gain = difference(kept, forgotten)
        return [claims.above(f"{what}: episodes until back, η = 1 minus forgetting", gain)]

    return decide


CLAIMS = (
    Claim(
        "T 6-1 asks how it compares to Q-learning in 3-D: it dunks more after as many episodes, "
        "and scores more on the way", OURS, "50 demonstrations",
        every(_more(SHOWN, Q_LEARNING), _scored(SHOWN, Q_LEARNING)),
    ),
    Claim(
        "T 6-1 asks which demonstrations are useful: those that explore are more than those that "
        "only perform", OURS, "50 episodes of the scripted pilot", _more(SHOWN, PERFORMED),
    ),
    Claim("and 50 are more than 10", OURS, "exploring", _more(SHOWN, FEW)),
    Claim("Demonstrations save episodes and crashes until 80 % of the starts end with a dunk", OURS,
          "ε = 0.01; from nothing ε from 1, T 11-1", _saved),
    Claim("At least 90 % dunks and less than 1 % crashes after demonstrations that explore", OURS,
          "of the last four policies", every(_dunks(SHOWN, 90.0), _broken(SHOWN, 1.0))),
    Claim("and after those that perform", OURS, "of the last four policies",
          every(_dunks(PERFORMED, 90.0), _broken(PERFORMED, 1.0))),
    Claim("Less than 1 % of the episodes online crash", OURS, "from the first on",
          every(_crashed(SHOWN, 1.0), _crashed(PERFORMED, 1.0))),
    Claim("Behind the shield none does: less than 0.1 %", OURS, "from the first on",
          every(_crashed(SHIELDED, 0.1), _crashed(PERFORMED_SHIELDED, 0.1))),
    Claim("At least 85 % dunks in wind of 4 m/s with gusts, where the controller leans against it",
          OURS, "of the last four policies", _dunks(HELD, 85.0)),
    Claim("and where it does not", OURS, "of the last four policies", _dunks(WINDY, 85.0)),
    Claim("The symmetries are what makes ten variables possible", OURS, "50 demonstrations",
          _more(SHOWN, ALONE, 10.0)),
    Claim("After a change, forgetting brings the dunks back sooner", OURS, "a change in mid-run",
          every(*map(_back, dict.fromkeys(what for what, _ in CHANGES)))),
)  # fmt: skip
