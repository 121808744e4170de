"""Progress on a terminal, or as lines where there is none."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

if TYPE_CHECKING:
    from iolspi_ros.core.reference import NearOptimal
    from sim_nodes.tasks.base import Task

console = Console(highlight=False, soft_wrap=True)


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
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.update(task, completed=min(done, total))


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
    start, said = time.monotonic(), 0.0

    def show(done: int) -> None:
        nonlocal said
        now = time.monotonic()
        if (now - said < 5.0 and done < total) or said < 0.0:
            return
        left = (now - start) / done * (total - done) if done else float("nan")
        eta = f", {left:.0f} s left" if done and done < total else ""
        print(f"{what}: {min(done, total)} of {total}{eta}", flush=True)
        said = now if done < total else -1.0

    return show
