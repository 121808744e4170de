"""What a result depends on besides its setting and seed: code and libraries."""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
import platform
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOMS = ("iolspi_ros.core", "iolspi_ros.methods", "iolspi_ros.experiments", "sim_nodes")
"""Where code that computes results lives; what it imports from elsewhere only helps it along."""
_TABLES = ("sim_nodes.tasks",)
"""Modules that only list others: what a setting holds says which of those count."""
_LIBRARIES = ("numpy", "scipy", "numba")


@cache
def libraries() -> dict[str, str]:
    """Versions of the libraries that compute, and of Python."""
    found = {name: version(name) for name in _LIBRARIES}
    return {"python": ".".join(platform.python_version_tuple()[:2]), **found}


@cache
def code(module: str) -> str:
    """Digest of a module and of all that it imports from `ROOMS`, comments and docstrings aside."""
    seen: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in seen:
            tree = ast.parse(_source(name))
            seen[name] = ast.dump(_Bare().visit(tree))
            waiting += _imported(tree)
    return hashlib.sha256(repr(sorted(seen.items())).encode()).hexdigest()


def fingerprint(realise: Callable[..., Any], setting: Any) -> str:
    """Name of whatever makes a realisation, the seed aside.

    Parameters
    ----------
    realise : callable
        A module's own function.
    setting : dataclass
        With numbers, texts, tuples and such dataclasses in it; the code of these counts too, and
        so do the bytes of the files that its `inputs()` names, if it has that.
    """
    modules = {realise.__module__, *(type(part).__module__ for part in _parts(setting))}
    facts = (
        realise.__module__, realise.__qualname__, sorted(map(code, modules)), describe(setting),
        libraries(),
    )  # fmt: skip
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for path in getattr(setting, "inputs", tuple)():
        digest.update(Path(path).read_bytes())
    return digest.hexdigest()[:20]


def describe(setting: Any) -> dict[str, Any]:
    """A setting as JSON can hold it, with the names of its classes."""
    values = {field.name: getattr(setting, field.name) for field in fields(setting)}
    found = {k: describe(v) if is_dataclass(v) else v for k, v in values.items()}
    return {"kind": type(setting).__qualname__, **found}


def _parts(setting: Any) -> Iterator[Any]:
    """The dataclasses that a setting is made of, itself among them."""
    yield setting
    for field in fields(setting):
        value = getattr(setting, field.name)
        if is_dataclass(value):
            yield from _parts(value)


class _Bare(ast.NodeTransformer):
    """Takes texts that stand as statements, which are docstrings, out of a tree."""

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        text = isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        return None if text else node


def _source(module: str) -> str:
    found = importlib.util.find_spec(module)
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).read_text(encoding="utf-8")


def _imported(tree: ast.AST) -> list[str]:
    """Modules of `ROOMS` that a tree imports."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            # `from package import module` names a module only together.
            names += [f"{node.module}.{alias.name}" for alias in node.names]
            names.append(node.module)
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
    inside = {name for name in names if name.startswith(ROOMS)} - set(_TABLES)
    return [name for name in sorted(inside) if _is_module(name)]


def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
