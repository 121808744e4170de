"""A graph that runs for long, while messages are lost and falsified, nodes killed, disks full.

A clean run and a harmed one, both in lockstep with the same seed. What is asked: does the harmed
one learn as well, does every node come back with what it had, and do memory and files stay as they
are?
"""

from __future__ import annotations

import random
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from scipy import stats
from std_msgs.msg import Float64MultiArray

from iolspi_ros import graph, qos, resources, runtime, wire
from iolspi_ros.bench.relay import VEHICLE
from iolspi_ros.bench.rows import Row, at_most
from iolspi_ros.errors import InputError
from iolspi_ros.saving import checkpoint
from sim_nodes.tasks import task_class

KILL_EVERY = 60.0
"""Seconds of wall time between two kills."""
FULL = 25.0
"""Seconds of wall time for which the learner's disk is full, at least: more than between
checkpoints."""
SAVE_EVERY = 10.0
"""Seconds of wall time between two checkpoints."""
RESEND = 0.01
"""Seconds after which a lost message is sent again."""
SETTLED = 60.0
"""Seconds that a process takes until its memory is what it needs."""
WINDOW = 60.0
"""Seconds of which the least counts: an update takes up to 30 MB, and gives them back."""
PEERS = 40.0
"""Memory [MB] that a node may need more where others are killed: the first ones that come back take
up to 20, for which Fast DDS keeps room, and those after them next to nothing."""
LAST = 0.25
"""Share of the episodes, the last ones, by which a run is judged."""
PATIENCE = 120.0
"""Seconds without an episode after which a run counts as stuck, and seconds with a full disk and no
word of it after which there will be none."""
KILLED, DISK = ("simulator", "learner", "relay"), "disk"
FILES = ("memory [MB]", "open files")


