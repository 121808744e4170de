"""ROS arguments of a process: parameter files must say something to the node that is given them."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from iolspi_ros.errors import InputError
from iolspi_ros.task import plain

_PARAMETERS = "ros__parameters"
_FILE, _VALUE, _REMAP = ("--params-file",), ("-p", "--param"), ("-r", "--remap")


@contextmanager
def for_node(arguments: Sequence[str], kind: str) -> Iterator[list[str]]:
    """Arguments with parameter files that match the node, whatever its name and namespace are.

    A section named for the kind of node (`learner:`, or `/**/learner:`) is for every node of that
    kind: also for one in a namespace, and for one that was given another name.

    Parameters
    ----------
    arguments : sequence of str
        As in `sys.argv`.
    kind : str
        The node's own name, before any remapping.

    Yields
    ------
    list of str
        Good until the end of the context.

    Raises
    ------
    InputError
        When a file is none, or says nothing to this node.
    """
    with tempfile.TemporaryDirectory(prefix="iolspi-") as folder:
        yield _adapted(arguments, kind, Path(folder))


def without_files(arguments: Sequence[str]) -> list[str]:
    """Arguments without parameter files, for whom they are not."""
    files = {place for place, _ in _values(arguments, _FILE)}
    files |= {place - 1 for place in files}
    return [text for place, text in enumerate(arguments) if place not in files]


def _adapted(arguments: Sequence[str], kind: str, folder: Path) -> list[str]:
    adapted, name = list(arguments), full_name(arguments, kind)
    for place, path in _values(arguments, _FILE):
        sections = read_sections(Path(path))
        if any(matches(pattern, name) for pattern in sections):
            continue
        mine = [pattern for pattern in sections if pattern in (f"/{kind}", f"/**/{kind}")]
        if not mine:
            raise InputError(
                f"parameter file {path} says nothing to {name}: it is for "
                f"{', '.join(sections) or 'nobody'}; allowed: a section /**/{kind}, /** or {name}"
            )
        ours = folder / f"{place}.yaml"
        ours.write_text(yaml.safe_dump({"/**": {_PARAMETERS: sections[mine[-1]]}}))
        adapted[place] = str(ours)
    return adapted


def given(arguments: Sequence[str], kind: str) -> dict[str, Any]:
    """Parameters that the arguments give a node, by name; the last one given counts."""
    name = full_name(arguments, kind)
    found: dict[str, Any] = {}
    for place, text in _values(arguments, (*_FILE, *_VALUE)):
        if arguments[place - 1] in _FILE:
            for pattern, section in read_sections(Path(text)).items():
                if matches(pattern, name):
                    found |= _flat(section)
            continue
        key, _, value = text.partition(":=")
        node, colon, key = key.rpartition(":")
        if not colon or matches(node if node[:1] == "/" else f"/**/{node}", name):
            found[key] = plain.parse(value, f"parameter {key}")
    return found


def full_name(arguments: Sequence[str], kind: str) -> str:
    """Name that the arguments give a node, with its namespace."""
    name, namespace = kind, "/"
    for _, text in _values(arguments, _REMAP):
        key, _, value = text.partition(":=")
        node, _, key = key.rpartition(":")
        if node in ("", kind) and key in ("__node", "__name"):
            name = value
        if node in ("", kind) and key == "__ns":
            namespace = f"/{value.strip('/')}"
    return f"{namespace.rstrip('/')}/{name}"


def read_sections(path: Path) -> dict[str, dict[str, Any]]:
    """Parameters in a file, by the pattern of names that they are for, which begins with /.

    Raises
    ------
    InputError
        When it cannot be read, or is no parameter file.
    """
    try:
        content = plain.read(path, "a ROS parameter file")
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; allowed: a ROS parameter file") from None
    try:
        return dict(_sections(content, ""))
    except (AttributeError, TypeError):
        raise InputError(
            f"{path} is no ROS parameter file; allowed: NODE: ros__parameters: NAME: value"
        ) from None


def _sections(content: Any, prefix: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for key, value in content.items():
        if key == _PARAMETERS:
            if value is not None:
                yield prefix, {str(name): chosen for name, chosen in value.items()}
        else:
            yield from _sections(value or {}, f"{prefix}/{str(key).strip('/')}")


def _flat(section: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested parameters by their names with points."""
    found: dict[str, Any] = {}
    for key, value in section.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def matches(pattern: str, name: str) -> bool:
    """Whether a pattern of names, with * for one part and ** for any, is for a name."""
    parts = [
        "(/[^/]+)*" if part == "**" else "/[^/]+" if part == "*" else "/" + re.escape(part)
        for part in pattern.strip("/").split("/")
    ]
    return re.fullmatch("".join(parts), name) is not None


def _values(arguments: Sequence[str], options: tuple[str, ...]) -> Iterator[tuple[int, str]]:
    """Places and texts of what stands behind some options, among the ROS arguments."""
    ros = False
    for place, text in enumerate(arguments):
        if text == "--ros-args":
            ros = True
        elif text == "--":
            ros = False
        elif ros and place and arguments[place - 1] in options:
            yield place, text
