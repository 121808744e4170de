"""Learners side by side: tables of T Table 4-1's kind, a document and a page."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros import __version__, figures
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.compare import JUMP_CASE, Case
from iolspi_ros.experiments.results import Store
from iolspi_ros.experiments.thesis.study import Rows, read_rows, write_rows
from iolspi_ros.experiments.versions import libraries
from iolspi_ros.folders import atomic_file
from iolspi_ros.methods.traits import TRAITS
from iolspi_ros.report import page
from iolspi_ros.report.curves import PICTURES, picture
from iolspi_ros.report.measures import (
    DUNKS,
    IN_A_ROW,
    MOST,
    NEAR,
    measured,
    names_of,
    title_of,
)
from iolspi_ros.report.page import Part

KINDS = ("learner", "T", "learns", "model", "demonstrations", "adapts")


def overview(table: Rows) -> list[list[str]]:
    """A table of T Table 4-1's kind, the first row its head."""
    wanted = []
    for task in dict.fromkeys(row["task"] for row in table):
        cases = list(dict.fromkeys(r["case"] for r in table if r["task"] == task))
        wanted += [(task, case, "time") for case in cases]
        if any(str(r["crashes"]) not in ("", "0", "0.0") for r in table if r["task"] == task):
            wanted += [(task, case, "crashes_until") for case in cases if case != JUMP_CASE]
    head = [*KINDS, *(f"{_plain(task)}, {case}: {_WORDS[what]}" for task, case, what in wanted)]
    lines = [head]
    for learner in dict.fromkeys(row["learner"] for row in table):
        traits = TRAITS.get(learner)
        known = [
            traits.title, traits.source, traits.online, traits.model,
            _yes(traits.demonstrations), _yes(traits.adapts),
        ] if traits else [learner, *["?"] * 5]  # fmt: skip
        cells = []
        for task, case, what in wanted:
            own = [
                r for r in table if (r["task"], r["case"], r["learner"]) == (task, case, learner)
            ]
            cells.append(_cell(own[0], what) if own else "cannot")
        lines.append([*known, *cells])
    return lines


_WORDS = {"time": f"seconds to {NEAR:.0%}", "crashes_until": f"crashes until {DUNKS:.0%} succeed"}


CHOOSE = {
    "iolspi": "When rewards jump, as at a release, or vehicle time is dear; the default.",
    "sarsa": "When a microcontroller must learn, and what exploring costs shall count.",
    "q_learning": "When a step may cost microseconds alone, and vehicle time is cheap.",
    "policy_search": "When the policy must be a few numbers, for holding a setpoint.",
    "value_iteration": "When the dynamics are smooth and the state is small: then it needs least.",
    "continuous_value_iteration": "When the value is quadratic, and any action may be taken.",
    "automata": "When a few settings are chosen once, and each choice is rewarded soon.",
    "apprentice": "When an expert has flown, the state is of two variables, and none may explore.",
    "fitted_q": "When nothing is known of scales and limits, and a step moves far.",
    "dqn": "When the state is large, such as an image, and a simulator gives millions of steps.",
}


def choices(learners: Sequence[str]) -> list[list[str]]:
    """When each is the right choice."""
    known = [(name, TRAITS[name]) for name in learners if name in TRAITS]
    return [["learner", "name", "when it is the right choice"],
            *([traits.title, name, CHOOSE[name]] for name, traits in known)]  # fmt: skip


def details(table: Rows) -> list[list[str]]:
    """T's three metrics (T 4-4), and what they cost."""
    head = ["task", "case", "learner", "near in time", "time to learn [s]", "final return",
            "succeed", "reward a second", "crashes", "processor [s]"]  # fmt: skip
    lines = [head]
    for row in table:
        if row["seeds"] == "":
            continue
        lines.append([
            _plain(row["task"]), row["case"], title_of(row["learner"]),
            f"{row['reached']} of {row['seeds']}", _spread(row, "time"), _spread(row, "final"),
            _spread(row, "success"), _spread(row, "score"), _spread(row, "crashes"),
            _spread(row, "processor"),
        ])  # fmt: skip
    return lines


def _cell(row: dict[str, Any], what: str) -> str:
    if row["seeds"] == "":
        return "cannot"
    if what == "time":
        if not int(row["reached"]):
            return "never"
        got = "" if row["reached"] == row["seeds"] else f" ({row['reached']} of {row['seeds']})"
        return f"{float(row['time']):.3g}{got}"
    more = ">" if int(row["safe"]) < int(row["seeds"]) else ""
    return f"{more}{float(row[what]):.3g}"


def _spread(row: dict[str, Any], name: str) -> str:
    mean, low, high = (float(row[n]) for n in names_of(name))
    if not np.isfinite(mean):
        return "never"
    if not np.isfinite(low) or low == high:
        return f"{mean:.4g}"
    return f"{mean:.4g} ({low:.4g} to {high:.4g})"


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _plain(name: str) -> str:
    return name.replace("_", " ")


