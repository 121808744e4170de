"""Kill a learning graph again and again, and compare what it learned with a run left alone.

    nice .venv/bin/python benchmarks/kills.py --kills 100 [--two]

Simulator and learner in one process, in lockstep, or with --two each in its own, of which only the
learner's is killed; each life ends after a random time by a random
one of SIGKILL, SIGTERM, SIGINT, SIGHUP and SIGQUIT, and the next resumes from the checkpoint. In
the end weights, samples kept, random generators and the vehicle must be the same, bit by bit.
"""

from __future__ import annotations

import argparse
import collections
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from iolspi_ros.graph import isolate
from iolspi_ros.saving import checkpoint

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT)
ACTING, DONE = "acting on", "done: "


def start(folder: Path, name: str, node: str, more: list[str]) -> subprocess.Popen[bytes]:
    """Start a node; its checkpoint is FOLDER/NAME.npz, its words are in FOLDER/NAME.log."""
    parameters = {"seed": 3}
    if node != "simulator":
        parameters |= {
            "checkpoint": folder / f"{name}.npz", "resume": "true", "update_interval": 500,
            "wait_for_demonstrations": "false", "checkpoint_updates": 2,
        }  # fmt: skip
    command = [sys.executable, "-m", "iolspi_ros.nodes.start", node, "--ros-args", *more]
    for key, value in parameters.items():
        command += ["-p", f"{key}:={value}"]
    log = (folder / f"{name}.log").open("ab")
    return subprocess.Popen(command, stdout=log, stderr=log)


def until(
    process: subprocess.Popen[bytes], log: Path, words: str, seconds: float, after: int = 0
) -> bool:
    """Wait until the graph has said something, or some seconds; whether it has."""
    end = time.monotonic() + seconds
    while time.monotonic() < end and process.poll() is None:
        if words in log.read_text()[after:]:
            return True
        time.sleep(0.01)
    return words in log.read_text()[after:]


def live_and_die(
    folder: Path, name: str, node: str, kills: int, rng: random.Random, more: list[str]
) -> collections.Counter[str]:
    """Lives of a node until all episodes are flown; how each ended."""
    ends: collections.Counter[str] = collections.Counter()
    log = folder / f"{name}.log"
    log.touch()
    slowest: list[tuple[float, str]] = []
    while True:
        said = len(log.read_text())
        process = start(folder, name, node, more)
        done = False
        if sum(ends.values()) >= kills:
            done = until(process, log, DONE, 600.0)
        elif rng.random() < 0.9 and until(process, log, ACTING, 60.0, said):  # else at the start
            done = until(process, log, DONE, rng.uniform(0.0, 2.5))
        else:
            time.sleep(rng.uniform(0.0, 2.5))
        number = signal.SIGTERM if done else rng.choice(SIGNALS)
        process.send_signal(number)
        asked = time.monotonic()
        status = process.wait(20.0)
        took = time.monotonic() - asked
        slowest.append((took, number.name))
        assert status == (-signal.SIGKILL if number == signal.SIGKILL else 0), (
            number,
            status,
            log.read_text(),
        )
        assert took < 10.0, f"{number.name} took {took:.1f} s"
        if done:
            print(f"{name}: slowest end {max(slowest)}")
            return ends
        ends[number.name] += 1


def fly(
    folder: Path, name: str, kills: int, rng: random.Random, chosen: argparse.Namespace
) -> collections.Counter[str]:
    """All episodes, with so many kills; how each life ended."""
    episodes = ["-p", f"episodes:={chosen.episodes}"]
    if not chosen.two:
        return live_and_die(folder, name, "graph", kills, rng, [*episodes, *chosen.more])
    simulator = start(folder, name, "simulator", [*episodes, "-p", "resend_after:=0.02"])
    try:
        return live_and_die(folder, name, "learner", kills, rng, chosen.more)
    finally:
        simulator.kill()
        simulator.wait()


def same(one: Path, other: Path) -> list[str]:
    """What differs between two checkpoints."""
    a, b = checkpoint.read(one), checkpoint.read(other)
    differing = [
        name for name in a.arrays.keys() | b.arrays.keys()
        if not np.array_equal(a.arrays[name], b.arrays[name], equal_nan=True)
    ]  # fmt: skip
    return differing + [k for k in a.about if k != "run" and a.about[k] != b.about[k]]


def main() -> int:
    """Run both, and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--episodes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--two", action="store_true", help="kill the learner alone")
    parser.add_argument("more", nargs="*", help="parameters, as in --ros-args")
    chosen = parser.parse_args()
    isolate()
    with tempfile.TemporaryDirectory(prefix="iolspi-kills-") as place:
        folder, rng = Path(place), random.Random(chosen.seed)
        begin = time.monotonic()
        fly(folder, "alone", 0, rng, chosen)
        alone = time.monotonic() - begin
        ends = fly(folder, "killed", chosen.kills, rng, chosen)
        differing = same(folder / "alone.npz", folder / "killed.npz")
        left = sorted(path.name for path in folder.iterdir() if path.suffix == ".npz")
        resumed = (folder / "killed.log").read_text().count("resumed from")
        step = checkpoint.read(folder / "alone.npz").about["parts"]["learner"]["step"]
    print(f"left alone: {step} steps in {alone:.1f} s; killed {sum(ends.values())} times")
    print(f"({', '.join(f'{n} {name}' for name, n in sorted(ends.items()))}), resumed {resumed}")
    print(f"times, in {time.monotonic() - begin - alone:.0f} s. Checkpoints: {', '.join(left)}")
    print(f"different: {', '.join(differing)}" if differing else "the same, bit by bit")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
