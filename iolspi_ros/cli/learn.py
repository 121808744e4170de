"""`iolspi learn`: the same core without a graph, as fast as the machine goes."""

from __future__ import annotations

import math
import signal
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.duration import EPISODES, SECONDS, episodes_to_fly
from iolspi_ros.cli.progress import bar, baseline, console, so_far
from iolspi_ros.cli.selecting import CONFIG, RUN, TASK, TOPICS, VEHICLE
from iolspi_ros.errors import InputError
from iolspi_ros.folders import new_folder

if TYPE_CHECKING:
    from iolspi_ros.bags import Selection
    from iolspi_ros.core.learner import Learner
    from iolspi_ros.core.samples import Transitions
    from iolspi_ros.experiments.history import History
    from iolspi_ros.task import TaskDescription


@app.command(
    epilog="Example: iolspi learn --task pendulum --demos demos/pendulum/set_5 --out out/learn"
)
def learn(
    task: Annotated[str, typer.Option(help=TASK)] = "pendulum",
    learner: Annotated[
        str,
        typer.Option(
            "--learner",
            "--algorithm",
            help="A registered learner, or module:Class; else what the file says.",
        ),
    ] = "",
    demos: Annotated[
        Optional[list[Path]],
        typer.Option(help="Bag to learn from first; give it again for more bags."),
    ] = None,
    vehicle: VEHICLE = "",
    run: RUN = 0,
    topics: TOPICS = None,
    seconds: Annotated[Optional[float], typer.Option(help=SECONDS)] = None,
    episodes: Annotated[Optional[int], typer.Option(help=EPISODES)] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the vehicle and the learner.")] = 0,
    config: Annotated[Optional[Path], typer.Option(help=CONFIG)] = None,
    out: Annotated[
        Path, typer.Option(help="A new folder for policy and report; out/learn gets numbered ones.")
    ] = Path("out/learn"),
) -> None:
    """Learn a task without ROS, faster than real time; leaves a policy, plots and numbers."""
    from iolspi_ros import resources
    from iolspi_ros.bags import select
    from iolspi_ros.cli.saving import saved
    from iolspi_ros.experiments.headless import prepare, remember, train, train_beside
    from iolspi_ros.experiments.history import History
    from iolspi_ros.report import headline
    from iolspi_ros.report import run as report

    file = config or resources.config(task)
    world, core, name = prepare(task, file, seed, learner)
    model, about = world.task, world.task.description
    count = episodes_to_fly(model, seconds, episodes, 0)
    if not demos:
        _check_enough(count, core, about)
    out = new_folder(out)
    history = History(
        about.sampling_time, _demonstrated(about, demos or [], select(vehicle, run, topics or []))
    )
    with saved(out / "checkpoint.npz", core, name) as saving:
        if demos:
            saving.computed(lambda: _pretrain(core, history))
        with bar("learning online [episodes]", count) as show:
            train(world, core, count, saving.listener(remember(history, core, show)))
    if saving.interrupted:
        console.print(f"interrupted; what was learned so far is in {out}")
    if saving.interrupted and saving.status != 128 + signal.SIGINT:
        raise typer.Exit(saving.status)  # whoever sends those does not wait for a report
    if not history.policies:
        if saving.interrupted:
            raise KeyboardInterrupt
        raise InputError(
            f"{count} episodes had {core.step} steps, less than one update: nothing was learned; "
            "allowed: more --episodes, or a smaller update_interval"
        )
    extra = {"learner": name, "wall_seconds": round(so_far(), 2)}
    lead = "Learned without a graph, by the same core that the learner node runs."
    subject = report.Subject(model, core, history, baseline(model))
    with console.status("flying another learner beside, drawing …"):
        beside = train_beside(task, file, seed, history.demonstrations, len(history.scores))
        title = f"Learning the {about.name.replace('_', ' ')}"
        summary = report.finish(out, title, lead, subject, extra, beside)
    console.print(
        f"{' '.join(headline.how_good(summary))}, "
        f"{summary['success_fraction']:.0%} of the starts {about.success}. "
        f"{summary['headline_note']}\nThat took {so_far():.0f} s. "
        f"Look at [bold]{out / 'report.html'}[/bold]"
    )


def _check_enough(count: int, learner: Learner, task: TaskDescription) -> None:
    interval = getattr(learner.settings, "update_interval", 1)
    least = math.ceil(interval / task.episode_steps)
    if count < least:
        raise InputError(
            f"{count} episodes are less than one update and there are no --demos: nothing would "
            f"be learned; allowed: at least {least}"
        )


def _demonstrated(task: TaskDescription, demos: list[Path], selection: Selection) -> Transitions:
    """What all bags hold together."""
    from iolspi_ros.bags import numbered_through, read_demonstration
    from iolspi_ros.core.samples import Transitions

    found = [read_demonstration(path, task, selection) for path in demos]
    for demonstration in found:
        for note in demonstration.notes:
            console.print(f"{demonstration.path}: {note}; the rest is used")
    samples = numbered_through(found)
    return Transitions.of([s.transition for s in samples], task.n_dims)


def _pretrain(learner: Learner, history: History) -> None:
    """Learn from what was demonstrated."""
    from iolspi_ros.experiments.history import PolicyRecord

    with bar("learning offline [%]", 100) as show:

        def proceed(share: float) -> bool:
            show(int(100 * share))
            return True

        result = learner.pretrain(history.demonstrations, proceed)
        show(100)
    console.print(result.text)
    history.offline = result.text
    history.policies.append(PolicyRecord.of(result, 0.0, learner.snapshot))
