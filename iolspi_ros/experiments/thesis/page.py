"""The page that holds T's statements beside what was measured, made from what is saved."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from iolspi_ros import __version__
from iolspi_ros.core.checkpoint import atomic_file
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.engine import Data
from iolspi_ros.experiments.thesis.claims import verdict
from iolspi_ros.experiments.thesis.study import Rows, Study, read_rows, write_rows
from iolspi_ros.experiments.versions import libraries

CLAIMS = "claims.csv"


def save(study: Study, data: Data, folder: Path) -> Rows:
    """Write a study's rows, draw its figure from the file, and decide its claims.

    Returns
    -------
    list of dict
        A row for each claim.
    """
    file = folder / f"{study.name}.csv"
    write_rows(file, study.tabulate(data))
    draw(study, folder)
    return [
        {
            "study": study.name,
            "where": claim.where,
            "claim": claim.text,
            "setting": claim.setting,
            "realisations": max((cell.seeds for cell in study.cells), default=1),
            "measured": "; ".join(finding.describe() for finding in findings),
            "verdict": verdict(findings).value,
            "why": claim.why if verdict(findings).value != "reproduced" else "",
        }
        for claim in study.claims
        for findings in [claim.decide(data)]
    ]


def draw(study: Study, folder: Path) -> None:
    """Draw a study's figure from its saved rows, if it has one."""
    if study.draw is None:
        return
    figure = study.draw(read_rows(folder / f"{study.name}.csv"))
    try:
        with atomic_file(folder / f"{study.name}.png") as out:
            figure.savefig(out, format="png", dpi=80)
    except OSError as error:
        raise InputError(
            f"figures cannot be written to {folder}: {error.strerror}; "
            "allowed: a folder with room that you may write to"
        ) from error


def write(studies: Sequence[Study], folder: Path) -> Path:
    """Write thesis.md beside the folder that holds rows and figures, from those alone."""
    claims = read_rows(folder / CLAIMS)
    verdicts = [row["verdict"] for row in claims]
    counts = ", ".join(f"{verdicts.count(v)} {v}" for v in ("reproduced", "partly", "not"))
    made = f"iolspi_ros {__version__}, " + ", ".join(f"{k} {v}" for k, v in libraries().items())
    lines = [
        "# The thesis, claim by claim", "",
        f"{len(claims)} claims: {counts}. Made by `iolspi reproduce` ({made}).", "",
        "| where | claim | setting | n | measured | verdict | why |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *("| " + " | ".join(_cell(row[key]) for key in _COLUMNS) + " |" for row in claims),
        "",
    ]  # fmt: skip
    for study in studies:
        lines += [f"## {study.name}: {study.title}", "", f"T {study.where}.", ""]
        if study.draw is not None:
            lines += [f"![{study.title}]({folder.name}/{study.name}.png)", ""]
    path = folder.with_suffix(".md")
    with atomic_file(path) as file:
        file.write("\n".join(lines).encode())
    return path


_COLUMNS = ("where", "claim", "setting", "realisations", "measured", "verdict", "why")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
