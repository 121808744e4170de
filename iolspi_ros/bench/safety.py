"""What breaks while the slung load is learned, and what a shield changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.bench.rows import Row, at_least, at_most
from iolspi_ros.experiments import engine
from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.statistics import Interval, difference, interval, proportion
from iolspi_ros.experiments.thesis import slung_load
from iolspi_ros.experiments.thesis.curves import NEAR_OPTIMAL
from iolspi_ros.experiments.thesis.slung_load_claims import (
    CONSTANT,
    DEFAULT_SHIELDED,
    DEFAULT_T,
    FINE,
    GREEDY,
    INFORMED_T,
    NARROW_LARGE,
    ONLINE_T,
    SHIELDED,
    ended,
    judged,
    rate,
    reduction,
)

Array = NDArray[np.float64]

WAYS = ("crashes", "misses", "dunks", "time-outs")
BEGIN, ALL, SHORT = (0, 1000), (0, 15_000), (0, slung_load.SHORTER)


def cells(seeds: int) -> list[Cell]:
    """What is flown."""
    wanted = {cell.label: cell for cell in (*slung_load.safety(), *slung_load.narrow())}
    return [
        replace(cell, seeds=seeds if label != NEAR_OPTIMAL else 1) for label, cell in wanted.items()
    ]


def total(seeds: int) -> int:
    """About how long it takes in all [s of one core]."""
    return round(sum(cell.seeds * cell.cost for cell in cells(seeds)))


def measure(seeds: int, show: Callable[[float], None]) -> Data:
    """Every realisation, on every core; those of an earlier call are in the user's cache."""
    store, wanted = Store(resources.cache_folder() / "realisations"), cells(seeds)
    lacking = engine.missing(wanted, store)
    already = total(seeds) - sum(cell.cost for cell, _ in lacking)
    engine.run(lacking, store.write, engine.local(-1), lambda done: show(already + done))
    return engine.gather(wanted, store)


def rows(data: Data) -> list[Row]:
    """Episodes by how they end, and the goals."""
    found: list[Row] = []
    for label, cell in data.items():
        if label == NEAR_OPTIMAL:
            continue
        n = cell["ending"].shape[1]
        for way in WAYS:
            for first, last in ((0, 1000), (0, n)):
                name = f"{label}: {way} per 1,000 episodes, {first} to {last}"
                found += _with_interval(name, interval(rate(data, label, way, first, last)), "")
        crashes = ended(cell["ending"], "crashes")
        pooled = proportion(int(crashes.sum()), crashes.size)
        name = f"{label}: crashes per 1,000 episodes, of all seeds together, upper 95 %"
        found.append(Row(name, 1000.0 * pooled.high, ""))
        damage = crashes.sum(axis=1)
        found += _with_interval(f"{label}: crashes in all {n} episodes", interval(damage), "")
    for label in data:
        for way in WAYS:
            name = f"{label}: greedy at the end, {way}"
            found += _with_interval(name, interval(judged(data, label, way)), "share")
    return [*found, *_thesis(data), *_greedy(data), *_default(data), *_shield(data)]


def _with_interval(name: str, value: Interval, unit: str) -> list[Row]:
    return [
        Row(name, value.mean, unit),
        Row(f"{name}, lower 95 %", value.low, unit),
        Row(f"{name}, upper 95 %", value.high, unit),
    ]


def _thesis(data: Data) -> list[Row]:
    """T's claim: demonstrations make learning safer."""
    fewer = reduction(data, INFORMED_T, ONLINE_T, *ALL)
    name = "crashes fewer with demonstrations than without, 15,000 episodes"
    found = [at_least(name, fewer.mean, "%", 10.0),
             *_with_interval(name, fewer, "%")[1:]]  # fmt: skip
    same = reduction(data, INFORMED_T, CONSTANT, *ALL)
    found += _with_interval("the same, where both explore with ε = 0.01", same, "%")
    for way, sign in (("misses", -1.0), ("dunks", 1.0)):
        gap = difference(
            sign * rate(data, INFORMED_T, way, *BEGIN), sign * rate(data, ONLINE_T, way, *BEGIN)
        )
        title = f"{way} better by, per 1,000, episodes 0 to 1000, lower 95 %"
        found.append(at_least(title, gap.low, "", 0.0))
    return found


def _greedy(data: Data) -> list[Row]:
    """Beyond T: what the policies learned do, and those of the narrow starts."""
    dunks, crashes = (interval(judged(data, FINE, way)) for way in ("dunks", "crashes"))
    best = judged(data, NEAR_OPTIMAL, "dunks").mean()
    narrow = interval(judged(data, NARROW_LARGE, "dunks"))
    return [
        at_least(f"{FINE}: greedy dunks, mean", dunks.mean, "share", 0.95),
        at_most(f"{FINE}: greedy crashes, mean", crashes.mean, "share", 0.01),
        Row("near-optimal: dunks", float(best), "share"),
        at_least(f"{NARROW_LARGE}: greedy dunks, mean", narrow.mean, "share", 0.8),
    ]


def _default(data: Data) -> list[Row]:
    """What the learner that is the default does from the demonstrations, after each look."""
    found = []
    for label, most in ((DEFAULT_T, 0.01), (DEFAULT_SHIELDED, 0.0)):
        cell = data[label]
        looks, episodes = cell["judged"].shape[1] - 1, cell["ending"].shape[1]
        for look in range(1, looks + 1):
            dunks, crashes = (interval(judged(data, label, w, look)) for w in ("dunks", "crashes"))
            after = f"{label}: greedy after {episodes * look // looks} episodes"
            least = 0.97 if look == looks and label == DEFAULT_T else 0.95
            found += [
                at_least(f"{after}, dunks, mean", dunks.mean, "share", least),
                *_with_interval(f"{after}, dunks", dunks, "share")[1:],
                at_most(f"{after}, crashes, mean", crashes.mean, "share", most),
                *_with_interval(f"{after}, crashes", crashes, "share")[1:],
            ]
    return found


def _shield(data: Data) -> list[Row]:
    """What the shield saves and what it costs."""
    found = []
    for first, last in (BEGIN, SHORT):
        plain, behind = (
            rate(data, label, "crashes", first, last).mean() for label in (ONLINE_T, SHIELDED)
        )
        name = f"crashes with demonstrations and shield over online's, episodes {first} to {last}"
        found.append(at_most(name, float(behind / plain), "times", 0.2))
    vetoes = data[SHIELDED]["vetoes"]
    per = interval(1000.0 * vetoes[:, -1] / data[SHIELDED]["ending"].shape[1])
    cost = difference(data[GREEDY]["discounted"][:, -1], data[SHIELDED]["discounted"][:, -1])
    lowered, raised = (data[SHIELDED][name][:, -1] for name in ("flipped_discounted", "discounted"))
    same = difference(lowered, raised)
    return [
        *found,
        *_with_interval("shield: vetoes per 1,000 episodes", per, ""),
        *_with_interval("shield: cost in greedy return, learned without and with", cost, ""),
        *_with_interval("shield: cost in greedy return of one policy, off and on", same, ""),
    ]
