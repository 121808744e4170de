"""Expressions of a file: what they compute, and that nothing of them is ever run."""

import math
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.errors import InputError
from iolspi_ros.task.expressions import Expression
from iolspi_ros.task.rules import read_rules

NAMES = ["x", "shaft.position", "next.x", "action"]
VALUES = {"x": 2.0, "shaft.position": 0.5, "next.x": -1.0, "action": 1}
TASK = {
    "name": "t", "variables": [{"name": "x"}], "actions": [{"name": "a", "value": 3.0}],
    "sampling_time": 0.1,
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-(x ** 2) - 0.1 * abs(next.x)", -4.1),
        ("hypot(3, 4) + shaft.position", 5.5),
        ("1 if x > 1 and not next.x > 0 else 0", 1),
        ("0 < x <= 2", True),
        ("wrap(3 * pi / 2)", -math.pi / 2),
        ("min(x, next.x, 7) % 2", 1.0),
        (3.5, 3.5),
        ("true", True),
    ],
)
def test_what_they_come_to(text, value):
    assert Expression(text, NAMES, "reward")(VALUES) == pytest.approx(value)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6))
def test_as_python_computes(x, y):
    found = Expression("x * next.x - (x if x > next.x else next.x) / 3", NAMES, "e")
    assert found(VALUES | {"x": x, "next.x": y}) == x * y - max(x, y) / 3


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x +", "invalid syntax"),
        ("next.y", "there is no next.y; did you mean next.x?"),
        ("sine(x)", "there is no function sine; did you mean sin?"),
        ("__import__('os').system('touch /tmp/x')", "there is no function"),
        ("(1).__class__", "in it"),
        ("x.__class__", "there is no x.__class__"),
        ("open('/etc/passwd')", "there is no function open"),
        ("'a' * 10", "it has 'a' in it"),
        ("[x for x in (1, 2)]", "it has a listcomp in it"),
        ("lambda: x", "it has a lambda in it"),
        ("(x := 3)", "it has a namedexpr in it"),
        ("abs(*x)", "one after the other"),
        ("x" * 2000, "at most 1000 characters"),
        ("+".join(["x"] * 400), "more than 300 pieces"),
        ("(" * 300 + "x" + ")" * 300, "allowed"),
        (["x"], "an expression"),
        ("", "an expression"),
    ],
)
def test_what_is_no_expression_is_refused_before_anything_is_computed(text, says):
    with pytest.raises(InputError) as error:
        Expression(text, NAMES, "reward")
    assert says in str(error.value)
    assert "reward is" in str(error.value)
    assert not os.path.exists("/tmp/x-touched")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("1 / (x - 2)", "division by zero; there x = 2"),
        ("log(next.x)", "there next.x = -1"),
        ("9 ** 9 ** 9 ** 9", "there always"),
        ("1e308 * 10 * x", "is inf; there x = 2"),
        ("next.x ** 0.5", "no real number"),
        ("sin(x, x)", "there x = 2"),
    ],
)
def test_what_cannot_be_computed_is_said_with_the_values(text, says):
    with pytest.raises(InputError) as error:
        Expression(text, NAMES, "reward").number(VALUES)
    assert says in str(error.value)


def test_rules_judge_steps_and_the_first_ending_that_fits_counts():
    content = {
        **TASK, "reward": "-x * value", "truncated": "next.x > 50",
        "endings": [
            {"name": "time-out"},
            {"name": "there", "when": "next.x < 1", "reward": 10, "success": True},
            {"name": "lost", "when": "next.x > 100"},
        ],
    }  # fmt: skip
    task, rules = read_rules(content, "file")
    assert rules.judge([2.0], 0, [3.0]) == (-6.0, False, False)
    assert rules.judge([2.0], 0, [0.5]) == (10.0, True, False)
    assert rules.judge([2.0], 0, [101.0]) == (-6.0, True, False)
    assert rules.judge([2.0], 0, [51.0]) == (-6.0, False, True)
    assert task.endings[task.ending(10.0, True)].success


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({}, "no reward; it must have one"),
        ({"reward": "y"}, "there is no y"),
        ({"reward": 0, "terminated": "x >"}, "terminated is"),
        ({"reward": 0, "endings": [{"name": "a", "when": "x > 1"}]}, "which is the clock's"),
        ({"reward": 0, "endings": [{"name": n} for n in "abc"]}, "tell them apart"),
        ({"reward": 0, "wings": 2}, "'wings'; allowed"),
    ],
)
def test_rules_that_will_not_do_are_named(more, says):
    with pytest.raises(InputError) as error:
        read_rules(TASK | more, "my.yaml")
    assert says in str(error.value)
    assert "my.yaml" in str(error.value)
