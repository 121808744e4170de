"""`iolspi demos`: look at bags of demonstrations, check, change and export copies of them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.cli.selecting import CONFIG, RUN, TASK, TOPICS, VEHICLE
from iolspi_ros.errors import InputError

if TYPE_CHECKING:
    from iolspi_ros.bags import Demonstration
    from iolspi_ros.core.samples import Sample
    from iolspi_ros.task import TaskDescription

demos = typer.Typer(help="Look at bags of demonstrations, check, change and export copies of them.")
app.add_typer(demos, name="demos", no_args_is_help=True)

BAG = Annotated[Path, typer.Argument(help="A rosbag2 directory, or one file of it.")]
BAGS = Annotated[list[Path], typer.Argument(help="Bags.")]
OUT = Annotated[Path, typer.Option(help="Where to; must not be there yet.")]
ITS_TASK = Annotated[str, typer.Option("--task", help=f"{TASK} Else what the bag says.")]


def task_of(name: str, path: Path) -> TaskDescription:
    """The task of a bag: the one that is named, or what its messages or its card say.

    Raises
    ------
    InputError
        When nobody says.
    """
    from iolspi_ros import task as tasks
    from iolspi_ros.bags.survey import contents
    from msg_bridge.ros.description import read_robot
    from sim_nodes.tasks import is_robot, task_class

    if not name:
        found = contents(path)
        if found.task is not None:
            return found.task
        name = str(found.card.get("task", ""))
    if not name:
        raise InputError(f"bag {path} does not say of which task it is; allowed: --task")
    if name.endswith((".yaml", ".yml")):
        content = tasks.read_plain(Path(name))
        if is_robot(content):
            return read_robot(Path(name)).task
        if isinstance(content, dict) and "gymnasium" not in content:
            return tasks.read(Path(name))
    about: TaskDescription = task_class(name).description
    return about


def _read(path: Path, task: str, vehicle: str, run: int, topics: list[str] | None) -> Demonstration:
    from iolspi_ros.bags import read_demonstration, select

    return read_demonstration(path, task_of(task, path), select(vehicle, run, topics or []))


@demos.command("list")
def list_(
    folder: Annotated[Path, typer.Argument(help="Where to look, and below.")] = Path("."),
) -> None:
    """List the bags in a folder."""
    from iolspi_ros.bags import read_card
    from iolspi_ros.bags.reader import bag_files

    if not folder.is_dir():
        raise InputError(f"folder {folder} does not exist; allowed: a folder")
    for path in sorted([folder, *(p for p in folder.rglob("*") if p.is_dir())]):
        if files := bag_files(path):
            card = read_card(path)
            size = sum(file.stat().st_size for file in files)
            who = f"{card.get('samples', '?')} samples of {card.get('task', '?')}, flown by "
            who += str(card.get("pilot", "?"))
            console.print(f"{path}: {who if card else 'no card'} ({size / 2**20:.1f} MiB)")


@demos.command()
def info(
    bag: BAG, task: ITS_TASK = "", vehicle: VEHICLE = "", run: RUN = 0, topics: TOPICS = None
) -> None:
    """Say what a bag holds: topics, vehicles, runs, samples."""
    from iolspi_ros.bags import select
    from iolspi_ros.bags.survey import contents, flights

    found = contents(bag)
    for topic, (kind, count) in sorted(found.topics.items()):
        console.print(f"  {topic} ({kind}): {count} messages")
    for name, value in found.card.items():
        console.print(f"  card: {name}: {value}")
    for note in found.damage:
        console.print(f"  {note}")
    about = task_of(task, bag)
    for flight in flights(bag, about, select(vehicle, run, topics or [])):
        ends = [s.transition for s in flight.samples]
        ended = sum(t.terminated for t in ends), sum(t.truncated for t in ends)
        console.print(f"{flight}; {ended[0]} ended by the task, {ended[1]} by the clock")


@demos.command()
def check(
    bags: BAGS, task: ITS_TASK = "", vehicle: VEHICLE = "", run: RUN = 0, topics: TOPICS = None
) -> None:
    """Say what is wrong with bags, or odd, before anybody learns from them; 1 if anything is."""
    from iolspi_ros.bags.survey import extent, oddities

    odd = False
    for path in bags:
        found = _read(path, task, vehicle, run, topics)
        texts = oddities(found)
        console.print(f"{path}: {found.task.name}, {extent(found.transitions(), found.task)}")
        for text in texts:
            console.print(f"  {text}")
        odd |= bool(texts)
    raise typer.Exit(int(odd))


@demos.command()
def merge(bags: BAGS, out: OUT, task: ITS_TASK = "") -> None:
    """Join bags of one task, each with one vehicle and run, to one; none is changed."""
    from iolspi_ros.bags import numbered_through, read_demonstration

    about = task_of(task, bags[0])
    found = [read_demonstration(path, about) for path in bags]
    pilots = sorted({str(one.card["pilot"]) for one in found if "pilot" in one.card})
    samples = numbered_through(found)
    _write(out, samples, about, {"pilot": "; ".join(pilots)} if pilots else {})
    console.print(f"{out}: {len(samples)} samples of {len(found)} bags")


@demos.command()
def split(bag: BAG, out: OUT, task: ITS_TASK = "", topics: TOPICS = None) -> None:
    """Divide a bag into one for each run of each vehicle, in a new folder."""
    from iolspi_ros import resources
    from iolspi_ros.bags import read_card, select
    from iolspi_ros.bags.survey import flights

    about = task_of(task, bag)
    found = flights(bag, about, select(topics=topics or []))
    if out.exists():
        raise InputError(f"--out {out} exists already; allowed: a folder that is not there yet")
    resources.make_folder(out)
    card = read_card(bag) if bag.is_dir() else {}
    pilot = {"pilot": card["pilot"]} if "pilot" in card else {}
    for flight in found:
        name = f"{flight.vehicle.strip('/').replace('/', '_') or 'vehicle'}_run_{flight.run}"
        _write(out / name, flight.samples, about, pilot)
        console.print(f"{out / name}: {len(flight.samples)} samples")


@demos.command()
def plot(
    bag: BAG, out: OUT, task: ITS_TASK = "", vehicle: VEHICLE = "", run: RUN = 0,
    topics: TOPICS = None,
) -> None:  # fmt: skip
    """Draw where the samples are (T figs. 6-9), as PNG."""
    from iolspi_ros import figures
    from iolspi_ros.report import plots
    from iolspi_ros.task.maps import map_limits

    found = _read(bag, task, vehicle, run, topics)
    if found.task.n_dims < 2:
        raise InputError(f"task {found.task.name} has one variable; allowed: two or more")
    if out.exists():
        raise InputError(f"--out {out} exists already; allowed: a file that is not there yet")
    states = found.transitions().state
    limits = map_limits(found.task, states)
    figure = plots.visit_maps(found.task, [("Samples", states)], limits)
    out.write_bytes(figures.png(figure))
    console.print(f"{out}: {figures.alt(figure)}")


@demos.command()
def relabel(
    bag: BAG, out: OUT,
    task: Annotated[Path, typer.Option(help="YAML file of the robot.")],
    vehicle: VEHICLE = "", run: RUN = 0, topics: TOPICS = None,
) -> None:  # fmt: skip
    """Make samples of a robot's own topics, or give samples the rewards of its file."""
    from iolspi_ros.bags import Damage, read_card, read_demonstration, records, select
    from msg_bridge.ros.description import read_robot
    from msg_bridge.ros.replay import is_recording, relabelled, samples_of

    robot = read_robot(task)
    messages = list(records(bag, Damage()))
    if is_recording({message.topic for message in messages}, robot):
        samples = samples_of(messages, robot)
    else:
        found = read_demonstration(bag, robot.task, select(vehicle, run, topics or []))
        samples = list(relabelled(found.samples, robot.rules))
    if not samples:
        raise InputError(
            f"bag {bag} has no step in which all topics of {task} spoke and an action was told; "
            "allowed: a recording of them"
        )
    card = read_card(bag) if bag.is_dir() else {}
    _write(out, samples, robot.task, {"pilot": card["pilot"]} if "pilot" in card else {})
    console.print(f"{out}: {len(samples)} samples")


