"""`iolspi fly`: the whole way on an autopilot, from demonstrations to a vehicle that flies it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.flight_plan import (
    AUTOPILOTS,
    MODELS,
    TASKS,
    FlightPlan,
    assignments,
    describe,
    make_plan,
    practise,
)
from iolspi_ros.cli.progress import console, so_far
from iolspi_ros.errors import InputError
from iolspi_ros.folders import check_free, new_folder


@app.command(epilog="Example: iolspi fly --autopilot embedded --like px4 --speed-up 4")
def fly(
    task: Annotated[str, typer.Option(help=f"What to fly: {', '.join(TASKS)}.")] = TASKS[0],
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
    practise_on: Annotated[
        str,
        typer.Option(
            help="A model that answers as late and is braked as the autopilot, or the ideal one: "
            f"{', '.join(MODELS)}."
        ),
    ] = MODELS[0],
    episodes: Annotated[int, typer.Option(help="To fly while learning.")] = 10,
    shown: Annotated[int, typer.Option(help="To fly then, without learning.")] = 13,
    seed: Annotated[int, typer.Option(min=0, help="Of the learner and the starts.")] = 0,
    bridge: Annotated[
        Optional[list[str]],
        typer.Option(help="NAME=VALUE of a parameter of the bridge, such as release=servo."),
    ] = None,
    plan: Annotated[
        bool, typer.Option("--plan", help="Only say what would be set and sent; send nothing.")
    ] = False,
    restore: Annotated[
        bool,
        typer.Option(
            "--restore",
            help="Fly nothing: show what autopilots' parameters were before, and give them back.",
        ),
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for everything that is left.")] = Path(
        "out/fly"
    ),
) -> None:
    """Fly a slung load, in one axis or two, on an autopilot over MAVLink, learning as it goes.

    Teaches a learner by demonstrations and on the model, checks the autopilot, takes off, flies
    episodes while it learns and then without, lands, and gives the parameters back. Leaves
    report.html, summary.json, a bag, a .tlog and a checkpoint. Nothing is sent anywhere but to
    the address given. Ctrl-C lands.
    """
    from iolspi_ros import graph
    from iolspi_ros.cli import flight_parameters

    if restore:
        raise typer.Exit(flight_parameters.restore(url, assignments(bridge or [])))
    wanted = make_plan(
        task, autopilot, url, like, speed_up, load, demonstration, checkpoint, practice,
        practise_on, episodes, shown, seed, bridge or [],
    )  # fmt: skip
    if plan:
        for line in describe(wanted):
            console.print(line, markup=False)
        return
    check_free(out)
    domain = graph.isolate()  # or a refusal, before there is a folder
    console.print(
        f"Flying {wanted.task} on [bold]{wanted.vehicle}[/bold] at {wanted.url}. The graph is in "
        f"ROS_DOMAIN_ID={domain}, on this machine only."
    )
    if not wanted.embedded:
        flight_parameters.look(wanted)
    _fly(wanted, new_folder(out))


def _fly(plan: FlightPlan, out: Path) -> None:
    from iolspi_ros import graph
    from iolspi_ros.bags import BagWriter
    from iolspi_ros.cli import flight_report
    from iolspi_ros.cli.flight import Flight, Warnings, end_bridge, start_embedded
    from iolspi_ros.nodes.monitor import watching

    vehicle = plan.model()
    if plan.practice:
        plan = practise(plan, out)
    with (
        BagWriter(out / "bag") as recording,
        watching(vehicle.description, recording) as monitor,
        graph.Graph(out) as nodes,
    ):
        warnings = Warnings(monitor)
        if plan.embedded:
            start_embedded(nodes, plan)
        try:
            flown = Flight(nodes, monitor, plan, out).fly()
        except (InputError, KeyboardInterrupt):
            console.print(
                f"Ending: the bridge lands what flies. What there is of it is in {out}: the "
                "nodes' logs, a bag, a .tlog."
            )
            raise
        finally:
            warnings.finish()
            end_bridge(nodes, plan)
    flight_report.write(out, vehicle, plan, monitor, flown, round(so_far(), 1))
    if flown.trouble:
        raise InputError(f"the flight ended before it should: {flown.trouble}")
