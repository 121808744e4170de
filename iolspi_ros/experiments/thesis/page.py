"""The page that holds T's statements beside what was measured, made from what is saved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from iolspi_ros import __version__, figures
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.thesis.claims import OURS, Claim, Finding, Verdict, shortfall, verdict
from iolspi_ros.experiments.thesis.study import Rows, Study, read_rows, write_rows
from iolspi_ros.experiments.versions import libraries
from iolspi_ros.folders import atomic_file

CLAIMS = "claims.csv"
_COLUMNS = ("where", "claim", "setting", "realisations", "measured", "verdict", "why")
CLAIM_COLUMNS = ("study", *_COLUMNS)


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
            "realisations": max((cell.seeds for cell in study.cells), default=0),
            "measured": "; ".join(finding.describe() for finding in findings),
            "verdict": verdict(findings).value,
            "why": _why(claim, findings),
        }
        for claim in study.claims
        for findings in [claim.decide(data)]
    ]


def _why(claim: Claim, findings: list[Finding]) -> str:
    """What keeps a claim from being reproduced, as far as measured."""
    short = shortfall(findings)
    return f"{claim.why}. {short}" if short and claim.why else short


def draw(study: Study, folder: Path) -> None:
    """Draw a study's figure from its saved rows, if it has one."""
    if study.draw is None:
        return
    figure = study.draw(read_rows(folder / f"{study.name}.csv"))
    try:
        with atomic_file(folder / f"{study.name}.png") as out:
            out.write(figures.png(figure))
    except OSError as error:
        raise InputError(
            f"figures cannot be written to {folder}: {error.strerror}; "
            "allowed: a folder with room that you may write to"
        ) from error


def write(studies: Sequence[Study], folder: Path) -> Path:
    """Write thesis.md beside the folder that holds rows and figures, from those alone.

    Raises
    ------
    InputError
        When it cannot be written.
    """
    chapters: dict[str, list[Study]] = {}
    for study in studies:
        chapters.setdefault(_chapter(study), []).append(study)
    rows = read_rows(folder / CLAIMS)
    decided = {
        title: [row for row in rows if row["study"] in {study.name for study in members}]
        for title, members in chapters.items()
    }
    made = f"iolspi_ros {__version__}, " + ", ".join(f"{k} {v}" for k, v in libraries().items())
    lines = [*_HEAD, f"Computed with {made}.", "", *_counts(decided)]
    for title, members in chapters.items():
        lines += [f"## {title}", "", *_table(decided[title])]
        for study in members:
            lines += [f"### {study.name}: {study.title}", "", f"T {study.where}.", ""]
            if study.draw is not None:
                seen = figures.alt(study.draw(read_rows(folder / f"{study.name}.csv")))
                lines += [f"![{_plainly(seen)}]({folder.name}/{study.name}.png)", ""]
            else:
                lines += _plain(read_rows(folder / f"{study.name}.csv"))
    path = folder.with_suffix(".md")
    try:
        with atomic_file(path) as file:
            file.write("\n".join(lines).encode())
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}") from error
    return path


_HEAD = (
    "# The thesis, claim by claim",
    "",
    "Made by `iolspi reproduce` from the CSV files beside its figures; nothing here is written by "
    "hand. T is the thesis (see `architecture.md`); its figures did not survive, so its words are "
    "compared. Each claim is decided by 95 % intervals over realisations (T 9-16, 9-17), mostly "
    "of a difference taken seed by seed: *reproduced* when every part of it holds for the whole "
    "interval, *not* when none does, *partly* when some parts hold or an interval leaves it open. "
    "n is the largest number of realisations of its settings; a figure's legend gives each "
    "curve's. The demonstrations are those of a scripted pilot, where T had a person. T leaves δ "
    "open and flies every solve; here δ = 1, and an unhealthy solve is not used (see "
    "`architecture.md`), which can decide a claim. "
    "Curves of one setting share colour and marker; those called refreshed are the refreshed "
    "learner, of fewer realisations, and the dashed black line without markers is the "
    "near-optimal policy, without exploration. The other methods that T reviews are in "
    "`methods.md`.",
    "",
)


_CHAPTERS = {
    "Part I": "Part I: pendulum and slung load",
    "5-": "Chapter 5: Q-learning on a grid",
    "6-": "Chapter 6: the drop-off in three dimensions",
    "Appendix A": "Appendix A: parameters of Q-learning",
    "8-": "Chapter 8: the cart-pole",
    "9-": "Chapter 9: forgetting, and the number of realisations",
    "10-": "Chapter 10: further results for the pendulum",
    "11-": "Chapter 11: the slung load from narrow starts",
}


def _chapter(study: Study) -> str:
    titles = (title for begin, title in _CHAPTERS.items() if study.where.startswith(begin))
    return next(titles, "What T does not say")


def _counts(decided: Mapping[str, Rows]) -> list[str]:
    """How many of T's claims came to which verdict, by chapter."""
    lines = [
        "| | claims of T | " + " | ".join(verdict.value for verdict in Verdict) + " |",
        "| --- " * (2 + len(Verdict)) + "|",
    ]
    everything = [row for rows in decided.values() for row in rows]
    for title, rows in {**decided, "all": everything}.items():
        said = [row["verdict"] for row in rows if row["where"] != OURS]
        if said:
            numbers = [len(said), *(said.count(verdict.value) for verdict in Verdict)]
            lines.append(f"| {title} | " + " | ".join(map(str, numbers)) + " |")
    return [*lines, ""]


def _table(claims: Rows) -> list[str]:
    if not claims:
        return []
    return [
        "| where | claim | setting | n | measured: mean (95 %; wanted) | verdict | why |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *("| " + " | ".join(_escaped(row[key]) for key in _COLUMNS) + " |" for row in claims),
        "",
    ]


def _plain(rows: Rows) -> list[str]:
    """Rows of a table of T, as they are."""
    head = list(rows[0])
    return [
        "| " + " | ".join(name.replace("_", " ") for name in head) + " |",
        "| --- " * len(head) + "|",
        *("| " + " | ".join(_escaped(_short(row[name])) for name in head) + " |" for row in rows),
        "",
    ]


def _short(text: str) -> str:
    """Five digits of what is 1 or more: the file has them all."""
    try:
        value = float(text)
    except ValueError:
        return text
    return f"{value:.5g}" if abs(value) >= 1.0 and "." in text else text


def _plainly(text: str) -> str:
    """What may stand between a link's brackets."""
    return text.replace("[", "(").replace("]", ")")


def _escaped(text: str) -> str:
    return text.replace("|", "\\|")
