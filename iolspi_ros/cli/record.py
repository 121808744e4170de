"""`iolspi record`: let the scripted pilot fly a demonstration set through the graph."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from iolspi_ros import resources
from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.cli.selecting import CONFIG
from iolspi_ros.errors import InputError


@app.command(epilog="Example: iolspi record --mode explore --corruption 0.33 --out my_set")
def record(
    out: Annotated[Path, typer.Option(help="Bag to make; must not be there yet.")],
    task: Annotated[str, typer.Option(help="The task to fly.")] = "pendulum",
    mode: Annotated[str, typer.Option(help="perform or explore.")] = "perform",
    corruption: Annotated[float, typer.Option(help="Probability of a random action.")] = 0.0,
    demonstration: Annotated[
        Optional[int],
        typer.Option("--set", help="Mode and corruption of that shipped set instead."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of the pilot and the simulator.")] = 0,
    config: Annotated[Optional[Path], typer.Option(help=CONFIG)] = None,
) -> None:
    """Let the scripted pilot fly one episode from each start on a ROS 2 graph, and record it."""
    from iolspi_ros import bags, graph
    from iolspi_ros.experiments.headless import make_vehicle
    from iolspi_ros.experiments.samplesets import mode_and_corruption
    from iolspi_ros.nodes.monitor import watching
    from sim_nodes.tasks.base import n_starts

    file = config or resources.config(task)
    vehicle = make_vehicle(task, file)
    if demonstration is not None:
        mode, corruption = mode_and_corruption(demonstration)
    if out.exists():
        raise InputError(f"--out {out} exists already; allowed: a folder that is not there yet")
    graph.isolate()
    work = _beside(out)
    bag = work / out.name
    wanted = {
        "seed": seed, "source": "scripted", "mode": mode, "corruption": corruption,
        "record": str(bag), "episodes": n_starts(vehicle), "model": task,
        "model_file": str(file.resolve()) if file else "",
    }  # fmt: skip
    try:
        with watching(vehicle.description) as monitor, graph.Graph(work) as nodes:
            nodes.start("simulator", {"task": task, "seed": seed, "order": "sweep"}, file)
            nodes.start("demonstrator", wanted, file)
            _wait(nodes, monitor, vehicle, bag)
        bags.compact(bag)
    finally:
        _put_in_place(bag, out, work)
    card = bags.read_card(out)
    console.print(f"{out}: {card['samples']} samples, flown by {card['pilot']}")


def _beside(out: Path) -> Path:
    """A folder to work in, of this run alone, on the disk where the bag is to be."""
    resources.make_folder(out.resolve().parent)
    try:
        return Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.resolve().parent))
    except OSError as error:
        raise InputError(
            f"--out {out} cannot be made: {error.strerror}; allowed: a place you may write to"
        ) from None


def _put_in_place(bag: Path, out: Path, work: Path) -> None:
    """Give the bag, whole or not, the name that was asked for, unless somebody has taken it."""
    if bag.is_dir():
        try:
            bag.rename(out)
        except OSError:
            raise InputError(
                f"--out {out} was made by somebody else meanwhile; the bag is in {bag}"
            ) from None
    shutil.rmtree(work)


def _wait(nodes: Any, monitor: Any, vehicle: Any, out: Path) -> None:
    """Until the demonstrator has written its card, which it does last."""
    from iolspi_ros.bags import CARD
    from sim_nodes.tasks.base import n_starts

    monitor.listen_to_samples()
    total = n_starts(vehicle)
    with bar("recording [episodes]", total) as show:

        def ready() -> bool:
            nodes.check()
            show(sum(episode.whole for episode in monitor.episodes))
            return (out / CARD).is_file()

        patience = 60.0 + total * vehicle.description.episode_steps / 100
        monitor.wait(ready, patience, "the demonstration")
