"""What a newcomer pays: `make demo` from a fresh clone, with a fresh HOME, to the report.

Prints minutes, megabytes installed and the peak of the memory of all its processes together.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def memory(session: int) -> float:
    """Proportional memory of every process that descends from `session` [MB]."""
    parents, total = {}, 0.0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
            parents[int(folder.name)] = int(fields[1])
        except (OSError, IndexError):
            continue
    for process in parents:
        ancestor = process
        while ancestor not in (0, session):
            ancestor = parents.get(ancestor, 0)
        if ancestor == session:
            total += proportional(process)
    return total


def proportional(process: int) -> float:
    """Memory of one process, what is shared counted by its share [MB]."""
    try:
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return int(line.split()[1]) / 1024
    except OSError:
        pass
    return 0.0


def main() -> None:
    """Measure once and print."""
    with tempfile.TemporaryDirectory() as folder:
        clone, home = Path(folder) / "clone", Path(folder) / "home"
        home.mkdir()
        subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
        environment = {"HOME": str(home), "PATH": os.environ["PATH"], "LANG": "C.UTF-8"}
        start, installed, peak = time.monotonic(), 0.0, 0.0
        demo = subprocess.Popen(["make", "demo"], cwd=clone, env=environment)
        while demo.poll() is None:
            if not installed and (clone / ".venv/.installed.run").exists():
                installed = time.monotonic() - start
            peak = max(peak, memory(demo.pid))
            time.sleep(0.1)
        took = time.monotonic() - start
        if demo.returncode:
            sys.exit("make demo failed")
        size = subprocess.check_output(["du", "-sm", str(clone / ".venv")], text=True).split()[0]
        summary = json.loads((clone / "out/demo/summary.json").read_text())
        print(f"installation    {installed / 60:.2f} min, {size} MB in .venv")
        print(f"demo            {(took - installed) / 60:.2f} min")
        print(f"fresh to report {took / 60:.2f} min")
        print(f"peak memory     {peak:.0f} MB, all processes together")
        print(f"lockstep        {summary['lockstep_steps_per_second']} steps/s, recorded")


if __name__ == "__main__":
    main()
