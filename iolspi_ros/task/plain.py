"""Plain values from YAML or JSON that anybody may have written: bounded before they are made.

Everything that is parsed here or anywhere else in the package goes through `parse`.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import yaml

from iolspi_ros.errors import InputError

LARGEST = 2**20
"""Characters of a JSON text at most."""
LARGEST_YAML = 2**16
"""Characters of a YAML text at most: of those, a second's worth."""
DEEPEST = 20
"""Lists and mappings within each other at most."""


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The one in C is ten times as fast, where it is there."""


# launch_ros writes lists of parameters so; it is a sequence as any other.
_Loader.add_constructor("tag:yaml.org,2002:python/tuple", _Loader.construct_sequence)
_STRUCTURE = re.compile(r'"(?:[^"\\]|\\.)*"?|[][{}]', re.DOTALL)


def read(path: Path, what: str) -> Any:
    """The values in a file.

    Parameters
    ----------
    path : Path
    what : str
        What it should be, for messages.

    Raises
    ------
    FileNotFoundError
    InputError
        When it cannot be read, or is neither YAML nor JSON within the limits.
    """
    try:
        with path.open("rb") as file:
            text = file.read(4 * LARGEST + 1).decode()
    except FileNotFoundError:
        raise
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no UTF-8"
        raise InputError(f"{path} cannot be read: {reason}; allowed: {what}") from None
    return parse(text, str(path))


def parse(text: str, where: str) -> Any:
    """The values in a text.

    Parameters
    ----------
    text : str
        JSON, or YAML without anchors and aliases.
    where : str
        Where it comes from, for messages.

    Raises
    ------
    InputError
        When it is neither, too long, or nested too deep.
    """
    most = LARGEST if text.lstrip()[:1] == "{" else LARGEST_YAML
    if len(text) > most:
        raise InputError(f"{where} has {len(text)} characters; allowed: at most {most}")
    try:
        return _parse(text)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{where} is no YAML: {reason:.200}") from None


def _parse(text: str) -> Any:
    """JSON by its own parser, which is many times faster; the rest as YAML."""
    if text.lstrip()[:1] == "{":
        _check_depth(text)
        try:
            return json.loads(text)
        except json.JSONDecodeError:
            if len(text) > LARGEST_YAML:
                raise
    depth = 0
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise ValueError("it has an anchor or an alias; allowed: none")
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST:
            raise ValueError(f"it is nested deeper than {DEEPEST}")
    return yaml.load(text, _Loader)


def _check_depth(text: str) -> None:
    depth = 0
    for found in _STRUCTURE.finditer(text):
        mark = found.group()
        depth += (mark in "[{") - (mark in "]}")
        if depth > DEEPEST:
            raise ValueError(f"it is nested deeper than {DEEPEST}")