@demos.command()
def corrupt(
    bag: BAG, out: OUT,
    share: Annotated[float, typer.Option(min=0.0, max=1.0, help="Of the samples.")] = 0.33,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    task: ITS_TASK = "", vehicle: VEHICLE = "", run: RUN = 0, topics: TOPICS = None,
    config: Annotated[Optional[Path], typer.Option(help=CONFIG)] = None,
) -> None:  # fmt: skip
    """Give samples a random action and what the task's model does with it (T Table 1)."""
    import numpy as np

    from iolspi_ros import resources
    from iolspi_ros.experiments.headless import make_vehicle
    from iolspi_ros.experiments.samplesets import corrupted
    from sim_nodes.tasks.base import Stateful

    found = _read(bag, task, vehicle, run, topics)
    name = task or found.task.name
    model = make_vehicle(name, config or resources.config(name))
    if isinstance(model, Stateful):
        raise InputError(f"task {found.task.name} has no model; allowed: one whose step is known")
    model.description.check_same(found.task, "the model", f"bag {bag}")
    samples = list(corrupted(found.samples, model, share, np.random.default_rng(seed)))
    _write(out, samples, found.task, found.card | {"corruption": share, "seed": seed})
    console.print(f"{out}: {len(samples)} samples")


@demos.command()
def export(
    bag: BAG,
    out: Annotated[
        str,
        typer.Option(help="A new .csv or .npz file, a new .lerobot folder, or minari:NAME/SET-v0."),
    ],
    task: ITS_TASK = "", vehicle: VEHICLE = "", run: RUN = 0, topics: TOPICS = None,
) -> None:  # fmt: skip
    """Write the samples as a table (.csv), arrays (.npz), or a dataset of LeRobot or Minari."""
    from iolspi_ros.bags.export import write_csv, write_npz
    from iolspi_ros.bags.lerobot import SUFFIX, write_lerobot
    from iolspi_ros.bags.minari import write_minari

    if dataset := _dataset(out):
        found = _read(bag, task, vehicle, run, topics)
        write_minari(dataset, found)
    else:
        path = Path(out)
        writers = {".csv": write_csv, ".npz": write_npz, SUFFIX: write_lerobot}
        if path.suffix not in writers:
            raise InputError(
                f"--out is {out}; allowed: a name that ends in {', '.join(writers)}, or "
                "minari:NAME/SET-v0"
            )
        if path.exists():
            raise InputError(f"--out {out} exists already; allowed: one that is not there yet")
        found = _read(bag, task, vehicle, run, topics)
        with console.status(f"writing {len(found.samples)} samples …"):
            writers[path.suffix](path, found)
    console.print(f"{out}: {len(found.samples)} samples")


