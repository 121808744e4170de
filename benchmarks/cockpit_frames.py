"""How often the cockpit's page is drawn while somebody flies, with a learner at work beside.

usage: .venv/bin/python benchmarks/cockpit_frames.py [TASK] [SECONDS]

As in cockpit_latency.py, a task in real time, taken over from a page in Debian's Chromium, which
draws with the processor alone: it has no graphics card here. The browser asks for a frame 60 times
a second; counted are those that the page drew, and how long drawing one took.
"""

from __future__ import annotations

import os
import sys
import time

import numpy as np
from cockpit_latency import held_in_a_page

COUNT = """
    window.frames_at = []; window.frames_took = [];
    const ask = window.requestAnimationFrame.bind(window);
    window.requestAnimationFrame = (draw) => ask((now) => {
      const begin = performance.now();
      draw(now);
      window.frames_at.push(now); window.frames_took.push(performance.now() - begin);
    });
"""
EVERY = 1.0


def main() -> None:
    """Measure, and print percentiles."""
    task = sys.argv[1] if len(sys.argv) > 1 else "slung_load_3d"
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    with held_in_a_page(task, updates=1) as (page, _, until):
        page.run(COUNT)
        first, begin = page.part("update")["number"], time.monotonic()
        for number in range(int(seconds / EVERY)):
            key = ("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown")[number % 4]
            page.press(key)
            until(lambda number=number: time.monotonic() > begin + EVERY * (number + 1), 60.0)
            page.lift(key)
        at, took = (np.array(page.run(f"return window.frames_{which}")) for which in ("at", "took"))
        updates = page.part("update")["number"] - first
    between = np.diff(at)
    print(f"{task}: {1000 * len(between) / (at[-1] - at[0]):.1f} frames a second for {seconds:g} s")
    for what, values in (("between two", between), ("drawing one", took)):
        p50, p99, most = np.percentile(values, [50, 99, 100])
        print(f"{what}: p50 {p50:.1f} ms, p99 {p99:.1f} ms, most {most:.1f} ms")
    print(f"{updates:.0f} updates of the learner meanwhile; load {os.getloadavg()}")


if __name__ == "__main__":
    main()
