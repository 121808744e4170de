"""`iolspi fly`: the whole way on an autopilot, from demonstrations to a vehicle that flies it."""

from __future__ import annotations

import shutil
import socket
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Optional

import typer

from iolspi_ros.cli import app
from iolspi_ros.cli.following import Follower as Watch
from iolspi_ros.cli.following import fresh
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.cli.progress import baseline as yardstick
from iolspi_ros.errors import InputError, check_choice, check_range

if TYPE_CHECKING:
    from iolspi_ros.graph import Graph
    from iolspi_ros.nodes.monitor import Monitor

TASK = "slung_load"
URLS = {"px4": "udpin:127.0.0.1:14540", "ardupilot": "tcp:127.0.0.1:5760", "paparazzi": ""}
AUTOPILOTS = ("embedded", *URLS)

# Of the embedded autopilot: the load's feed, and a gripper that was enabled before it booted.
_EMBEDDED = {
    "px4": ("SIM_LOAD_RATE=20",),
    "ardupilot": ("SIM_LOAD_RATE=20", "GRIP_ENABLE=1", "SERVO9_FUNCTION=28"),
}
_LONGEST = 40.0  # an episode with all that comes between two takes at most [s]
_SLACK = 0.05  # of wall time that an answer may be late by, whatever the speed-up [s]


class Journey(NamedTuple):
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
    taught: str


@app.command(epilog="Example: iolspi fly --autopilot embedded --like px4 --speed-up 4")
def fly(
    autopilot: Annotated[
        str, typer.Option(help=f"Whom to fly: {', '.join(AUTOPILOTS)}.")
    ] = "embedded",
    url: Annotated[
        Optional[str],
        typer.Option(help="Where it is: udpin:HOST:PORT, udpout:…, tcp:… or serial:DEVICE:BAUD."),
    ] = None,
    like: Annotated[str, typer.Option(help="Whom the embedded one imitates.")] = "px4",
    speed_up: Annotated[
        float, typer.Option(help="Times real time, of the embedded one or another simulator.")
    ] = 1.0,
    load: Annotated[
        str, typer.Option(help="The load's swing from its own system (feed), or estimate.")
    ] = "feed",
    demonstration: Annotated[
        int, typer.Option("--set", help="Shipped demonstration set, 1 to 5.")
    ] = 5,
    checkpoint: Annotated[
        Optional[Path],
        typer.Option(help="Begin with what was learned before, instead of demonstrations."),
    ] = None,
    practice: Annotated[
        int, typer.Option(min=0, help="Episodes to fly on the model first, without the autopilot.")
    ] = 500,
    episodes: Annotated[int, typer.Option(help="To fly while learning.")] = 10,
    shown: Annotated[int, typer.Option(help="To fly then, without learning.")] = 13,
    seed: Annotated[int, typer.Option(min=0, help="Of the learner and the starts.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for everything that is left.")] = Path(
        "out/fly"
    ),
) -> None:
    """Fly the slung load on an autopilot over MAVLink, learning as it goes.

    Teaches a learner by demonstrations and on the model, checks the autopilot, takes off, flies
    episodes while it learns and then without, lands, and gives the parameters back. Leaves
    report.html, summary.json, a bag, a .tlog and a checkpoint. Nothing is sent anywhere but to
    the address given. Ctrl-C lands.
    """
    from iolspi_ros import graph, resources
    from iolspi_ros.bags import BagWriter
    from iolspi_ros.nodes.monitor import watching
    from sim_nodes.tasks import make_task

    journey = _journey(
        autopilot, url, like, speed_up, load, demonstration, checkpoint, episodes, shown, seed
    )
    config = resources.find("config", f"{TASK}.yaml")
    vehicle = make_task(TASK, resources.parameters(config, "simulator"), str(config))
    out = fresh(out, "bridge.log")
    domain = graph.isolate()
    console.print(
        f"Flying [bold]{autopilot}[/bold] at {journey.url}. The graph is in "
        f"ROS_DOMAIN_ID={domain}, on this machine only."
    )
    start = time.monotonic()
    if journey.bag and practice:
        journey = _practise(journey, journey.bag, practice, config, out)
    with (
        BagWriter(out / "bag") as recording,
        watching(vehicle, recording) as monitor,
        graph.Graph(out) as nodes,
    ):
        if autopilot == "embedded":
            _start_embedded(nodes, journey)
        try:
            extra = _travel(nodes, monitor, journey, config, out)
        except (InputError, KeyboardInterrupt):
            console.print(f"What there is of it is in {out}: the nodes' logs, a bag, a .tlog.")
            raise
        finally:
            _print_new(out, "warn")
    whole = [episode for episode in monitor.episodes if episode.whole]
    monitor.episodes[:] = whole
    extra["autopilot"] = autopilot if autopilot != "embedded" else f"embedded, like {like}"
    extra |= {"seed": seed, "wall_seconds": round(time.monotonic() - start, 1)}
    _report(out, vehicle, config, monitor.history(min(episodes, len(whole))), extra, journey)


