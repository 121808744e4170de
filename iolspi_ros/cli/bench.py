"""`iolspi bench`: measure what the learner learns, how fast it computes, how far it grows."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.errors import InputError, check_choice

if TYPE_CHECKING:
    from collections.abc import Callable

    from iolspi_ros.bench.rows import Row

SUBJECTS = ("learner", "speed", "scale", "safety", "bridge", "public", "interventions")
BESIDE = "deep"
"""What only measures others, and is asked for by name."""


@app.command(epilog="Example: iolspi bench speed --json out/speed.json")
def bench(
    subjects: Annotated[
        Optional[list[str]],
        typer.Argument(help=f"{', '.join(SUBJECTS)}: all by default; or {BESIDE}."),
    ] = None,
    seeds: Annotated[
        int, typer.Option(min=1, help="Of `learner`, `safety`, `public`, `interventions`, `deep`.")
    ] = 20,
    file: Annotated[Optional[Path], typer.Option("--json", help="Write the rows there.")] = None,
    plots: Annotated[Optional[Path], typer.Option(help="Folder for plots.")] = None,
    real: Annotated[
        Optional[str],
        typer.Option(help="Of `bridge`: fly the autopilot's simulator at this URL, nothing else."),
    ] = None,
    autopilot: Annotated[
        Optional[str], typer.Option(help="Who is at --real: px4 or ardupilot.")
    ] = None,
    speed_up: Annotated[float, typer.Option(help="Times real time that it runs.")] = 1.0,
    bridge: Annotated[
        Optional[list[str]], typer.Option(help="NAME=VALUE of a parameter of the bridge there.")
    ] = None,
    flights: Annotated[
        int, typer.Option(min=0, help="Whole flights there, of 23 episodes, a seed each.")
    ] = 3,
    kills: Annotated[
        int, typer.Option(min=0, help="Bridges killed there at random moments of episodes.")
    ] = 20,
    it_is_a_simulator: Annotated[
        bool, typer.Option("--it-is-a-simulator", help="It may be flown recklessly.")
    ] = False,
) -> None:
    """Measure, and say which goals hold.

    On two cores and with 20 seeds `learner` takes about 40 minutes, `safety` 30, `speed` 5,
    `scale` and `bridge` 10. `public` flies well-known environments (the extra gymnasium), an hour;
    so does `interventions`, which has an expert take over from the learner. `deep` flies the same
    environments as `public` with a library's DQN and SAC (the extra deep), six minutes a seed.

    `bridge --real URL` flies a simulator of an autopilot instead: whole flights of `iolspi fly`,
    then bridges that are killed in reckless episodes. At real time that is half an hour.
    """
    from iolspi_ros import resources
    from iolspi_ros.bench import machine

    for subject in subjects or []:
        check_choice("subject", subject, (*SUBJECTS, BESIDE))
    for path in (file and file.parent, plots):
        if path:
            resources.make_folder(path)
    elsewhere = None
    if real is not None:
        elsewhere = _elsewhere(
            subjects, real, autopilot, speed_up, bridge, flights, kills, it_is_a_simulator
        )
    elif autopilot or bridge:
        raise InputError("--autopilot and --bridge go with --real; allowed: bench bridge --real")
    rows = machine.rows()
    console.print(f"{platform.machine()}, Python {platform.python_version()}")
    for subject in subjects or SUBJECTS:
        rows += elsewhere() if elsewhere else _measure(subject, seeds, plots)
        if file:  # after each subject, so that a later one costs nothing that is there
            _write(file, rows)
    table(rows)


def _elsewhere(
    subjects: list[str] | None, url: str, autopilot: str | None, speed_up: float,
    bridge: list[str] | None, flights: int, kills: int, simulator: bool,
) -> Callable[[], list[Row]]:  # fmt: skip
    """What flies an autopilot that is elsewhere; refused before anything happens."""
    from iolspi_ros import resources
    from iolspi_ros.bench import real
    from iolspi_ros.cli.flight_plan import MODELS, URLS, make_plan
    from iolspi_ros.folders import new_folder

    if subjects != ["bridge"]:
        raise InputError("--real goes with one subject; allowed: bench bridge --real URL")
    check_choice("--autopilot", autopilot or "", tuple(URLS))
    if not simulator:
        raise InputError(
            "--real flies recklessly and kills bridges in flight; allowed with "
            "--it-is-a-simulator, which says that nobody can be hurt"
        )
    plan = make_plan(
        "slung_load", autopilot or "", url, "px4", speed_up, "estimate", 5, None, 500, MODELS[0],
        10, 13, 0, bridge or [],
    )  # fmt: skip
    more = [part for text in bridge or [] for part in ("--bridge", text)]
    shared = ["--autopilot", plan.autopilot, "--url", plan.url, "--load", "estimate",
              "--speed-up", str(speed_up), *more]  # fmt: skip
    commands = [[*shared, "--seed", str(seed)] for seed in range(flights)]
    values = resources.parameters(plan.config, "bridge") | plan.parameters()

    def measure() -> list[Row]:
        folder = new_folder(Path("out/bench"))
        console.print(f"All that is left of it is in {folder}.")
        with bar("flights and kills", flights + kills) as show:
            return real.rows(commands, values, kills, folder, show)

    return measure


def _measure(subject: str, seeds: int, plots: Path | None) -> list[Row]:
    if subject == "learner":
        from iolspi_ros.bench import figures, learner

        with bar("learner [realisations]", learner.total(seeds)) as show:
            learned = learner.measure(seeds, show)
        if plots:
            figures.write(plots, "learning", figures.learning(learned))
        return learner.rows(learned)
    if subject == "safety":
        from iolspi_ros.bench import safety

        with bar("safety [s of a core]", safety.total(seeds)) as show:
            return safety.rows(safety.measure(seeds, lambda done: show(round(done))))
    if subject == "interventions":
        from iolspi_ros.bench import interventions

        total = sum(cell.seeds for cell in interventions.cells(seeds))
        with bar("interventions [realisations]", total) as show:
            return interventions.rows(interventions.measure(seeds, lambda n: show(round(n))))
    if subject == "speed":
        from iolspi_ros.bench import speed

        with bar("speed [comparisons]", speed.COMPARISONS) as show:
            return speed.rows(show)
    if subject == "bridge":
        from iolspi_ros.bench import bridge

        with bar("bridge [measurements]", bridge.MEASUREMENTS) as show:
            return bridge.rows(show)
    if subject == "public":
        from iolspi_ros.bench import public

        with bar("public [realisations]", public.total(seeds)) as show:
            return public.rows(seeds, show)
    if subject == BESIDE:
        from iolspi_ros.bench import deep

        with bar("deep [realisations]", deep.total(seeds)) as show:
            return deep.rows(seeds, show)
    from iolspi_ros.bench import figures, scale

    with bar("scale [runs]", scale.RUNS) as show:
        found = scale.measure(show)
    if plots:
        figures.write(plots, "scaling", figures.scaling(found))
    return scale.rows(found)


def _write(file: Path, rows: list[Row]) -> None:
    from iolspi_ros.folders import atomic_file

    with atomic_file(file) as out:
        out.write(json.dumps([asdict(row) for row in rows], indent=1).encode() + b"\n")


def table(rows: list[Row]) -> None:
    """Print figures beside their goals."""
    from rich.table import Table

    table = Table("figure", "value", "unit", "goal", "holds")
    for row in rows:
        holds = "" if row.holds is None else "yes" if row.holds else "[red]no[/red]"
        table.add_row(row.name, f"{row.value:.4g}", row.unit, row.goal, holds)
    console.print(table)
