"""What is on a board, drawn with characters: for a machine without a browser."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Any

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from msg_bridge.cockpit.board import Board

WIDTH, HEIGHT = 44, 16
"""Characters of the picture; each holds 2 by 4 dots."""
LEVELS = "▁▂▃▄▅▆▇█"
SCORES = 40
"""Whose scores are shown: the last."""
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Of a Braille character, row by row."""
_MARKS = ("[green]●[/]", "[yellow]▲[/]", "[red]■[/]", "[red]■[/]")
Box = tuple[float, float, float, float]


def view_of(board: Board) -> RenderableType:
    """All of it."""
    task = board.get("task")
    if task is None:
        return Text("waiting for a vehicle that says its task")
    parts: list[RenderableType] = [_head(board), Columns([_picture(board), _numbers(board)])]
    if asks(board):
        parts.append(Text("the learner asks for help: take over", style="bold red"))
    parts += [Text(line, style="yellow") for line in board.get("advice") or []]
    if board.get("said"):
        parts.append(Text(board.get("said")["text"], style="dim"))
    if board.get("health"):
        parts.append(_health(board.get("health")))
    return Group(*parts)


def line_of(board: Board) -> str:
    """The most important of it in a line."""
    task, now, scores = (board.get(part) for part in ("task", "now", "scores"))
    if task is None:
        return "waiting for a vehicle that says its task"
    words = [task["name"]]
    if now:
        words.append(f"episode {now['episode']}, step {now['step']}: {now['who']}")
    if scores:
        words.append(f"last score {scores[-1][1]:.4g}")
    if asks(board):
        words.append("the learner asks for help")
    return "; ".join(words)


def asks(board: Board) -> bool:
    """Whether the learner asks for help."""
    return bool((board.get("help") or {}).get("asks"))


def _head(board: Board) -> Text:
    now = board.get("now") or {}
    text = Text(board.get("task")["name"].replace("_", " "), style="bold")
    return text.append(f"   {now.get('who', 'nobody yet')}", style="cyan")


def _numbers(board: Board) -> Table:
    now, update = board.get("now") or {}, board.get("update") or {}
    scores, rate = board.get("scores") or [], board.get("rate") or {}
    table = Table.grid(padding=(0, 2))
    rows = [("episode", now.get("episode")), ("step", now.get("step")),
            ("reward", now.get("reward")), ("last score", scores[-1][1] if scores else None),
            ("ε", update.get("epsilon")), ("updates", update.get("number")),
            ("samples", update.get("samples")), ("× real time", rate.get("factor"))]  # fmt: skip
    names = [variable["name"] for variable in board.get("task")["variables"]]
    rows += zip(names, now.get("state", [None] * len(names)), strict=True)
    for name, value in rows:
        table.add_row(Text(name, style="dim"), _number(value))
    if scores:
        table.add_row(Text("scores", style="dim"), spark([row[1] for row in scores[-SCORES:]]))
    return table


def _number(value: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if float(value).is_integer() else f"{value:.4g}"


def _picture(board: Board) -> RenderableType:
    shapes = board.get("picture")
    if shapes:
        return Panel("\n".join(braille(shapes, extent(shapes))), expand=False)
    now = board.get("now")
    if not now:
        return Panel("no state yet", expand=False)
    table = Table.grid(padding=(0, 1))
    for variable, value in zip(board.get("task")["variables"], now["state"], strict=True):
        table.add_row(variable["name"], bar(value, variable["low"], variable["high"]))
    return Panel(table, expand=False)


def _health(nodes: Sequence[dict[str, Any]]) -> Table:
    table = Table.grid(padding=(0, 1))
    for node in nodes:
        table.add_row(_MARKS[min(node["level"], 3)], node["name"].partition(":")[0], node["text"])
    return table


def spark(values: Sequence[float]) -> str:
    """Numbers as a row of blocks, the lowest of them the lowest."""
    known = [value for value in values if math.isfinite(value)]
    low, high = min(known, default=0.0), max(known, default=0.0)
    top = len(LEVELS) - 1
    span = (high - low) or 1.0
    return "".join(
        LEVELS[round(top * (value - low) / span)] if math.isfinite(value) else " "
        for value in values
    )


def bar(value: float, low: float, high: float, width: int = 30) -> str:
    """Where a number stands between its limits; as a number alone where they are infinite."""
    if not math.isfinite(high - low) or not math.isfinite(value):
        return f"{value:.4g}"
    share = min(max((value - low) / (high - low), 0.0), 1.0)
    at = round(share * (width - 1))
    return "─" * at + "●" + "─" * (width - 1 - at)


def extent(shapes: Sequence[dict[str, Any]]) -> Box:
    """Least x, greatest x, least z and greatest z of where shapes are or can swing to [m]."""
    xs, zs = [], []
    for shape in shapes:
        points = _from_the_side(shape)
        reach = [shape["size"][0] / 2, shape["size"][2] / 2]
        if shape["kind"] == "line":
            reach = [math.dist(points[0], points[-1])] * 2 if len(points) == 2 else [0.0, 0.0]
            points = points[:1] if len(points) == 2 else points
        xs += [x + sign * reach[0] for x, _ in points for sign in (-1, 1)]
        zs += [z + sign * reach[1] for _, z in points for sign in (-1, 1)]
    return min(xs), max(xs), min(zs), max(zs)


def braille(
    shapes: Sequence[dict[str, Any]], box: Box, width: int = WIDTH, height: int = HEIGHT
) -> list[str]:
    """Shapes as lines of Braille characters, in true proportion.

    Parameters
    ----------
    shapes : sequence of dict
        As the board has them.
    box : (x, x, z, z)
        What is to be seen [m].
    width, height : int
        Characters.
    """
    columns, rows = 2 * width, 4 * height
    scale = min((columns - 1) / max(box[1] - box[0], 1e-9), (rows - 1) / max(box[3] - box[2], 1e-9))
    middle = ((box[0] + box[1]) / 2, (box[2] + box[3]) / 2)
    cells = [[0] * width for _ in range(height)]
    for shape in shapes:
        for x, z in _dots(shape, 1.0 / scale):
            column = round((columns - 1) / 2 + scale * (x - middle[0]))
            row = round((rows - 1) / 2 - scale * (z - middle[1]))
            if 0 <= column < columns and 0 <= row < rows:
                cells[row // 4][column // 2] |= _DOTS[row % 4][column % 2]
    return ["".join(chr(0x2800 + cell) for cell in line) for line in cells]


def _dots(shape: dict[str, Any], step: float) -> list[tuple[float, float]]:
    """Points all over a shape, at most `step` apart [m]."""
    points = _from_the_side(shape)
    if shape["kind"] == "line":
        found = []
        for a, b in itertools.pairwise(points):
            n = max(1, math.ceil(math.dist(a, b) / step))
            found += [
                (a[0] + (b[0] - a[0]) * k / n, a[1] + (b[1] - a[1]) * k / n) for k in range(n + 1)
            ]
        return found
    (x, z), (w, _, h) = points[0], shape["size"]
    across, up = max(1, math.ceil(w / step)), max(1, math.ceil(h / step))
    inside = [(i / across - 0.5, j / up - 0.5) for i in range(across + 1) for j in range(up + 1)]
    inside.append((0.0, 0.0))
    if shape["kind"] == "ball":
        inside = [(u, v) for u, v in inside if u * u + v * v <= 0.25]
    return [(x + w * u, z + h * v) for u, v in inside]


def _from_the_side(shape: dict[str, Any]) -> list[tuple[float, float]]:
    """Its points, without how far away they are."""
    return [(x, z) for x, _, z in shape["points"]]
