"""T Part I, the conference paper: the pendulum's figures 2 to 19 and table 1."""

from __future__ import annotations

from collections.abc import Callable

from iolspi_ros.experiments.engine import Cell, Data
from iolspi_ros.experiments.learning import Learning
from iolspi_ros.experiments.samplesets import MODES
from iolspi_ros.experiments.thesis import curves, drawing
from iolspi_ros.experiments.thesis.claims import Claim, Finding, above
from iolspi_ros.experiments.thesis.curves import gain
from iolspi_ros.experiments.thesis.study import Study

SETS = {f"set {number}": Learning(samples=f"set {number}") for number in MODES}


def pair(
    names: tuple[str, str],
    title: str,
    where: str,
    cells: tuple[Cell, ...],
    claims: tuple[tuple[Claim, ...], tuple[Claim, ...]] = ((), ()),
    low: tuple[float | None, float | None] = (-2000.0, None),
) -> list[Study]:
    """T's two figures of one sweep: discounted return of the policies, and learning score."""
    kinds = (
        (curves.returns, "discounted return"),
        (curves.scores, "learning score (sum of rewards per episode)"),
    )
    return [
        Study(name, f"{title}: {y}", where, cells, tabulate, drawing.curves(title, y, least), found)
        for name, (tabulate, y), least, found in zip(names, kinds, low, claims, strict=True)
    ]


def studies() -> list[Study]:
    """Every study of this part, in T's order."""
    return [*_sets()]


def _sets() -> list[Study]:
    swept = curves.cells(SETS, also_refreshed=("set 1", "set 5"))
    claim = Claim(
        "Set 5 (33 % corrupted, explore) is better than the uncorrupted sets 1 and 2",
        "Part I, IV-A-2, Fig. 4",
        "discounted return, mean over the run",
        _better("set 5", ("set 1", "set 2")),
    )
    return pair(
        ("fig4", "fig5"),
        "IOLSPI from demonstration sets",
        "Part I, IV-A-2, Figs. 4 and 5",
        swept,
        ((claim,), ()),
    )


def _better(first: str, others: tuple[str, ...]) -> Callable[[Data], list[Finding]]:
    def decide(data: Data) -> list[Finding]:
        return [
            above(f"{first} over {other}", gain(data, first, other, "discounted", 0.0, 600.0))
            for other in others
        ]

    return decide
