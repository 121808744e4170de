"""Memory of the cockpit, in the page and in the node, while somebody flies for long.

usage: .venv/bin/python benchmarks/cockpit_soak.py [MINUTES]

As in cockpit_latency.py a pendulum in real time, taken over from a page in Debian's Chromium, which
presses left and right in turn. Every five seconds the page's garbage is collected and its heap is
read, with its elements and listeners, and the memory of both processes. Growth is from one tenth of
the time to the next, the first left out, with the 95 % interval of these nine differences.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import numpy as np
from cockpit_latency import held_in_a_page

from iolspi_ros.experiments.statistics import interval

EVERY, PARTS = 5.0, 10


def main() -> None:
    """Measure, and print a table."""
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    rows = []
    with held_in_a_page() as (page, _, until):
        node = below(os.getpid(), b"\0cockpit\0")[0]
        tab = max(below(os.getpid(), b"--type=renderer"), key=resident)
        begin, keys = time.monotonic(), ("ArrowLeft", "ArrowRight")
        print("minute,node [MB],tab [MB],heap [MB],elements,listeners", flush=True)
        while (now := time.monotonic() - begin) < 60 * minutes:
            page.press(keys[len(rows) % 2])
            over = time.monotonic() + EVERY
            until(lambda over=over: time.monotonic() > over, 2 * EVERY)
            page.lift(keys[len(rows) % 2])
            rows.append((now / 60, resident(node), resident(tab), *inside(page)))
            print(",".join(f"{value:.2f}" for value in rows[-1]), flush=True)
        joys = page.part("now")
    print(f"the newest was step {joys['step']} of episode {joys['episode']}; {os.getloadavg()}")
    table(np.array(rows))


def table(rows: np.ndarray) -> None:
    """Print growth per hour."""
    parts = np.array([part.mean(axis=0) for part in np.array_split(rows, PARTS)])
    hours = (parts[-1, 0] - parts[0, 0]) / 60 / (PARTS - 1)
    for column, what in enumerate(("node [MB]", "tab [MB]", "heap [MB]", "elements", "listeners")):
        values = parts[:, column + 1]
        mean, low, high = interval(np.diff(values[1:]) / hours)
        ends = f"{values[1]:.2f} to {values[-1]:.2f}"
        print(f"{what}: {ends}, {mean:+.2f} an hour ({low:.2f}, {high:.2f})")


def inside(page: object) -> tuple[float, float, float]:
    """Heap after collection [MB], elements and listeners of a page."""
    ask = page.driver.execute_cdp_cmd
    ask("HeapProfiler.collectGarbage", {})
    counted = ask("Memory.getDOMCounters", {})
    heap = ask("Runtime.getHeapUsage", {})["usedSize"] / 1e6
    return heap, counted["nodes"], counted["jsEventListeners"]


def below(pid: int, word: bytes) -> list[int]:
    """Processes that one has begun, and those have, with something in their command."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    begun = [int(n) for task in tasks for n in (task / "children").read_text().split()]
    found = [n for one in begun for n in below(one, word)]
    return [n for n in begun if word in Path(f"/proc/{n}/cmdline").read_bytes()] + found


def resident(pid: int) -> float:
    """Memory of a process [MB]."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    main()
