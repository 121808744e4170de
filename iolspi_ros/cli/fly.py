"""`iolspi fly`: the whole way on an autopilot, from demonstrations to a vehicle that flies it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.flight_plan import (
    TASK,
    FlightPlan,
    Warnings,
    free_port,
    practise,
    start_embedded,
    travel,
)
from iolspi_ros.cli.progress import baseline, console
from iolspi_ros.errors import InputError, check_choice, check_range
from iolspi_ros.folders import new_folder

URLS = {"px4": "udpin:127.0.0.1:14540", "ardupilot": "tcp:127.0.0.1:5760", "paparazzi": ""}
AUTOPILOTS = ("embedded", *URLS)


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
    from iolspi_ros import graph

    plan = _plan(
        autopilot, url, like, speed_up, load, demonstration, checkpoint, episodes, shown, seed
    )
    vehicle = autopilot if autopilot != "embedded" else f"embedded, like {like}"
    domain = graph.isolate()  # or a refusal, before there is a folder
    console.print(
        f"Flying [bold]{vehicle}[/bold] at {plan.url}. The graph is in "
        f"ROS_DOMAIN_ID={domain}, on this machine only."
    )
    _fly(plan, practice, new_folder(out), vehicle)


def _fly(plan: FlightPlan, practice: int, out: Path, autopilot: str) -> None:
    from iolspi_ros import graph, resources
    from iolspi_ros.bags import BagWriter
    from iolspi_ros.nodes.monitor import watching
    from sim_nodes.tasks import make_task

    config = resources.find("config", f"{TASK}.yaml")
    vehicle = make_task(TASK, resources.parameters(config, "simulator"), str(config))
    start = time.monotonic()
    if plan.bag and practice:
        plan = practise(plan, plan.bag, practice, config, out)
    with (
        BagWriter(out / "bag") as recording,
        watching(vehicle.description, recording) as monitor,
        graph.Graph(out) as nodes,
    ):
        warnings = Warnings(monitor)
        if autopilot.startswith("embedded"):
            start_embedded(nodes, plan)
        try:
            extra = travel(nodes, monitor, plan, config, out)
        except (InputError, KeyboardInterrupt):
            console.print(f"What there is of it is in {out}: the nodes' logs, a bag, a .tlog.")
            raise
        finally:
            warnings.show()
    whole = [episode for episode in monitor.episodes if episode.whole]
    monitor.episodes[:] = whole
    extra["autopilot"] = autopilot
    extra |= {"seed": plan.seed, "wall_seconds": round(time.monotonic() - start, 1)}
    history = monitor.history(min(plan.episodes, len(whole)))
    _report(out, vehicle, config, history, extra, plan)


def _plan(
    autopilot: str, url: str | None, like: str, speed_up: float, load: str, demonstration: int,
    checkpoint: Path | None, episodes: int, shown: int, seed: int,
) -> FlightPlan:  # fmt: skip
    from iolspi_ros import resources
    from iolspi_ros.experiments.samplesets import mode_and_corruption
    from msg_bridge.mavlink.profiles import PROFILES
    from sim_nodes.autopilot.firmware import FIRMWARES

    check_choice("--autopilot", autopilot, AUTOPILOTS)
    check_choice("--like", like, tuple(FIRMWARES))
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
    place = url or (f"udpin:127.0.0.1:{free_port()}" if autopilot == "embedded" else "")
    return FlightPlan(
        place or URLS[autopilot], like, speed_up, load, bag, checkpoint, episodes, shown, seed,
        f"demonstration set {demonstration}" if bag else f"what {checkpoint} holds",
    )  # fmt: skip


def _report(
    out: Path, vehicle: Any, config: Path, history: Any, extra: dict[str, Any], plan: FlightPlan
) -> None:
    """Compute what needs no graph, and write the pages."""
    from iolspi_ros.experiments.headless import prepare
    from iolspi_ros.report import run as report

    shown = report.whole(history.shown)
    if not shown:
        raise InputError("no episode shown was recorded whole; is the machine very busy? Try again")
    subject = report.Subject(vehicle, prepare(TASK, config, 0).learner, history, baseline(vehicle))
    extra["shown_success_fraction"] = report.share_shown(subject)
    lead = (
        f"An autopilot ({extra['autopilot']}) was flown over MAVLink by a learner that was "
        f"pretrained on {plan.pretrained_on}. Rewards are the task's; where a load came down is "
        "what its own system reported, or the parabola where there is none."
    )
    with console.status("drawing …"):
        report.finish(out, "Flying the slung load on an autopilot", lead, subject, extra)
    console.print(
        f"\n{extra['shown_success_fraction']:.0%} of the {len(shown)} episodes shown "
        f"{vehicle.description.success}. The envelope was left {extra['envelope_left']} times. "
        f"That took {extra['wall_seconds']:.0f} s.\nLook at [bold]{out / 'report.html'}[/bold]"
    )
