"""`iolspi demo`: the whole way, from shipped demonstrations to a vehicle that does the task."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.cockpit import start_cockpit
from iolspi_ros.cli.duration import EPISODES, SECONDS, episodes_to_fly
from iolspi_ros.cli.following import Follower
from iolspi_ros.cli.progress import baseline, console, so_far
from iolspi_ros.cli.selecting import CONFIG, RUN, TASK, TOPICS, VEHICLE
from iolspi_ros.errors import InputError
from iolspi_ros.folders import new_folder

if TYPE_CHECKING:
    from iolspi_ros.bags import Selection
    from iolspi_ros.task import TaskDescription


REPLAYED = (
    "replayed on a ROS 2 graph, offline LSPI learned from that, and online LSPI went on from there."
)


@app.command(epilog="Example: iolspi demo --set 2 --seconds 60 --out out/set2")
def demo(
    task: Annotated[str, typer.Option(help=TASK)] = "pendulum",
    demonstration: Annotated[
        int, typer.Option("--set", help="Demonstration set, 1 to 5, of a task that has them.")
    ] = 5,
    demos: Annotated[
        Optional[list[Path]],
        typer.Option(help="Bag to learn from instead; give it again for more bags."),
    ] = None,
    vehicle: VEHICLE = "",
    run: RUN = 0,
    topics: TOPICS = None,
    seconds: Annotated[Optional[float], typer.Option(help=SECONDS)] = None,
    episodes: Annotated[Optional[int], typer.Option(help=EPISODES)] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the simulator and the learner.")] = 0,
    config: Annotated[Optional[Path], typer.Option(help=CONFIG)] = None,
    out: Annotated[
        Path, typer.Option(help="A new folder for all that is left; out/demo gets numbered ones.")
    ] = Path("out/demo"),
    watch: Annotated[bool, typer.Option("--watch", help="Show it live in the browser.")] = False,
) -> None:
    """Learn a task on a real ROS 2 graph, and report how it went.

    Starts a simulator, a demonstrator that replays bags, and a learner, each in a process of its
    own. Leaves report.html, summary.json, a bag of the run and a checkpoint.
    """
    from iolspi_ros import graph, resources
    from iolspi_ros.bags import BagWriter, select
    from iolspi_ros.experiments.headless import make_vehicle
    from iolspi_ros.nodes.monitor import watching

    file = config or resources.config(task)
    model = make_vehicle(task, file)
    chosen = select(vehicle, run, topics or [])
    taught = Taught.by(task, model.description, demonstration, demos or [], chosen)
    count = episodes_to_fly(model, seconds, episodes, 1)
    domain = graph.isolate()
    out = new_folder(out)
    console.print(
        f"Learning [bold]{model.description.name}[/bold] {taught.text}, online for "
        f"{count} episodes.\nThe graph is in ROS_DOMAIN_ID={domain}, on this machine only."
    )
    with (
        BagWriter(out / "bag") as recording,
        watching(model.description, recording) as monitor,
        graph.Graph(out) as nodes,
    ):
        if watch:
            console.print(f"Watch it at [bold]{start_cockpit(nodes, out)}[/bold]")
        keep = str(out.resolve() / "checkpoint.npz")
        # Without demonstrations it is activated once it is watched.
        alone = {"wait_for_demonstrations": False, "autostart": "configure"}
        wait = {} if taught.bags else alone
        nodes.start("simulator", {"task": task, "seed": seed, "episodes": count}, file)
        nodes.start("learner", {"seed": seed, "checkpoint": keep} | wait, file)
        if taught.bags:
            replay = {"bags": [str(bag.resolve()) for bag in taught.bags], "source": "bag"}
            patience = {"listeners": 2, "learner_timeout": 60.0}
            which = {"bag_vehicle": vehicle, "bag_run": run, "bag_topics": topics or [""]}
            nodes.start("demonstrator", replay | patience | which, file)
        try:
            history, extra = _watch(nodes, monitor, model, count, taught)
        except (InputError, KeyboardInterrupt):
            console.print(f"What there is of it is in {out}: the nodes' logs, a bag, a checkpoint.")
            raise
    _report(out, task, model, file, history, extra | {"seed": seed}, taught)


@dataclass(frozen=True)
class Taught:
    """What is demonstrated.

    Attributes
    ----------
    bags : list of Path
    samples : int
        In all of them.
    text, lead : str
        What it is, for the screen and for the report.
    facts : dict
        For the summary.
    """

    bags: list[Path]
    samples: int
    text: str
    lead: str
    facts: dict[str, Any]

    @classmethod
    def by(
        cls, task: str, about: TaskDescription, number: int, demos: list[Path], chosen: Selection
    ) -> Taught:
        """Bags of the user's, or a set that is shipped, or nothing.

        Raises
        ------
        InputError
            When there is no such set, or a bag cannot be learned from.
        """
        from iolspi_ros import resources
        from iolspi_ros.bags import read_demonstration
        from iolspi_ros.experiments.samplesets import mode_and_corruption

        shipped = {folder.name for folder in resources.find("demos").iterdir()}
        if demos:
            samples = sum(len(read_demonstration(bag, about, chosen).samples) for bag in demos)
            names = ", ".join(str(bag) for bag in demos)
            text = f"from {names}, then"
            return cls(demos, samples, text, f"{names} was {REPLAYED}", {"demos": names})
        if task not in shipped:
            text = "from nothing (a bag of your own: --demos)"
            lead = "Online LSPI learned on a ROS 2 graph, without demonstrations."
            return cls([], 0, text, lead, {})
        mode_and_corruption(number)
        bag = resources.find("demos", task, f"set_{number}")
        samples = len(read_demonstration(bag, about).samples)
        flown = f"Demonstration set {number}, flown by a scripted pilot and not by a person, was"
        text = f"from demonstration set {number}, then"
        return cls([bag], samples, text, f"{flown} {REPLAYED}", {"demonstration_set": number})


def _watch(
    nodes: Any, monitor: Any, vehicle: Any, episodes: int, taught: Taught
) -> tuple[Any, dict[str, Any]]:
    """Follow the graph through its parts."""
    from rclpy.utilities import get_rmw_implementation_identifier

    from sim_nodes.tasks.base import n_starts

    follower = Follower(nodes, monitor)
    follower.wait(monitor.connected, 60.0, "the start of simulator and learner")
    monitor.listen_to_samples()
    shown = n_starts(vehicle)  # one from each start, without learning
    if not taught.bags:
        monitor.change_state("learner", "activate")
    else:
        heard = lambda: len(monitor.demonstrated)  # noqa: E731
        follower.follow("replaying demonstrations", taught.samples, heard, 60.0)
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
    task: str,
    vehicle: Any,
    file: Path | None,
    history: Any,
    extra: dict[str, Any],
    taught: Taught,
) -> None:
    """Compute what needs no graph, and write the pages."""
    from iolspi_ros.experiments.headless import prepare, train_beside
    from iolspi_ros.report import headline
    from iolspi_ros.report import run as report

    about = vehicle.description
    if not report.whole(history.shown):
        raise InputError("no episode shown was recorded whole; is the machine very busy? Try again")
    learner = prepare(task, file, extra["seed"]).learner
    subject = report.Subject(vehicle, learner, history, None)
    extra |= taught.facts | {
        "shown_success_fraction": report.share_shown(subject),
        "wall_seconds": round(so_far(), 1),
    }
    title = f"Learning the {about.name.replace('_', ' ')} on a graph"
    subject = subject._replace(baseline=baseline(vehicle))
    with console.status("flying another learner beside, drawing …"):
        beside = train_beside(
            task, file, extra["seed"], history.demonstrations, len(history.scores)
        )
        summary = report.finish(out, title, taught.lead, subject, extra, beside)
    number, of_what = headline.how_good(summary)
    before = summary.get("success_fraction_offline") if taught.bags else None
    offline = "" if before is None else (
        f"; after the demonstrations alone it was {before:.0%} of the starts"
    )  # fmt: skip
    console.print(
        f"\nAfter {summary['vehicle_seconds']:.0f} s of vehicle time the policy comes to "
        f"[bold]{number}[/bold] {of_what};\n"
        f"{summary['shown_success_fraction']:.0%} of the {len(report.whole(history.shown))} "
        f"episodes shown on the graph {about.success}{offline}. "
        f"{summary['headline_note']}\n"
        f"That took {so_far():.0f} s, {summary['wall_seconds']:.0f} of them until the graph was "
        "done.\n"
        f"Look at [bold]{out / 'report.html'}[/bold]\n"
        f"Fly it yourself, in the browser: make cockpit, or iolspi cockpit --task {task}"
    )
