"""Progress on a terminal, or as lines where there is none."""

from __future__ import annotations

import math
import os
import time
from bisect import bisect
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

if TYPE_CHECKING:
    from iolspi_ros.methods.near_optimal import NearOptimal
    from sim_nodes.tasks.base import Task

APART = 0.1
"""Seconds between two that are remembered of how far something was."""
console = Console(highlight=False, soft_wrap=True)
_LOADED = time.monotonic()


class Remaining:
    """How long something will still take, by how fast it has gone of late.

    That is over the later half of the time since its first sign of life: what comes before,
    compiling or waiting for others, is done once, and a pace that has changed is soon the pace.

    Parameters
    ----------
    total : float
    """

    def __init__(self, total: float) -> None:
        self._total = total
        self._seen: list[tuple[float, float]] = []  # times, and what was done then

    def __call__(self, now: float, done: float) -> float | None:
        """Seconds left at a time with so much done; None while nobody can know."""
        seen = self._seen
        if done <= 0:
            return None
        if not seen or (done > seen[-1][1] and now - seen[-1][0] > APART):
            seen.append((now, done))
        middle = (seen[0][0] + now) / 2.0
        begin, before = seen[max(bisect(seen, (middle, math.inf)) - 1, 0)]
        if done <= before:
            return None
        return max((now - begin) / (done - before) * (self._total - done), 0.0)


@contextmanager
def bar(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """Show how far `what` is, and how long it will still take.

    Yields
    ------
    callable
        Call it with how much of `total` is done.
    """
    if not console.is_terminal:
        yield _lines(what, total)
        return
    columns = (
        TextColumn("{task.description:<28}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    remaining = Remaining(total)
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(what, total=total, left="")

        def show(done: int) -> None:
            left = _in_words(remaining(time.monotonic(), done))
            progress.update(task, completed=min(done, total), left=left)

        yield show


def _in_words(left: float | None) -> str:
    return "" if left is None else f"{left:.0f} s left"


def so_far() -> float:
    """Seconds since this process began: what a person at the terminal has waited."""
    try:
        ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
        up = float(Path("/proc/uptime").read_text().split()[0])
    except OSError:  # another system than Linux
        return time.monotonic() - _LOADED
    return up - ticks / os.sysconf("SC_CLK_TCK")


def baseline(task: Task) -> NearOptimal | None:
    """The near-optimal policy, if the task has one; the first time it takes a while, and shows."""
    from iolspi_ros.experiments.evaluate import has_reference, near_optimal_policy

    if not has_reference(task):
        return None
    with bar("near-optimal policy [%]", 100) as show:
        policy = near_optimal_policy(task, progress=lambda share: show(int(100 * share)))
        show(100)
    return policy


def _lines(what: str, total: int) -> Callable[[int], None]:
    remaining, said = Remaining(total), 0.0

    def show(done: int) -> None:
        nonlocal said
        now = time.monotonic()
        left = _in_words(remaining(now, done))
        if (now - said < 5.0 and done < total) or said < 0.0:
            return
        eta = f", {left}" if left and done < total else ""
        print(f"{what}: {min(done, total)} of {total}{eta}", flush=True)
        said = now if done < total else -1.0

    return show
