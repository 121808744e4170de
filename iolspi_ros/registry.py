"""Parts that others may add: by name from an entry-point group, or as `module:Class`."""

from __future__ import annotations

import importlib
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from iolspi_ros.errors import InputError


@cache
def _registered(group: str) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=group)}


def names(group: str) -> tuple[str, ...]:
    """Names registered in an entry-point group, sorted."""
    return tuple(sorted(_registered(group)))


def find(group: str, what: str, name: str) -> Any:
    """What is registered under a name, or what `module:Class` names.

    Parameters
    ----------
    group : str
        Entry-point group.
    what : str
        What it is, for messages.
    name : str

    Raises
    ------
    InputError
        When there is none; lists those that there are.
    """
    module, colon, member = name.partition(":")
    try:
        if colon:
            return getattr(importlib.import_module(module), member)
        if name in _registered(group):
            return _registered(group)[name].load()
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(
            f"{what} {name!r} cannot be imported: {error}; allowed: {', '.join(names(group))}, or "
            "module:Class of a module on the PYTHONPATH"
        ) from error
    raise InputError(
        f"{what} is {name!r}; allowed: {', '.join(names(group))}, or module:Class "
        f"(entry-point group {group})"
    )
