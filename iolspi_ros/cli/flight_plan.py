"""What `iolspi fly` flies, and how: the graph from preflight to landing."""

from __future__ import annotations

import shutil
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from iolspi_ros.cli.following import Follower
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.errors import InputError
from sim_nodes.autopilot.firmware import WITH_GRIPPER

if TYPE_CHECKING:
    from iolspi_ros.graph import Graph
    from iolspi_ros.nodes.monitor import Monitor

TASK = "slung_load"
_LOAD_RATE = 20.0  # of the embedded autopilot's load [Hz]
_LONGEST = 40.0  # an episode with all that comes between two takes at most [s]
_SLACK = 0.05  # of wall time that an answer may be late by, whatever the speed-up [s]
_WARN = 30  # rcl_interfaces/msg/Log


class FlightPlan(NamedTuple):
    """What is to be flown."""

    url: str
    like: str
    speed_up: float
    load: str
    bag: Path | None
    checkpoint: Path | None
    episodes: int
    shown: int
    seed: int
    pretrained_on: str


def free_port() -> int:
    """A UDP port of this machine that nobody has."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def practise(plan: FlightPlan, bag: Path, episodes: int, config: Path, out: Path) -> FlightPlan:
    """Learn from the demonstrations, then online on the model; what is learned is flown."""
    from iolspi_ros.bags import read_demonstration
    from iolspi_ros.core import checkpoint
    from iolspi_ros.experiments.headless import Listener, prepare, train

    world, learner, name = prepare(TASK, config, plan.seed)
    done = 0
    learner.pretrain(read_demonstration(bag, learner.task).transitions())
    with bar("practising on the model [episodes]", episodes) as show:

        def ended(score: float, reward: float, terminated: bool) -> None:
            nonlocal done
            done += 1
            show(done)

        train(world, learner, episodes, Listener(on_episode=ended))
    path = out / "practised.npz"
    checkpoint.save(path, learner, name)
    pretrained_on = f"{plan.pretrained_on} and {episodes} episodes on the model"
    return plan._replace(bag=None, checkpoint=path, pretrained_on=pretrained_on)


def start_embedded(nodes: Graph, plan: FlightPlan) -> None:
    """Start the embedded autopilot at the other end of the plan's address."""
    kind, _, place = plan.url.partition(":")
    if kind not in ("udpin", "udpout"):
        raise InputError(f"--url {plan.url}: allowed for the embedded autopilot: udpin, udpout")
    there = {"udpin": "udpout", "udpout": "udpin"}[kind]
    booted = {"SIM_LOAD_RATE": _LOAD_RATE} | WITH_GRIPPER[plan.like]
    values = [part for name, value in booted.items() for part in ("--param", f"{name}={value}")]
    nodes.run(
        "sitl", "iolspi_ros", "sitl", "--like", plan.like, "--url", f"{there}:{place}",
        "--speed-up", str(plan.speed_up), "--ready-after", "5.0", *values,
    )  # fmt: skip


class Warnings:
    """What the bridge warns of, from /rosout.

    Parameters
    ----------
    monitor : Monitor
    """

    def __init__(self, monitor: Monitor) -> None:
        from rcl_interfaces.msg import Log

        from iolspi_ros import qos

        self._said: list[str] = []
        monitor.create_subscription(Log, "/rosout", self._on_log, qos.REPORTS)

    def _on_log(self, message: Any) -> None:
        if message.name == "bridge" and message.level >= _WARN:
            self._said.append(message.msg)

    def show(self) -> None:
        """Print what was not printed before."""
        for text in self._said:
            console.print(f"  {text}", markup=False)
        self._said.clear()


def travel(
    nodes: Graph, monitor: Monitor, plan: FlightPlan, config: Path, out: Path
) -> dict[str, Any]:
    """Check, teach, fly, show, land.

    Returns
    -------
    dict of str to str
        What the bridge says of the flight in the end, for the summary.
    """
    follower = Follower(nodes, monitor)
    bridge = {
        "url": plan.url, "autostart": "configure", "log": str(out.resolve() / "flight.tlog"),
        "real_time_factor": float(plan.speed_up), "load_source": plan.load,
        "seed": plan.seed,
        "action_timeout": 0.1 + _SLACK * max(plan.speed_up, 1.0),
    }  # fmt: skip
    nodes.start("bridge", bridge, config)
    _check(follower, monitor)
    keep = out.resolve() / "checkpoint.npz"
    learner: dict[str, Any] = {
        "seed": plan.seed, "checkpoint": str(keep), "background": True, "vehicle_timeout": 0.0
    }  # fmt: skip
    if plan.checkpoint:
        shutil.copy(plan.checkpoint, keep)
    nodes.start("learner", learner | {"resume": plan.checkpoint is not None}, config)
    follower.wait(monitor.connected, 60.0, "the start of bridge and learner")
    if plan.bag:
        _teach(nodes, follower, monitor, plan.bag, config)
    _learn(follower, monitor, plan)
    return _show(follower, monitor, plan)


def _check(follower: Follower, monitor: Monitor) -> None:
    """Wait for the preflight, and print its list as it grows."""
    from msg_bridge.mavlink.node import PREFLIGHT

    console.print("Preflight:")
    printed: set[str] = set()

    def passed() -> bool:
        found = monitor.conditions.get(PREFLIGHT, {})
        for name, value in found.items():
            if name not in printed and name != "result":
                printed.add(name)
                console.print(f"  {name}: {value}", markup=False)
        return found.get("result") == "passed"

    follower.wait(passed, 150.0, "the preflight")


def _teach(nodes: Graph, follower: Follower, monitor: Monitor, bag: Path, config: Path) -> None:
    from iolspi_ros.bags import read_card

    monitor.listen_to_samples()
    replay = {"bags": [str(bag)], "source": "bag", "listeners": 2}
    nodes.start("demonstrator", replay | {"learner_timeout": 60.0}, config)
    samples = int(read_card(bag).get("samples", 1))
    follower.follow("replaying demonstrations", samples, lambda: len(monitor.demonstrated), 60.0)
    follower.follow("learning offline", 1, lambda: monitor.updates, 120.0)


def _learn(follower: Follower, monitor: Monitor, plan: FlightPlan) -> None:
    """Take off, and fly episodes while learning."""
    monitor.change_state("bridge", "activate")
    if plan.episodes:
        follower.follow(
            "learning online [episodes]", plan.episodes, lambda: len(monitor.scores),
            120.0 + _LONGEST / plan.speed_up * plan.episodes,
        )  # fmt: skip
        monitor.trigger("/learner/save")


def _show(follower: Follower, monitor: Monitor, plan: FlightPlan) -> dict[str, Any]:
    """Fly episodes without learning, and land."""
    monitor.switch("/learner/learn", on=False)
    learned = len(monitor.scores)
    monitor.set_parameters("bridge", order="sweep", episodes=plan.shown)
    monitor.trigger("/bridge/reset")
    follower.follow(
        "showing [episodes]", plan.shown, lambda: len(monitor.scores) - learned,
        120.0 + _LONGEST / plan.speed_up * plan.shown,
    )  # fmt: skip
    monitor.wait_for_ends(learned + plan.shown, 7.0)
    follower.wait(
        lambda: monitor.conditions.get("bridge", {}).get("phase") == "down", 120.0, "landing"
    )
    said = monitor.conditions["bridge"]
    kept = ("load", "episodes abandoned", "envelope left", "envelope interventions")
    return {name.replace(" ", "_"): said.get(name, "") for name in kept}