@dataclass
class Run:
    """What was seen of one run.

    Attributes
    ----------
    scores : list of float
        Sum of rewards of each episode, as the vehicle itself said them.
    steps : int
    kills : Counter
        By node.
    vitals : dict
        Of each node and life: rows of wall time [s], memory [MB], open files.
    faults : str
        What the relay did, in words.
    full, complaints : int
        How often the learner's disk was full for `FULL`, and how often it said so meanwhile.
    last_error : float
        When the learner last said that something is wrong [s], of wall time.
    """

    scores: list[float] = field(default_factory=list)
    steps: int = 0
    kills: Counter[str] = field(default_factory=Counter)
    vitals: dict[tuple[str, int], list[tuple[float, ...]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    faults: str = ""
    full: int = 0
    complaints: int = 0
    last_error: float = 0.0


def fly(
    folder: Path, task: str, steps: int, seed: int, show: Callable[[int], None],
    *, harmed: bool = False, kill_every: float = KILL_EVERY,
) -> Run:  # fmt: skip
    """Let a graph run for so many steps; its logs and its checkpoint stay in the folder.

    Raises
    ------
    InputError
        When a node ends by itself, or no episode ends for long.
    """
    file, run, rng = resources.config(task), Run(), random.Random(seed)
    learner = {
        "seed": seed, "checkpoint": str(folder / "checkpoint.npz"), "resume": True,
        "wait_for_demonstrations": False, "vehicle_timeout": 0.0, "checkpoint_seconds": SAVE_EVERY,
    }  # fmt: skip
    vehicle = VEHICLE if harmed else ""
    with graph.Graph(folder) as nodes, runtime.session(), _listening(run, vehicle) as spin:
        if harmed:
            nodes.run("relay", "iolspi_ros.bench.relay", str(seed))
        simulator = {"task": task, "seed": seed, "resend_after": RESEND}
        nodes.start("simulator", simulator, file, namespace=vehicle)
        nodes.start("learner", learner, file)
        harm = Harm(nodes, run, rng, kill_every)
        heard, last = 0, time.monotonic()
        while run.steps < steps:
            runtime.check()
            spin()
            now = time.monotonic()
            nodes.check()
            if len(run.scores) > heard:
                heard, last = len(run.scores), now
                show(run.steps)
            elif now - last > PATIENCE:
                raise InputError(f"no episode ended for {PATIENCE:g} s; the logs are in {folder}")
            if harmed:
                harm.look(now)
        harm.stop()
    with suppress(OSError):
        run.faults = (folder / "relay.log").read_text().strip().rpartition("relay: ")[2]
    checkpoint.read(folder / "checkpoint.npz")  # whole
    return run


class Harm:
    """Kills nodes and fills the learner's disk: one of these, drawn, every so many seconds.

    Parameters
    ----------
    nodes : Graph
    run : Run
        Where it is written down.
    rng : random.Random
    every : float
        Seconds of wall time.
    """

    def __init__(self, nodes: graph.Graph, run: Run, rng: random.Random, every: float) -> None:
        self._nodes, self._run, self._rng, self._every = nodes, run, rng, every
        self._next, self._full_since = time.monotonic() + every, 0.0

    def look(self, now: float) -> None:
        """Do what is due."""
        if self._full_since:
            said = self._run.last_error > self._full_since
            if now > self._full_since + (FULL if said else PATIENCE):
                self._run.full += 1
                self._run.complaints += said
                self.stop()
        elif now > self._next and self._heard("learner"):  # it looks first whether it can save
            # Without a vehicle it has nothing to save, and nothing to complain of.
            disk = (DISK,) if self._heard("simulator") else ()
            self._do(self._rng.choice((*KILLED, *disk)), now)

    def _heard(self, name: str) -> bool:
        """Whether the node of now has begun."""
        return bool(self._run.vitals.get((name, self._run.kills[name])))

    def _do(self, what: str, now: float) -> None:
        self._next = now + self._every
        if what == DISK:
            self._nodes.limit_files("learner", 0)
            self._full_since = now
        else:
            self._nodes.kill(what)
            self._run.kills[what] += 1
            self._nodes.restart(what)

    def stop(self) -> None:
        """Let the learner write again."""
        if self._full_since:
            self._nodes.limit_files("learner", None)
            self._full_since, self._next = 0.0, time.monotonic() + self._every


class Returns:
    """Sums up the rewards of episodes that were heard whole, however often each was sent."""

    def __init__(self) -> None:
        self._key, self._heard, self._sum = (-1, -1), 0, 0.0

    def take(self, episode: int, step: int, reward: float, last: bool) -> float | None:
        """Return of the episode that ends with this row; None when it goes on, or has holes."""
        if (episode, step) == self._key:
            return None
        if step == 0 or episode != self._key[0]:
            self._heard, self._sum = 0, 0.0
        self._key = (episode, step)
        self._heard += step > 0
        self._sum += reward
        return self._sum if last and self._heard == step else None


@contextmanager
def _listening(run: Run, vehicle: str) -> Iterator[Callable[[], None]]:
    """Hear the vehicle's rewards, from before anybody has falsified them, and everyone's vitals."""
    rows, returns = wire.RewardRows(), Returns()
    node = rclpy.create_node("soak")

    def on_reward(message: Any) -> None:
        episode, step, _, _, reward, terminated, truncated, *_ = rows.read(message)
        found = returns.take(int(episode), int(step), reward, bool(terminated or truncated))
        if found is not None:
            run.scores.append(found)
            run.steps += int(step)

    def on_vitals(message: Any) -> None:
        for status in message.status:
            name = status.name.split(":")[0].split("/")[-1]
            if name == "learner" and status.level == DiagnosticStatus.ERROR:
                run.last_error = time.monotonic()
            said = {pair.key: pair.value for pair in status.values}
            if all(key in said for key in FILES):
                numbers = (time.monotonic(), *(float(said[key]) for key in FILES))
                run.vitals[name, run.kills[name]].append(numbers)

    node.create_subscription(Float64MultiArray, f"{vehicle}/reward", on_reward, qos.RECORDING)
    node.create_subscription(DiagnosticArray, "/diagnostics", on_vitals, qos.OUTGOING)
    try:
        with closing(runtime.Loop(node)) as loop:
            yield lambda: loop.once(0.2)
    finally:
        node.destroy_node()


def measure(
    folder: Path, task: str, hours: float, seed: int, show: Callable[[int], None]
) -> list[Row]:
    """Fly both runs, and compare.

    Parameters
    ----------
    folder : Path
        For logs and checkpoints.
    task : str
    hours : float
        Of vehicle time, of both runs together.
    seed : int
    show : callable
        Takes the steps flown so far.
    """
    steps = total(task, hours) // 2
    clean, harmed = folder / "clean", folder / "harmed"
    for place in (clean, harmed):
        place.mkdir()
    return rows(
        fly(clean, task, steps, seed, show),
        fly(harmed, task, steps, seed, lambda done: show(steps + done), harmed=True),
    )


def total(task: str, hours: float) -> int:
    """Steps in so many hours of vehicle time."""
    return round(hours * 3600.0 / task_class(task).description.sampling_time)


def rows(clean: Run, harmed: Run) -> list[Row]:
    """Figures of both runs."""
    a, b = _last(clean.scores), _last(harmed.scores)
    lost = (a.mean() - b.mean()) / max(abs(a.mean()), 1e-12)
    spread = 1.96 * np.hypot(a.std() / np.sqrt(len(a)), b.std() / np.sqrt(len(b)))
    spread /= max(abs(a.mean()), 1e-12)
    found = [
        Row("clean: steps flown", clean.steps, ""), Row("harmed: steps flown", harmed.steps, ""),
        Row("kills", harmed.kills.total(), f"({dict(harmed.kills)})"),
        Row("faults", 0.0, harmed.faults),
        Row("learner's disk full", harmed.full, f"times for {FULL:g} s"),
        Row("said by the learner", harmed.complaints, "of these", "all",
            harmed.complaints == harmed.full),
        Row("clean: return of an episode, the last quarter", float(a.mean()), ""),
        Row("harmed: the same", float(b.mean()), ""),
        Row("return lost by the harm", 100 * lost, f"± {100 * spread:.2g} %", "at most 2",
            bool(np.isfinite(spread) and lost <= 0.02 + spread)),
    ]  # fmt: skip
    for run, name in ((clean, "clean"), (harmed, "harmed")):
        for node in sorted({key[0] for key in run.vitals}):
            lives = _lives(run, node)
            for column, unit, most in ((1, "MB/h", 1.0), (2, "files/h", 0.5)):
                if run is harmed and column == 1:
                    found += _level(node, lives, _lives(clean, node))
                elif (found_slope := slope(lives, column)) is not None:
                    middle, width = found_slope
                    about = f"{name}: {node} grows"
                    row = at_most(about, middle - width, f"{unit} (± {width:.2g})", most)
                    found.append(Row(row.name, middle, row.unit, row.goal, row.holds))
    return found


def _lives(run: Run, node: str) -> list[np.ndarray]:
    return [np.array(rows) for (who, _), rows in run.vitals.items() if who == node]


def _level(node: str, harmed: list[np.ndarray], clean: list[np.ndarray]) -> list[Row]:
    """The most memory that a life needs, where there are lives long enough."""
    most, usual = (
        max((float(parts.max()) for life in lives if len(parts := least(life, 1))), default=None)
        for lives in (harmed, clean)
    )
    if most is None:
        return []
    name = f"harmed: {node}, the most that a life needs"
    return [Row(name, most, "MB") if usual is None else at_most(name, most, "MB", usual + PEERS)]


def least(life: np.ndarray, column: int) -> np.ndarray:
    """The least of a number in each whole `WINDOW` of a life after its first `SETTLED` seconds."""
    windows = ((life[:, 0] - life[0, 0] - SETTLED) // WINDOW).astype(int)
    return np.array([
        life[windows == window, column].min()
        for window in range(windows[-1])  # the last is not over
        if (windows == window).any()
    ])  # fmt: skip


def slope(lives: list[np.ndarray], column: int) -> tuple[float, float] | None:
    """How fast a number of some lives grows, and half its 95 % interval, per hour.

    What counts is `least`, of lives with three of these; a life's own level is taken off.
    """
    times, values = [], []
    for life in lives:
        parts = least(life, column)
        if len(parts) > 2:
            at = WINDOW * np.arange(len(parts))
            times.append(at - at.mean())
            values.append(parts - parts.mean())
    if not times:
        return None
    if not np.concatenate(values).any():
        return 0.0, 0.0  # it never changed, which leaves nothing to fit
    fit = stats.linregress(np.concatenate(times) / 3600.0, np.concatenate(values))
    return float(fit.slope), float(1.96 * fit.stderr)


def _last(scores: list[float]) -> np.ndarray:
    return np.array(scores[-max(int(LAST * len(scores)), 2) :])