def _journey(
    autopilot: str, url: str | None, like: str, speed_up: float, load: str, demonstration: int,
    checkpoint: Path | None, episodes: int, shown: int, seed: int,
) -> Journey:  # fmt: skip
    from iolspi_ros import resources
    from iolspi_ros.experiments.samplesets import mode_and_corruption
    from msg_bridge.mavlink.profiles import PROFILES

    check_choice("--autopilot", autopilot, AUTOPILOTS)
    check_choice("--like", like, tuple(_EMBEDDED))
    check_choice("--load", load, ("feed", "estimate"))
    check_range("--speed-up", speed_up, 0.1, 20.0)
    check_range("--episodes", episodes, 0, 1e6)
    check_range("--shown", shown, 1, 1e6)
    if autopilot in PROFILES and PROFILES[autopilot].flies_not:
        raise InputError(
            f"--autopilot {autopilot} cannot be flown over MAVLink: {PROFILES[autopilot].flies_not}"
        )
    mode_and_corruption(demonstration)
    bag = None if checkpoint else resources.find("demos", TASK, f"set_{demonstration}")
    if checkpoint and not checkpoint.is_file():
        raise InputError(f"--checkpoint {checkpoint} is not there; allowed: a file")
    place = url or (f"udpin:127.0.0.1:{_free_port()}" if autopilot == "embedded" else "")
    return Journey(
        place or URLS[autopilot], like, speed_up, load, bag, checkpoint, episodes, shown, seed,
        f"demonstration set {demonstration}" if bag else f"what {checkpoint} holds",
    )  # fmt: skip


def _practise(journey: Journey, bag: Path, episodes: int, config: Path, out: Path) -> Journey:
    """Learn from the demonstrations, then online on the model; what is learned is flown."""
    from iolspi_ros.bags import read_demonstration
    from iolspi_ros.core import checkpoint
    from iolspi_ros.experiments.headless import Listener, prepare, train

    world, learner = prepare(TASK, config, journey.seed)
    vehicle, done = world.task, 0
    learner.inform(
        read_demonstration(bag, TASK, vehicle.joints).transitions(2 * len(vehicle.joints))
    )
    with bar("practising on the model [episodes]", episodes) as show:

        def ended(score: float, reward: float, terminated: bool) -> None:
            nonlocal done
            done += 1
            show(done)

        train(world, learner, episodes, Listener(on_episode=ended))
    path = out / "practised.npz"
    checkpoint.save(path, learner, TASK)
    taught = f"{journey.taught} and {episodes} episodes on the model"
    return journey._replace(bag=None, checkpoint=path, taught=taught)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _start_embedded(nodes: Graph, journey: Journey) -> None:
    kind, _, place = journey.url.partition(":")
    if kind not in ("udpin", "udpout"):
        raise InputError(f"--url {journey.url}: allowed for the embedded autopilot: udpin, udpout")
    there = {"udpin": "udpout", "udpout": "udpin"}[kind]
    values = [part for value in _EMBEDDED[journey.like] for part in ("--param", value)]
    nodes.run(
        "sitl", "iolspi_ros", "sitl", "--like", journey.like, "--url", f"{there}:{place}",
        "--speed-up", str(journey.speed_up), "--ready-after", "5.0", *values,
    )  # fmt: skip


