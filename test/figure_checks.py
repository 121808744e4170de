"""What every figure must be: readable on a phone, by the colour-blind, and by who hears it."""

import itertools
import re

from matplotlib.text import Text

from iolspi_ros import figures

LEAST = 10.5
"""Pixels of the smallest text on a phone."""


def axes_of(figure):
    """Second scales, too."""
    return [one for axes in figure.axes for one in (axes, *axes.child_axes)]


def texts_of(figure):
    """Every text that is drawn."""
    ticks = {text for axes in axes_of(figure) for axis in (axes.xaxis, axes.yaxis)
             for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]
             for text in (tick.label1, tick.label2)}  # fmt: skip
    for axes in axes_of(figure):
        for axis in (axes.xaxis, axes.yaxis):
            for tick in axis._update_ticks():
                ticks -= {tick.label1, tick.label2}
    return [
        text for text in figure.findobj(Text)
        if text.get_visible() and text.get_text().strip() and text not in ticks
    ]  # fmt: skip


def check(figure):
    """Fails with what is wrong; returns the words for who does not see it."""
    figure.draw_without_rendering()
    renderer, whole = figure.canvas.get_renderer(), figure.bbox
    for text in texts_of(figure):
        size = text.get_fontsize() * figures.PHONE / (72.0 * figure.get_figwidth())
        assert size >= LEAST, f"{text.get_text()!r} is {size:.1f} px on a phone"
        box = text.get_window_extent(renderer)
        assert box.x0 >= whole.x0 - 1, f"{text.get_text()!r} is cut off"
        assert box.x1 <= whole.x1 + 1, f"{text.get_text()!r} is cut off"
        assert box.y0 >= whole.y0 - 1, f"{text.get_text()!r} is cut off"
        assert box.y1 <= whole.y1 + 1, f"{text.get_text()!r} is cut off"
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            apart(axis, renderer)
        looks = {}
        for line in axes.get_lines():
            if not line.get_label().startswith("_"):
                look = (line.get_linestyle(), line.get_marker())
                assert look not in looks, f"{line.get_label()!r} looks like {looks[look]!r}"
                looks[look] = line.get_label()
        assert axes.get_window_extent(renderer).height > 0.15 * whole.height / len(figure.axes)
    for legend in [*figure.legends, *filter(None, (axes.get_legend() for axes in figure.axes))]:
        box = legend.get_window_extent(renderer)
        assert box.width <= whole.width + 1
        for axes in figure.axes:
            assert not box.overlaps(axes.get_window_extent(renderer)), "a legend covers the data"
    words = figures.alt(figure)
    assert len(words) > 30
    assert re.search(r"\d", words), words
    return words


def apart(axis, renderer):
    """Labels of ticks that run into each other are no labels."""
    boxes = [
        tick.label1.get_window_extent(renderer)
        for tick in axis._update_ticks() if tick.label1.get_text() and tick.label1.get_visible()
    ]  # fmt: skip
    for one, other in itertools.pairwise(boxes):
        assert not one.overlaps(other), "labels of ticks overlap"
