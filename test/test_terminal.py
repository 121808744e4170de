"""The board drawn with characters."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from msg_bridge.cockpit import terminal
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.terminal import LEVELS, bar, braille, extent, spark


def dots(lines):
    """Column and row of each dot that is set, by the layout of Unicode's Braille block."""
    bits = {(0, 0): 0, (0, 1): 1, (0, 2): 2, (1, 0): 3, (1, 1): 4, (1, 2): 5, (0, 3): 6, (1, 3): 7}
    return {
        (2 * column + x, 4 * row + y)
        for row, line in enumerate(lines) for column, character in enumerate(line)
        for (x, y), bit in bits.items() if (ord(character) - 0x2800) >> bit & 1
    }  # fmt: skip


def shape(kind, points, size=(0.0, 0.0)):
    """What is drawn in a plane, however far away it is."""
    deep = [[x, 3.0, z] for x, z in points]
    return {"name": "x", "kind": kind, "points": deep, "size": [size[0], 9.0, size[1]]}


@pytest.mark.parametrize(("point", "at"), [
    ([0.0, 0.0], (0, 0)), ([7.0, 0.0], (7, 0)), ([0.0, -7.0], (0, 7)), ([7.0, -7.0], (7, 7)),
    ([3.0, -5.0], (3, 5)),
])  # fmt: skip
def test_a_point_is_where_it_belongs_with_z_upwards(point, at):
    """A box of 7 m each way on 8 by 8 dots: a metre is a dot."""
    assert dots(braille([shape("ball", [point])], (0.0, 7.0, -7.0, 0.0), 4, 2)) == {at}


def test_lines_have_no_holes_and_boxes_are_filled():
    box = (0.0, 7.0, -7.0, 0.0)
    line = dots(braille([shape("line", [[0.0, 0.0], [7.0, -7.0]])], box, 4, 2))
    assert line == {(k, k) for k in range(8)}
    filled = dots(braille([shape("box", [[3.0, -3.0]], (2.0, 4.0))], box, 4, 2))
    assert filled == {(x, y) for x in range(2, 5) for y in range(1, 6)}


def test_what_hangs_may_swing_all_around_within_the_picture():
    rod = shape("line", [[0.0, 0.0], [3.0, 4.0]])
    assert extent([rod]) == (-5.0, 5.0, -5.0, 5.0)


@given(st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), max_size=50))
def test_sparks_are_one_for_each_number_and_in_their_order(values):
    drawn = spark(values)
    assert len(drawn) == len(values)
    known = [(v, c) for v, c in zip(values, drawn, strict=True) if math.isfinite(v)]
    heights = [LEVELS.index(c) for _, c in sorted(known)]
    assert heights == sorted(heights)


@given(st.floats(allow_nan=True))
def test_a_bar_is_as_wide_as_it_should_be(value):
    drawn = bar(value, -1.0, 1.0, 21)
    if math.isfinite(value):
        assert len(drawn) == 21
        assert drawn.index("●") == round(20 * (min(max(value, -1.0), 1.0) + 1.0) / 2.0)
    assert bar(2.5, -math.inf, 1.0) == "2.5"


def test_every_board_can_be_shown():
    board = Board()
    assert "waiting for a vehicle" in shown(board)
    variables = [{"name": "x [m]", "low": -1.0, "high": 1.0}]
    board.put("task", {"name": "boat_race", "variables": variables})
    assert "boat race" in shown(board)
    board.put("now", {"episode": 3, "step": 4, "who": "shield", "state": [0.5], "reward": None})
    board.put("scores", [[2, -7.5, True, 0]])
    board.put("health", [{"name": "learner: learning", "level": 1, "text": "not well"}])
    text = shown(board)
    for words in ("shield", "x [m]", "●", "-7.5", "not well"):
        assert words in text
    assert terminal.line_of(board) == "boat_race; episode 3, step 4: shield; last score -7.5"


def shown(board):
    console = Console(width=120)
    with console.capture() as capture:
        console.print(terminal.view_of(board))
    return capture.get()
