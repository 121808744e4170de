"""`iolspi compare`: learners side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.computing import BACKEND, PROCESSES, SCHEDULER, backend_of, compute
from iolspi_ros.cli.progress import console
from iolspi_ros.errors import InputError

if TYPE_CHECKING:
    from iolspi_ros.experiments.compare import Case

EVERYBODY = "all"


@app.command(
    epilog="Example: iolspi compare --task pendulum --learners iolspi,q_learning --seeds 5"
)
def compare(
    tasks: Annotated[
        Optional[list[str]], typer.Option("--task", help="Again for more; pendulum by default.")
    ] = None,
    learners: Annotated[
        str,
        typer.Option(
            "--learners",
            "--algorithms",
            help="Registered ones, or dqn, with commas between; all: that can.",
        ),
    ] = EVERYBODY,
    seeds: Annotated[int, typer.Option(min=1, help="Realisations of each.")] = 5,
    seconds: Annotated[
        Optional[float], typer.Option(min=0.0, help="Of vehicle time; usual for the task.")
    ] = None,
    out: Annotated[
        Path, typer.Option(help="Folder for results; what is there already is not recomputed.")
    ] = Path("out/compare"),
    backend: BACKEND = "local",
    scheduler: SCHEDULER = "",
    processes: PROCESSES = -1,
) -> None:
    """Let learners learn the same, and compare return, success, crashes and cost.

    From nothing, from demonstration set 5, and after a jump of g, where a task has those. OUT/data
    keeps every realisation, so that a call that was interrupted goes on where it stopped.
    """
    from iolspi_ros.experiments.results import Store
    from iolspi_ros.report import comparison

    cases = _cases(tasks or ["pendulum"], learners, seeds, seconds)
    store = Store(out / "data", console.print)
    compute([c for case in cases for c in case.all_cells], store,
            backend_of(backend, scheduler, processes))  # fmt: skip
    table, path = comparison.save(cases, store, out)
    for case in cases:
        own = [row for row in table if (row["task"], row["case"]) == (case.task.name, case.name)]
        _show(f"{case.task.name.replace('_', ' ')} {case.name}", comparison.details(own))
    console.print(f"Look at [bold]{path}[/bold]")


def _cases(tasks: list[str], learners: str, seeds: int, seconds: float | None) -> list[Case]:
    """What is to be computed; what cannot be is said first."""
    from iolspi_ros import registry
    from iolspi_ros.core.learner import GROUP
    from iolspi_ros.experiments.compare import DEEP, plan
    from iolspi_ros.methods.traits import TRAITS

    everybody = learners == EVERYBODY
    names = list(TRAITS) if everybody else [n.strip() for n in learners.split(",") if n.strip()]
    if not names:
        raise InputError(
            f"--learners is {learners!r}; allowed: {EVERYBODY}, or names with commas between, of "
            f"{', '.join((*registry.names(GROUP), DEEP))}"
        )
    found = []
    for task in dict.fromkeys(tasks):
        mine = plan(task, list(dict.fromkeys(names)), seeds, seconds, everybody)
        if not any(cell for case in mine for cell in case.cells.values()):
            raise InputError(
                f"nothing of {', '.join(names)} can be flown on {task}, for which no "
                "demonstrations are shipped; allowed: also one that begins from nothing, such as "
                "iolspi"
            )
        found += mine
        left = [name for name in names if not any(case.cells.get(name) for case in mine)]
        if left:
            console.print(f"{task}: without {', '.join(left)}, which cannot learn it, or whose "
                          "extra is not installed")  # fmt: skip
    return found


def _show(title: str, lines: list[list[str]]) -> None:
    from rich.table import Table

    table = Table(*lines[0][2:], title=title)
    for line in lines[1:]:
        table.add_row(*(cell.partition(" (")[0] for cell in line[2:]))  # the page has intervals
    console.print(table)