def save(cases: Sequence[Case], store: Store, out: Path) -> tuple[Rows, Path]:
    """Write rows, pictures, a document and the page.

    OUT/methods has the rows as CSV, the pictures, and measured.md, which shows them;
    OUT/report.html is the same as one page.

    Raises
    ------
    InputError
        When they cannot be written.
    """
    folder = out / "methods"
    table: Rows = []
    curves: Rows = []
    for case in cases:
        more, drawn = measured(case, store)
        table += more
        curves += drawn
    write_rows(folder / "table.csv", table)
    write_rows(folder / "curves.csv", curves)
    table = read_rows(folder / "table.csv")  # so that no number is rounded otherwise below
    document, parts = [*_HEAD, _made(), ""], []
    tables = (
        ("T's Table 4-1, with what was measured", overview(table), _SAYS_OVERVIEW),
        ("When each is the right choice", choices(_learners(table)), ""),
        ("T's three metrics", details(table), _SAYS_DETAILS),
    )
    for heading, lines, says in tables:
        document += [f"## {heading}", "", *([says, ""] if says else []), *_markdown(lines), ""]
        parts.append(Part("", _html(heading, lines, says)))
    for task in dict.fromkeys(case.task.name for case in cases):
        document += [f"## {_plain(task)}", ""]
        for kind in PICTURES:
            figure = picture(curves, task, kind)
            if figure is None:
                continue
            heading = f"{_plain(task)}: {_HEADINGS[kind]}"
            parts.append(Part(heading, figure, _SAYS[kind]))
            _write(folder / f"{task}-{kind}.png", figures.png(figure))
            document += [
                f"![{heading}: {figures.alt(figure)}]({task}-{kind}.png)", "",
            ]  # fmt: skip
    _write(folder / "measured.md", "\n".join(document).encode())
    facts = [
        (str(len(_learners(table))), "learners"),
        (", ".join(_plain(t) for t in dict.fromkeys(r["task"] for r in table)), "learned"),
        (str(max(int(row["seeds"] or 0) for row in table)), "seeds of each"),
    ]
    path = out / "report.html"
    page.write(
        path,
        "Learners side by side",
        _HEAD[2].replace("`", ""),
        facts,
        "",
        parts,
        {"made": _made()},
    )
    return table, path


def _learners(table: Rows) -> list[str]:
    return list(dict.fromkeys(row["learner"] for row in table))


def _made() -> str:
    versions = ", ".join(f"{name} {number}" for name, number in libraries().items())
    return f"Computed with iolspi_ros {__version__}, {versions}."


_HEAD = (
    "# Learners side by side",
    "",
    "Made by `iolspi compare` from the CSV files beside its pictures. Every learner flew the same "
    "vehicle, from the same seeds, through the same protocol, step by step, with the settings of "
    "the task's file in config/ and its own defaults besides. At equal times its greedy policy was "
    "flown from all starts on the model, learning turned off. The demonstrations are those of a "
    "scripted pilot.",
    "",
)
_SAYS_OVERVIEW = (
    f"Seconds of vehicle time until {IN_A_ROW} looks in a row found the greedy policy within "
    f"{NEAR:.0%} of the near-optimal return, or {MOST:.0%} successes where that return is 0; the "
    "mean of those seeds that got there, and how many did, if not all. *cannot*: the method does "
    "not take what the case has. *never*: not within the run. Behind > "
    "stands the mean of counts of which some went on to the end of the run."
)
_SAYS_DETAILS = (
    "T 4-4: time to learn, final performance, accumulated return, the last as reward a second "
    "while learning, exploration and all. Means over seeds and their 95 % intervals; final values "
    "are means of the last three looks. Processor seconds are the learner's alone, on one core."
)
_HEADINGS = {
    "returned": "return against vehicle time", "processor": "return against processor time",
    "success": "successes", "crashes": "crashes while learning",
}  # fmt: skip
_SAYS = {
    "returned": "Means over seeds; of few learners shaded is the 95 % interval (curves.csv has "
    "all). What is far below is left out.",
    "processor": "The same means against what the learner had taken of a core by then.",
    "success": "Share of the starts, means over seeds.",
    "crashes": "Means over seeds of all crashes so far.",
}


def _write(path: Path, content: bytes) -> None:
    try:
        with atomic_file(path) as file:
            file.write(content)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror}; allowed: a folder with "
                         "room that you may write to") from error  # fmt: skip


def _markdown(lines: Sequence[Sequence[str]]) -> list[str]:
    texts = ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines]
    return [texts[0], "| --- " * len(lines[0]) + "|", *texts[1:]]


def _html(heading: str, lines: Sequence[Sequence[str]], says: str) -> str:
    def row(cells: Sequence[str], kind: str) -> str:
        return "<tr>" + "".join(f"<{kind}>{html.escape(cell)}" for cell in cells)

    body = row(lines[0], "th") + "".join(row(line, "td") for line in lines[1:])
    told = says.replace("*", "")
    return (
        f"<h2>{html.escape(heading)}</h2><p class=say>{html.escape(told)}</p>"
        f"<div class=scroll><table>{body}</table></div>"
    )
