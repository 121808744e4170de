"""`iolspi learn`: the same core without a graph, as fast as the machine goes."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from iolspi_ros.cli import app
from iolspi_ros.cli.progress import bar, console, yardstick
from iolspi_ros.cli.span import EPISODES, SECONDS, episodes_to_fly
from iolspi_ros.errors import InputError

if TYPE_CHECKING:
    from iolspi_ros.core.online import OnlineLSPI
    from iolspi_ros.core.samples import Transitions
    from iolspi_ros.experiments.history import History
    from sim_nodes.tasks.base import Task


@app.command(
    epilog="Example: iolspi learn --task pendulum --demos demos/pendulum/set_5 --out out/learn"
)
def learn(
    task: Annotated[str, typer.Option(help="pendulum, slung_load or cart_pole.")] = "pendulum",
    demos: Annotated[
        Optional[list[Path]],
        typer.Option(help="Bag to learn from first; give it again for more bags."),
    ] = None,
    seconds: Annotated[Optional[float], typer.Option(help=SECONDS)] = None,
    episodes: Annotated[Optional[int], typer.Option(help=EPISODES)] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the vehicle and the learner.")] = 0,
    config: Annotated[
        Optional[Path], typer.Option(help="Parameter file; config/TASK.yaml by default.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the policy and the report.")] = Path(
        "out/learn"
    ),
) -> None:
    """Learn a task without ROS, faster than real time; leaves a policy, plots and numbers."""
    from iolspi_ros import resources
    from iolspi_ros.core import checkpoint
    from iolspi_ros.experiments.headless import literal_beside, prepare, remember, train
    from iolspi_ros.experiments.history import History
    from iolspi_ros.report import run as report
    from sim_nodes.tasks import task_class

    task_class(task)
    start = time.monotonic()
    file = config or resources.find("config", f"{task}.yaml")
    world, learner = prepare(task, file, seed)
    vehicle = world.task
    count = episodes_to_fly(vehicle, seconds, episodes, 0)
    if not demos:
        _check_enough(count, learner, vehicle)
    resources.make_folder(out)
    history = History(vehicle.dt, _taught(vehicle, demos or []))
    if demos:
        _inform(learner, history)
    try:
        with bar("learning online [episodes]", count) as show:
            train(world, learner, count, remember(history, learner, show))
    except KeyboardInterrupt:
        console.print("interrupted; what was learned so far is kept")
    checkpoint.save(out / "checkpoint.npz", learner, task)
    if not history.policies:
        raise KeyboardInterrupt  # before the first update: there is nothing to report
    extra = {"wall_seconds": round(time.monotonic() - start, 2)}
    lead = "Learned without a graph, by the same core that the learner node runs."
    best = yardstick(vehicle)
    with console.status("flying the literal algorithm beside, drawing …"):
        beside = literal_beside(task, file, seed, history.taught, len(history.scores))
        summary = report.finish(
            out, f"Learning the {task.replace('_', ' ')}", lead, vehicle, learner.features, history,
            best, extra, beside,
        )  # fmt: skip
    console.print(
        f"{' '.join(report.how_good(summary))}, "
        f"{summary['success_fraction']:.0%} of the starts {vehicle.success}. "
        f"Look at [bold]{out / 'report.html'}[/bold]"
    )


def _check_enough(count: int, learner: OnlineLSPI, vehicle: Task) -> None:
    least = math.ceil(learner.settings.update_interval / vehicle.episode_steps)
    if count < least:
        raise InputError(
            f"{count} episodes are less than one update and there are no --demos: nothing would "
            f"be learned; allowed: at least {least}"
        )


def _taught(vehicle: Task, demos: list[Path]) -> Transitions:
    """What all bags hold together."""
    from iolspi_ros.bags import numbered_through, read_demonstration
    from iolspi_ros.core.samples import Transitions

    found = [read_demonstration(path, vehicle.name, vehicle.joints) for path in demos]
    for demonstration in found:
        for note in demonstration.notes:
            console.print(f"{demonstration.path}: {note}; the rest is used")
    samples = numbered_through(found)
    return Transitions.of([s.transition for s in samples], len(vehicle.low))


def _inform(learner: OnlineLSPI, history: History) -> None:
    """Learn from what was demonstrated."""
    from iolspi_ros.experiments.history import Policy

    with bar("learning offline", learner.settings.max_iterations) as show:

        def proceed(iteration: int, change: float) -> bool:
            show(iteration)
            return True

        result = learner.inform(history.taught, proceed)
        show(learner.settings.max_iterations)
    console.print(result.describe())
    history.offline = result.describe()
    history.policies.append(Policy.of(result, 0.0, learner.weights))