@demos.command("import")
def import_(
    dataset: Annotated[str, typer.Argument(help="minari:NAME/SET-v0, on this machine.")],
    out: OUT,
    task: Annotated[str, typer.Option(help=f"{TASK} Else what the dataset says.")] = "",
) -> None:
    """Make a bag of a dataset of Minari."""
    from iolspi_ros.bags.minari import read_minari

    name = _dataset(dataset)
    if not name:
        raise InputError(
            f"dataset is {dataset!r}; allowed: minari: and its name, as minari:boat/me-v0"
        )
    samples, about = read_minari(name, task_of(task, out) if task else None)
    _write(out, samples, about, {"pilot": f"Minari's dataset {name}"})
    console.print(f"{out}: {len(samples)} samples")


def _dataset(text: str) -> str:
    """The name after `minari:`, if it is that."""
    return text.removeprefix("minari:") if text.startswith("minari:") else ""


def _write(path: Path, samples: list[Sample], task: TaskDescription, card: dict[str, Any]) -> None:
    """A bag of samples, with its task and its card."""
    from iolspi_ros import __version__
    from iolspi_ros.bags import write_card
    from iolspi_ros.bags.export import write_bag

    write_bag(path, samples, task)
    about = {"task": task.name, "samples": len(samples), "version": __version__}
    write_card(path, card | about)
