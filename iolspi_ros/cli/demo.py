"""`iolspi demo`: the whole way, from shipped demonstrations to a vehicle that does the task."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.cockpit import start_cockpit
from iolspi_ros.cli.duration import EPISODES, SECONDS, episodes_to_fly
from iolspi_ros.cli.following import Follower
from iolspi_ros.cli.progress import baseline, console
from iolspi_ros.errors import InputError, check_choice
from iolspi_ros.folders import new_folder


@app.command(epilog="Example: iolspi demo --set 2 --seconds 60 --out out/set2")
def demo(
    task: Annotated[str, typer.Option(help="pendulum or slung_load.")] = "pendulum",
    demonstration: Annotated[
        int, typer.Option("--set", help="Shipped demonstration set, 1 to 5.")
    ] = 5,
    seconds: Annotated[Optional[float], typer.Option(help=SECONDS)] = None,
    episodes: Annotated[Optional[int], typer.Option(help=EPISODES)] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the simulator and the learner.")] = 0,
    out: Annotated[
        Path, typer.Option(help="A new folder for all that is left; out/demo gets numbered ones.")
    ] = Path("out/demo"),
    watch: Annotated[bool, typer.Option("--watch", help="Show it live in the browser.")] = False,
) -> None:
    """Learn a task on a real ROS 2 graph, and report how it went.

    Starts a simulator, a demonstrator that replays a shipped bag, and a learner, each in a
    process of its own. Leaves report.html, summary.json, a bag of the run and a checkpoint.
    """
    from iolspi_ros import graph, resources
    from iolspi_ros.bags import BagWriter
    from iolspi_ros.experiments.samplesets import mode_and_corruption
    from iolspi_ros.nodes.monitor import watching
    from sim_nodes.tasks import make_task

    shipped = sorted(folder.name for folder in resources.find("demos").iterdir())
    check_choice("--task", task, tuple(shipped))
    config = resources.find("config", f"{task}.yaml")
    mode_and_corruption(demonstration)
    bag = resources.find("demos", task, f"set_{demonstration}")
    vehicle = make_task(task, resources.parameters(config, "simulator"), str(config))
    count = episodes_to_fly(vehicle, seconds, episodes, 1)
    domain = graph.isolate()
    out = new_folder(out)
    console.print(
        f"Learning [bold]{task}[/bold] from demonstration set {demonstration}, then online for "
        f"{count} episodes.\nThe graph is in ROS_DOMAIN_ID={domain}, on this machine only."
    )
    start = time.monotonic()
    with (
        BagWriter(out / "bag") as recording,
        watching(vehicle.description, recording) as monitor,
        graph.Graph(out) as nodes,
    ):
        if watch:
            console.print(f"Watch it at [bold]{start_cockpit(nodes, out)}[/bold]")
        keep = str(out.resolve() / "checkpoint.npz")
        nodes.start("simulator", {"seed": seed, "episodes": count}, config)
        nodes.start("learner", {"seed": seed, "checkpoint": keep}, config)
        replay = {"bags": [str(bag)], "source": "bag", "listeners": 2, "learner_timeout": 60.0}
        nodes.start("demonstrator", replay, config)
        try:
            history, extra = _watch(nodes, monitor, vehicle, count, bag)
        except (InputError, KeyboardInterrupt):
            console.print(f"What there is of it is in {out}: the nodes' logs, a bag, a checkpoint.")
            raise
    _report(out, vehicle, config, history, start, extra | {"seed": seed}, demonstration)


def _watch(
    nodes: Any, monitor: Any, vehicle: Any, episodes: int, bag: Path
) -> tuple[Any, dict[str, Any]]:
    """Follow the graph through its four parts."""
    from rclpy.utilities import get_rmw_implementation_identifier

    from iolspi_ros.bags import read_card

    follower = Follower(nodes, monitor)
    follower.wait(monitor.connected, 60.0, "the start of simulator and learner")
    monitor.listen_to_samples()
    shown = len(vehicle.initial_states())  # one from each start, without learning
    samples = int(read_card(bag).get("samples", 1))
    follower.follow("replaying demonstrations", samples, lambda: len(monitor.demonstrated), 60.0)
    follower.follow("learning offline", 1, lambda: monitor.updates, 120.0)
    begin = time.monotonic()
    online = 60.0 + episodes
    follower.follow("learning online [episodes]", episodes, lambda: len(monitor.scores), online)
    took = time.monotonic() - begin
    steps = sum(len(episode.states) for episode in monitor.episodes)
    monitor.switch("/learner/learn", on=False)
    monitor.trigger("/learner/save")
    monitor.set_parameters("simulator", order="sweep", episodes=shown)
    monitor.trigger("/simulator/reset")
    follower.follow("showing [episodes]", shown, lambda: len(monitor.scores) - episodes, 60.0)
    monitor.wait_for_ends(episodes + shown, 7.0)
    return monitor.history(episodes), {
        "lockstep_seconds": round(took, 2),
        "lockstep_steps_per_second": round(steps / took, 1),
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
        "observations_missed_by_recorder": monitor.missed,
        "rmw": get_rmw_implementation_identifier(),
    }


def _report(
    out: Path,
    vehicle: Any,
    config: Path,
    history: Any,
    start: float,
    extra: dict[str, Any],
    demonstration: int,
) -> None:
    """Compute what needs no graph, and write the pages."""
    from iolspi_ros.experiments.headless import prepare, train_beside
    from iolspi_ros.report import run as report

    name = vehicle.description.name
    if not report.whole(history.shown):
        raise InputError("no episode shown was recorded whole; is the machine very busy? Try again")
    learner = prepare(name, config, extra["seed"]).learner
    subject = report.Subject(vehicle, learner, history, None)
    extra |= {
        "demonstration_set": demonstration,
        "shown_success_fraction": report.share_shown(subject),
        "wall_seconds": round(time.monotonic() - start, 1),
    }
    lead = (
        f"Demonstration set {demonstration} was replayed on a ROS 2 graph, offline LSPI learned "
        "from it, and online LSPI went on from there. The set was flown by a scripted pilot, "
        "not by a person."
    )
    title = f"Learning the {name.replace('_', ' ')} from demonstrations"
    subject = subject._replace(baseline=baseline(vehicle))
    with console.status("flying another learner beside, drawing …"):
        beside = train_beside(
            name, config, extra["seed"], history.demonstrations, len(history.scores)
        )
        summary = report.finish(out, title, lead, subject, extra, beside)
    number, of_what = report.how_good(summary)
    console.print(
        f"\nAfter {summary['vehicle_seconds']:.0f} s of vehicle time the policy comes to "
        f"[bold]{number}[/bold] {of_what};\n"
        f"{summary['shown_success_fraction']:.0%} of the {len(report.whole(history.shown))} "
        f"episodes shown on the graph {vehicle.description.success}; after the demonstrations "
        f"alone it was {summary['success_fraction_offline']:.0%} of the starts. "
        f"That took {summary['wall_seconds']:.0f} s.\n"
        f"Look at [bold]{out / 'report.html'}[/bold]\n"
        f"Fly it yourself, in the browser: make cockpit, or iolspi cockpit --task {name}"
    )
