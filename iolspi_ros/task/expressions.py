"""Expressions over named numbers, as a file writes them: arithmetic, comparisons, some functions.

A text is never run as Python. What it may hold is checked piece by piece when it is read, and
simpleeval, which knows only such pieces, computes it.
"""

from __future__ import annotations

import ast
import difflib
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

from iolspi_ros.errors import InputError

LONGEST, MOST_PIECES = 1000, 300
"""Characters and pieces of an expression at most."""


def _wrap(angle: float) -> float:
    """An angle in [-π, π)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi


def _clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


FUNCTIONS: dict[str, Callable[..., float]] = {
    "abs": abs, "min": min, "max": max, "sin": math.sin, "cos": math.cos, "tan": math.tan,
    "asin": math.asin, "acos": math.acos, "atan": math.atan, "atan2": math.atan2,
    "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "hypot": math.hypot,
    "sign": lambda value: math.copysign(1.0, value) if value else 0.0, "wrap": _wrap,
    "clip": _clip, "round": round,
}  # fmt: skip
CONSTANTS = {"pi": math.pi, "inf": math.inf, "true": True, "false": False}

_PIECES = (
    ast.BoolOp, ast.And, ast.Or, ast.UnaryOp, ast.Not, ast.USub, ast.UAdd, ast.BinOp, ast.Add,
    ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.Compare, ast.Eq, ast.NotEq,
    ast.Lt, ast.LtE, ast.Gt, ast.GtE, ast.IfExp, ast.Load,
)  # fmt: skip


class Expression:
    """One expression, ready to be computed many times.

    Parameters
    ----------
    text : str or number
    names : collection of str
        What it may speak of; such a name may have points in it.
    what : str
        What it is, for messages.

    Raises
    ------
    InputError
        Naming the expression, what is wrong with it, and what is allowed.
    """

    def __init__(self, text: Any, names: Collection[str], what: str) -> None:
        if isinstance(text, bool | int | float):
            text = str(text).lower()
        if not isinstance(text, str) or not 0 < len(text) <= LONGEST:
            raise InputError(
                f"{what} is {str(text)[:60]!r}; allowed: an expression of at most {LONGEST} "
                "characters"
            )
        self.text, self.what = text, what
        self._names = {name: f"v{number}" for number, name in enumerate(names)}
        self._root = self._checked()
        self._evaluator = _evaluator()

    def __call__(self, values: Mapping[str, Any]) -> Any:
        """What it comes to with some values.

        Raises
        ------
        InputError
            When it cannot be computed with these, as where it divides by zero.
        """
        self._evaluator.names = {short: values[name] for name, short in self._names.items()}
        self._evaluator.names |= CONSTANTS
        try:
            found = self._evaluator.eval(self.text, previously_parsed=self._root)
            if isinstance(found, complex):
                raise ValueError("it is no real number")
        except (ArithmeticError, ValueError, TypeError, self._evaluator.error) as error:
            shown = ", ".join(f"{name} = {_short(values[name])}" for name in self.used)
            raise InputError(
                f"{self.what} ({self.text}) cannot be computed: {error}; there {shown or 'always'}"
            ) from None
        return found

    def number(self, values: Mapping[str, Any]) -> float:
        """The same as a finite number.

        Raises
        ------
        InputError
            Also when it is none.
        """
        found = float(self(values))
        if not math.isfinite(found):
            shown = ", ".join(f"{name} = {_short(values[name])}" for name in self.used)
            raise InputError(f"{self.what} ({self.text}) is {found}; there {shown or 'always'}")
        return found

    @property
    def used(self) -> list[str]:
        """Names that it speaks of."""
        found = {n.id for n in ast.walk(self._root) if isinstance(n, ast.Name)}
        return [name for name, short in self._names.items() if short in found]

    # ------------------------------------------------------------ checking

    def _checked(self) -> ast.expr:
        try:
            root = ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            why = getattr(error, "msg", None) or str(error)
            raise self._error(why) from None
        if sum(1 for _ in ast.walk(root)) > MOST_PIECES:
            raise self._error(f"it has more than {MOST_PIECES} pieces")
        return self._check(root)

    def _check(self, node: ast.AST) -> Any:
        """The same node, with each name in its short form."""
        if isinstance(node, ast.Name | ast.Attribute):
            return ast.Name(self._short_name(node), ast.Load())
        if isinstance(node, ast.Constant):
            if not isinstance(node.value, int | float):
                raise self._error(f"it has {node.value!r} in it")
            return node
        if isinstance(node, ast.Call):
            return self._check_call(node)
        if not isinstance(node, _PIECES):
            raise self._error(f"it has a {type(node).__name__.lower()} in it")
        for field, value in ast.iter_fields(node):
            if isinstance(value, list):
                setattr(node, field, [self._check(one) for one in value])
            elif isinstance(value, ast.AST):
                setattr(node, field, self._check(value))
        return node

    def _check_call(self, node: ast.Call) -> ast.Call:
        name = node.func.id if isinstance(node.func, ast.Name) else ast.unparse(node.func)
        if name not in FUNCTIONS:
            raise self._error(f"there is no function {name}{_near(name, FUNCTIONS)}")
        if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
            raise self._error(f"{name} takes numbers, one after the other")
        node.args = [self._check(one) for one in node.args]
        return node

    def _short_name(self, node: ast.Name | ast.Attribute) -> str:
        name = _dotted(node)
        if name in self._names:
            return self._names[name]
        if name in CONSTANTS:
            return name
        if name is None:
            raise self._error(f"it has {ast.unparse(node)} in it")
        raise self._error(f"there is no {name}{_near(name, self._names)}")

    def _error(self, why: str) -> InputError:
        return InputError(
            f"{self.what} is {self.text!r}: {why}; allowed: numbers, "
            f"{', '.join(self._names) or 'pi'}, + - * / ** %, comparisons, and, or, not, A if B "
            f"else C, {', '.join(FUNCTIONS)}"
        )


def _evaluator() -> Any:
    """What computes; with `error`, which it raises."""
    try:
        from simpleeval import InvalidExpression, SimpleEval
    except ImportError:
        raise InputError(
            "expressions need simpleeval, which is not installed; allowed: pip install simpleeval"
        ) from None
    found = SimpleEval(functions=FUNCTIONS)
    found.error = InvalidExpression
    return found


def _dotted(node: ast.AST) -> str | None:
    """`a.b.c` as a text."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        before = _dotted(node.value)
        return None if before is None else f"{before}.{node.attr}"
    return None


def _near(name: str, known: Collection[str]) -> str:
    near = difflib.get_close_matches(name, known, 1)
    return f"; did you mean {near[0]}?" if near else ""


def _short(value: Any) -> str:
    return f"{float(value):.4g}"
