"""How every figure is drawn: to be read on a phone, by the colour-blind, and by who hears it.

Lines differ in style and marker, never in hue alone; a legend stands below what it explains; text
is large enough where the figure is as wide as a phone; and `alt` says in words what is seen.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

Array = NDArray[np.float64]

WIDTH, DPI = 5.0, 130
"""Of every figure [in], and dots per inch: 650 px."""
PHONE = 358
"""Pixels that a phone of 390 leaves between a page's margins."""
TEXT, SMALL = 12.0, 11.0
"""Of titles, and of the smallest text [pt]: 11 px where a figure is `PHONE` wide."""
INK, ACCENT, FAINT, GRID = "#1f2933", "#0b7285", "#7b8794", "#e9ecef"
_LONGEST = 40
"""Characters of a title's line."""
_MARKS = 8
"""Markers along a line, about."""
_SHADES = ("#0b3d6b", "#f1f3f5", "#e9a23b", "#b0306a")
"""Of areas: also told apart where there is no colour."""


class Look(NamedTuple):
    """A line's colour, style and marker."""

    colour: str
    line: str
    marker: str


# Okabe and Ito's colours, without the yellow that nobody sees on white.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#1f2933")
_LINES = ("-", "--", "-.", ":")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "*", "p")
REFERENCE = Look(INK, "--", "")
"""Of what is compared with: the only one without a marker."""


def look(number: int, kind: int = 0) -> Look:
    """The look of a figure's line, by its number.

    Of the same number and another kind colour and marker are the same, and the style is not.
    """
    return Look(
        _COLOURS[number % len(_COLOURS)], _LINES[(number + kind) % len(_LINES)],
        _MARKERS[number % len(_MARKERS)],
    )  # fmt: skip


def shades(count: int) -> list[str]:
    """Colours of areas that differ in lightness, too."""
    if count <= len(_SHADES):
        return list(_SHADES[:count])
    return [to_hex(colour) for colour in colormaps["cividis"](np.linspace(0.0, 1.0, count))]


def panels(
    height: float, rows: int = 1, columns: int = 1, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """A figure and its axes, row by row; what it shares goes to `Figure.subplots`."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(rows, columns, squeeze=False, **shared).ravel())


def dress(axes: Axes, title: str = "", x: str = "", y: str = "") -> None:
    """Give axes their words, and their text its size."""
    if title:
        axes.set_title(textwrap.fill(title, _LONGEST), loc="left", fontsize=TEXT, color=INK)
    for axis, words, longest in ((axes.xaxis, x, _LONGEST), (axes.yaxis, y, _LONGEST // 2)):
        if words:
            axis.set_label_text(textwrap.fill(words, longest), fontsize=SMALL)
        axis.get_offset_text().set_fontsize(SMALL)
    axes.tick_params(which="both", labelsize=SMALL)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(True, color=GRID)
    axes.set_axisbelow(True)


def one(title: str, x: str, y: str, height: float = 2.8) -> tuple[Figure, Axes]:
    """A figure with one pair of axes, dressed."""
    figure, (axes,) = panels(height)
    dress(axes, title, x, y)
    return figure, axes


def draw(axes: Axes, x: Any, y: Any, how: Look, label: str = "", **more: Any) -> None:
    """Draw a line with a few markers along it."""
    every = max(1, len(np.atleast_1d(x)) // _MARKS)
    axes.plot(
        x, y, how.line, color=how.colour, marker=how.marker, markevery=every, ms=5, lw=1.5,
        label=label or None, **more,
    )  # fmt: skip


def band(axes: Axes, x: Any, low: Any, high: Any, how: Look) -> None:
    """Fill between two limits of a line."""
    axes.fill_between(x, low, high, color=how.colour, alpha=0.15, lw=0)


def legend(figure: Figure, areas: Sequence[Patch] = ()) -> None:
    """Say what is what, below the figure, which grows by that much; areas have no axes."""
    found: dict[Any, Any] = {area.get_label(): area for area in areas}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, handle)
    if not found:
        return
    canvas: Any = figure.canvas
    room = figure.get_figwidth() * figure.dpi
    for columns in range(min(len(found), 4), 0, -1):
        made = figure.legend(
            list(found.values()), list(found), loc="outside lower center", ncols=columns,
            fontsize=SMALL, frameon=False, handlelength=2.8, columnspacing=1.2,
        )  # fmt: skip
        size = made.get_window_extent(canvas.get_renderer())
        if size.width <= room or columns == 1:
            break
        made.remove()
    figure.set_figheight(figure.get_figheight() + size.height / figure.dpi)


def say(axes: Axes, words: str) -> None:
    """Tell `alt` what is seen there, where that is more than lines with names."""
    axes.set_label(words)


def alt(figure: Figure) -> str:
    """What a figure shows, in words and numbers."""
    parts = [_told(axes) for axes in figure.axes if not str(axes.get_label()).startswith("<")]
    return ". ".join(part for part in parts if part) + "."


def _told(axes: Axes) -> str:
    title = " ".join(axes.get_title("left").split())
    words = str(axes.get_label()) or "; ".join(_lines(axes))
    return f"{title}: {words}" if title and words else title or words


def _lines(axes: Axes) -> Iterator[str]:
    y, x = axes.get_ylabel().replace("\n", " "), axes.get_xlabel().replace("\n", " ")
    for count, line in enumerate(axes.get_lines()):
        label = str(line.get_label())
        told = _line("" if label.startswith("_") else label, line)
        if told:
            scales = " over ".join(words for words in (y, x) if words)
            yield told + (f" ({scales})" if scales and not count else "")


def _line(label: str, line: Line2D) -> str:
    values = np.asarray(line.get_ydata(), float)
    values = values[np.isfinite(values)]
    if not len(values):
        return ""
    first, last, low, high = values[0], values[-1], values.min(), values.max()
    if low == high:
        return f"{label} stays at {number(low)}".strip()
    text = f"{label} from {number(first)} to {number(last)}".strip()
    if {low, high} == {first, last}:
        return text
    return f"{text}, between {number(low)} and {number(high)}"


def number(value: float) -> str:
    """Four digits that count, and no power of ten where a person needs none."""
    if value and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.3e}"
    return np.format_float_positional(value, 4, fractional=False, trim="-")


def shares(names: Sequence[str], counts: Any) -> str:
    """Parts of a whole in words, those that are nothing left out."""
    parts = np.asarray(counts, float) / max(float(np.sum(counts)), 1.0)
    return ", ".join(f"{n} {p:.0%}" for n, p in zip(names, parts, strict=True) if p)


def png(figure: Figure) -> bytes:
    """A figure as a picture."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()
