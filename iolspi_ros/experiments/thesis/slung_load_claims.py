"""What T says of the slung load, and how data decide it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.statistics import Interval, difference, interval
from iolspi_ros.experiments.thesis import claims
from iolspi_ros.experiments.thesis.claims import OURS, Claim, Finding
from iolspi_ros.experiments.thesis.compare import Decide, every
from sim_nodes.tasks.slung_load import Outcome

Array = NDArray[np.float64]

ONLINE_T = "online"
INFORMED_T = "informed"
REFRESHED_T = "informed, refreshed"
DEFAULT_T = "informed, larger grid, refreshed"
DEFAULT_SHIELDED = "informed, larger grid, shield, refreshed"
GREEDY = "informed, larger grid"
SHIELDED = "informed, larger grid, shield"
FINE = "informed, finest grid"
CONSTANT = "online, ε = 0.01"
NARROW = "narrow, online"
NARROW_INFORMED = "narrow, informed"
NARROW_LARGE = "narrow, informed, larger grid"

BIN = 500
"""Episodes of which shares are taken."""
_ENDINGS = {
    "crashes": (Outcome.CABLE, Outcome.WALL),
    "misses": (Outcome.MISS,),
    "dunks": (Outcome.DUNK,),
    "time-outs": (Outcome.OPEN,),
}


def ended(ending: NDArray[Any], what: str) -> NDArray[np.bool_]:
    """Which episodes ended in crashes, misses, dunks or time-outs; of the same shape."""
    return np.isin(ending, [int(outcome) for outcome in _ENDINGS[what]])


def binned(ending: NDArray[Any], what: str) -> Array:
    """Share of episodes that ended so, in every `BIN` of them: (n_seeds, n_bins)."""
    count = max(ending.shape[1] // BIN, 1)
    width = min(BIN, ending.shape[1])
    whole = ended(ending[:, : count * width], what).reshape(len(ending), count, width)
    return np.asarray(whole.mean(axis=2))


def rate(data: Data, label: str, what: str, first: int, last: int) -> Array:
    """Episodes per 1,000 that ended so, of some of a run of 15,000, shape (n_seeds,).

    A shorter run, such as a quick one, is scaled.
    """
    ending = data[label]["ending"]
    scale = min(1.0, max(data[other]["ending"].shape[1] for other in data
                         if "ending" in data[other]) / 15_000)  # fmt: skip
    part = ending[:, int(first * scale) : max(int(last * scale), int(first * scale) + 1)]
    return np.asarray(1000.0 * ended(part, what).mean(axis=1))


def judged(data: Data, label: str, what: str, look: int = -1) -> Array:
    """Share of greedy episodes that end so at a look, the last one if not told, (n_seeds,)."""
    last = data[label]["judged"]
    last = last[:, look] if last.ndim == 3 else last
    columns = [int(outcome) for outcome in _ENDINGS[what]]
    return np.asarray(last[:, columns].sum(axis=1) / last.sum(axis=1))


def _gap(what: str, first: str, second: str, begin: int, end: int, more: bool) -> Decide:
    """The first has more (or fewer) of them than the second, in some episodes."""

    def decide(data: Data) -> list[Finding]:
        gap = difference(rate(data, first, what, begin, end), rate(data, second, what, begin, end))
        name = f"{first} minus {second}: {what} per 1,000 episodes, {begin} to {end}"
        return [(claims.above if more else claims.below)(name, gap)]

    return decide


def _trend(label: str, what: str, before: tuple[int, int], after: tuple[int, int]) -> Decide:
    """There are more of them in the second stretch of episodes than in the first."""

    def decide(data: Data) -> list[Finding]:
        gap = difference(rate(data, label, what, *after), rate(data, label, what, *before))
        name = f"{label}: {what} per 1,000, episodes {after[0]} to {after[1]} minus {before[0]} to "
        return [claims.above(f"{name}{before[1]}", gap)]

    return decide


def _fewer(label: str, what: str, before: tuple[int, int], after: tuple[int, int]) -> Decide:
    return _trend(label, what, after, before)


def _score(begin: int, end: int) -> Decide:
    def decide(data: Data) -> list[Finding]:
        count = data[ONLINE_T]["score"].shape[1]
        rows = slice(begin * count // 15_000, end * count // 15_000)
        first, second = (data[k]["score"][:, rows].mean(axis=1) for k in (INFORMED_T, ONLINE_T))
        name = f"{INFORMED_T} minus {ONLINE_T}: score, episodes {begin} to {end}"
        return [claims.above(name, difference(first, second))]

    return decide


def reduction(data: Data, first: str, second: str, begin: int, end: int) -> Interval:
    """By how many per cent the first crashes less than the second's mean."""
    mine, theirs = (rate(data, label, "crashes", begin, end) for label in (first, second))
    return Interval(*(100.0 * gap / theirs.mean() for gap in difference(theirs, mine)))


