"""A figure or table of the thesis: its cells, its numbers as rows, its claims."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.figure import Figure

from iolspi_ros.errors import InputError
from iolspi_ros.experiments.cells import Cell, Data
from iolspi_ros.experiments.thesis.claims import Claim
from iolspi_ros.folders import atomic_file

Rows: TypeAlias = list[dict[str, Any]]
"""Lines of a table, all with the same keys. Read back from a file, all values are texts."""

_QUICKER = 6
"""Times less that a quick setting costs, about."""
_LONG, _VERY_LONG = 1.5, 3.0  # s


@dataclass(frozen=True)
class Study:
    """One figure or table.

    Attributes
    ----------
    name : str
        As given to `iolspi reproduce`: fig4, table9-1.
    title : str
    where : str
        Its place in T.
    cells : tuple of Cell
        What it is computed from; none for what needs no realisation.
    tabulate : callable
        From results to the rows that are saved.
    draw : callable, optional
        From saved rows, and nothing else, to a figure.
    claims : tuple of Claim
    """

    name: str
    title: str
    where: str
    cells: tuple[Cell, ...]
    tabulate: Callable[[Data], Rows]
    draw: Callable[[Rows], Figure] | None = None
    claims: tuple[Claim, ...] = ()

    def thinned(self, seeds: int | None, quick: bool) -> Study:
        """With so many realisations in every cell that has more; and with quick settings.

        A setting's method `quick()`, where it has one, gives a shorter run of the same kind; what
        takes long even then is done twice, or once, only.
        """
        cells = []
        for cell in self.cells:
            setting, cost = cell.setting, cell.cost
            if quick and hasattr(setting, "quick"):
                setting, cost = setting.quick(), cost / _QUICKER
            count = cell.seeds if seeds is None else min(cell.seeds, seeds)
            if quick and cost > _LONG:
                count = min(count, 1 if cost > _VERY_LONG else 2)
            cells.append(replace(cell, setting=setting, seeds=count, cost=cost))
        return replace(self, cells=tuple(cells))


def write_rows(
    path: Path, rows: Sequence[dict[str, Any]], columns: Sequence[str] | None = None
) -> None:
    """Save rows as CSV.

    Parameters
    ----------
    columns : sequence of str, optional
        Needed when there may be no rows.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(columns or rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows([{key: _plain(value) for key, value in row.items()} for row in rows])
    try:
        with atomic_file(path) as file:
            file.write(text.getvalue().encode())
    except OSError as error:
        raise InputError(
            f"{path} cannot be written: {error.strerror}; "
            "allowed: a folder with room that you may write to"
        ) from error


def read_rows(path: Path) -> Rows:
    """Read what `write_rows` saved, as texts."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def _plain(value: Any) -> Any:
    """Six digits of a number: more would only make two machines' files differ."""
    return f"{value:.6g}" if isinstance(value, float) else value