def _travel(
    nodes: Graph, monitor: Monitor, journey: Journey, config: Path, out: Path
) -> dict[str, Any]:
    """Check, teach, fly, show, land."""
    from iolspi_ros.bags import read_card

    watch = Watch(nodes, monitor)
    bridge = {
        "url": journey.url, "autostart": "configure", "log": str(out.resolve() / "flight.tlog"),
        "real_time_factor": float(journey.speed_up), "load_source": journey.load,
        "seed": journey.seed,
        "action_timeout": 0.1 + _SLACK * max(journey.speed_up, 1.0),
    }  # fmt: skip
    nodes.start("bridge", bridge, config)
    _check(watch, out)
    keep = out.resolve() / "checkpoint.npz"
    learner: dict[str, Any] = {
        "seed": journey.seed, "checkpoint": str(keep), "background": True, "simulator_timeout": 0.0
    }  # fmt: skip
    if journey.checkpoint:
        shutil.copy(journey.checkpoint, keep)
    nodes.start("learner", learner | {"resume": journey.checkpoint is not None}, config)
    watch.wait(monitor.connected, 60.0, "the start of bridge and learner")
    if journey.bag:
        monitor.listen_to_samples()
        replay = {"bags": [str(journey.bag)], "source": "bag", "listeners": 2}
        nodes.start("demonstrator", replay | {"learner_timeout": 60.0}, config)
        samples = int(read_card(journey.bag).get("samples", 1))
        watch.follow("replaying demonstrations", samples, lambda: len(monitor.demonstrated), 60.0)
        watch.follow("learning offline", 1, lambda: monitor.updates, 120.0)
    return _fly(watch, monitor, journey)


def _check(watch: Watch, out: Path) -> None:
    """Wait for the preflight, and print its list as it grows."""
    console.print("Preflight:")

    def passed() -> bool:
        _print_new(out, "preflight: ")
        return "preflight: passed" in (out / "bridge.log").read_text(errors="replace")

    watch.wait(passed, 150.0, "the preflight")


_printed: dict[Path, int] = {}


def _print_new(out: Path, mark: str) -> None:
    """Print the bridge's lines with a mark in them that were not printed before."""
    log = out / "bridge.log"
    text = log.read_text(errors="replace") if log.is_file() else ""
    lines = text[_printed.get(log, 0) :].splitlines(keepends=True)
    for line in lines:
        if not line.endswith("\n"):
            break
        _printed[log] = _printed.get(log, 0) + len(line)
        if mark.lower() in line.lower():
            console.print("  " + line.split("[bridge]: ")[-1].removeprefix(mark).rstrip())


def _fly(watch: Watch, monitor: Monitor, journey: Journey) -> dict[str, Any]:
    monitor.change_state("bridge", "activate")
    pace = _LONGEST / journey.speed_up
    if journey.episodes:
        watch.follow(
            "learning online [episodes]", journey.episodes, lambda: len(monitor.scores),
            120.0 + pace * journey.episodes,
        )  # fmt: skip
        monitor.trigger("/learner/save")
    monitor.switch("/learner/learn", on=False)
    learned = len(monitor.scores)
    monitor.set_parameters("bridge", order="sweep", episodes=journey.shown)
    monitor.trigger("/bridge/reset")
    watch.follow(
        "showing [episodes]", journey.shown, lambda: len(monitor.scores) - learned,
        120.0 + pace * journey.shown,
    )  # fmt: skip
    monitor.wait_for_ends(learned + journey.shown, 7.0)
    watch.wait(
        lambda: monitor.conditions.get("bridge", {}).get("phase") == "down", 120.0, "landing"
    )
    said = monitor.conditions["bridge"]
    kept = ("load", "episodes abandoned", "envelope left", "envelope interventions")
    return {name.replace(" ", "_"): said.get(name, "") for name in kept}


def _report(
    out: Path, vehicle: Any, config: Path, history: Any, extra: dict[str, Any], journey: Journey
) -> None:
    """Compute what needs no graph, and write the pages."""
    from iolspi_ros.experiments.evaluate import succeeded
    from iolspi_ros.experiments.headless import prepare
    from iolspi_ros.report import run as report

    features = prepare(TASK, config, 0)[1].features
    shown = report.whole(history.shown)
    if not shown:
        raise InputError("no episode shown was recorded whole; is the machine very busy? Try again")
    extra["shown_success_fraction"] = float(succeeded(vehicle, shown).mean())
    lead = (
        f"An autopilot ({extra['autopilot']}) was flown over MAVLink by a learner that was taught "
        f"by {journey.taught}. Rewards are the task's; where a load came down is what its own "
        "system reported, or the parabola where there is none."
    )
    best = yardstick(vehicle)
    with console.status("drawing …"):
        report.finish(
            out, "Flying the slung load on an autopilot", lead, vehicle, features, history, best,
            extra,
        )  # fmt: skip
    console.print(
        f"\n{extra['shown_success_fraction']:.0%} of the {len(shown)} episodes shown "
        f"{vehicle.success}. The envelope was left {extra['envelope_left']} times. "
        f"That took {extra['wall_seconds']:.0f} s.\nLook at [bold]{out / 'report.html'}[/bold]"
    )