def _ten_to_fifty(data: Data) -> list[Finding]:
    parts = ((0, 5000), (5000, 10_000), (10_000, 15_000))
    return [
        claims.within(f"crashes fewer with demonstrations [%], episodes {begin} to {end}",
                      reduction(data, INFORMED_T, ONLINE_T, begin, end), 10.0, 50.0)
        for begin, end in parts
    ]  # fmt: skip


def _converges(label: str, more: bool) -> Decide:
    def decide(data: Data) -> list[Finding]:
        dunks = interval(judged(data, label, "dunks"))
        name = f"{label}: share of greedy episodes that dunk at the end"
        return [claims.above(name, dunks, 0.5) if more else claims.below(name, dunks, 0.5)]

    return decide


def _slower(data: Data) -> list[Finding]:
    seconds = [cell["seconds"] for cell in data.values()]
    names = list(data)
    return [
        claims.above(f"{names[k + 1]} minus {names[k]} [s]",
                     difference(seconds[k + 1], seconds[k]))
        for k in range(len(seconds) - 1)
    ]  # fmt: skip


def _same_exploration(data: Data) -> list[Finding]:
    fewer = reduction(data, INFORMED_T, CONSTANT, 0, 15_000)
    return [claims.above(f"{INFORMED_T} crashes less than {CONSTANT} [%]", fewer)]


_HERE = "15,000 episodes, 9×1×9×1 functions"
_EARLY_ENDS = (
    "while ε is high, online LSPI ends most episodes by releasing at random, after 3 to 4 steps, "
    "before anything can crash (T says so too); informed episodes last and have the time. Against "
    "online LSPI with the same ε = 0.01 they do crash less: see the study narrow"
)
CLAIMS: dict[str, tuple[Claim, ...]] = {
    "fig21": (
        Claim(
            "IOLSPI is better than online LSPI for the first 15,000 episodes",
            "IV-B-1, Fig. 21",
            _HERE,
            every(_score(0, 5000), _score(5000, 10_000), _score(10_000, 15_000)),
        ),
    ),
    "fig22": (
        Claim(
            "The longer online LSPI learns, the fewer misses and the more dunks",
            "IV-B-1, Fig. 22",
            _HERE,
            every(
                _fewer(ONLINE_T, "misses", (0, 1000), (14_000, 15_000)),
                _trend(ONLINE_T, "dunks", (0, 1000), (14_000, 15_000)),
            ),
        ),
        Claim(
            "Crashes of online LSPI drop in the beginning",
            "IV-B-1, Fig. 22",
            _HERE,
            _fewer(ONLINE_T, "crashes", (0, 1000), (2000, 8000)),
            "They are few from the first episode on, 2.6 in 1,000: random releases come before "
            "anything can crash",
        ),
        Claim(
            "From 10,000 episodes onward they gradually increase, as exploration decreases",
            "IV-B-1, Fig. 22",
            _HERE,
            _trend(ONLINE_T, "crashes", (2000, 8000), (11_000, 15_000)),
        ),
        Claim(
            "With demonstrations dunks and misses are better from the beginning",
            "IV-B-1, Fig. 22",
            _HERE,
            every(
                _gap("dunks", INFORMED_T, ONLINE_T, 0, 1000, more=True),
                _gap("misses", INFORMED_T, ONLINE_T, 0, 1000, more=False),
            ),
        ),
        Claim(
            "Crashes while learning are 10 to 50 % fewer with demonstrations",
            "IV-B-1, V, Fig. 22",
            _HERE,
            _ten_to_fifty,
            _EARLY_ENDS,
        ),
    ),
    "narrow": (
        Claim(
            "A constant ε of 0.01 results in poor results for online LSPI",
            "11-1",
            _HERE,
            _converges(CONSTANT, more=False),
        ),
        Claim(
            "From x between -5 and -4 m online LSPI does not find a satisfactory policy",
            "11-2",
            _HERE,
            _converges(NARROW, more=False),
        ),
        Claim(
            "IOLSPI does not have this problem",
            "11-2",
            _HERE,
            _converges(NARROW_INFORMED, more=True),
            "on T's 324 functions it learns to release at once; with the velocities among the "
            "functions it finds the way: see the larger grid",
        ),
        Claim(
            "With the same ε = 0.01 there are fewer crashes with demonstrations than without",
            OURS,
            _HERE,
            _same_exploration,
        ),
        Claim(
            "More functions, over all dimensions, would probably perform better",
            "11-2",
            "6,000 episodes, 5×4×7×4 functions",
            _converges(NARROW_LARGE, more=True),
        ),
    ),
    "table3": (
        Claim(
            "With more functions the computational effort goes up quickly",
            "IV-B-1, Table 3",
            "1,000 episodes",
            _slower,
            "Up to 324 functions flying costs more than learning",
        ),
    ),
}
