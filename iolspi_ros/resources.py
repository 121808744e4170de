"""Where the package's own files are: in the source tree, or installed under share/."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from iolspi_ros import arguments
from iolspi_ros.errors import InputError

PAINTER = Path(__file__).resolve().parent / "static" / "space.js"
"""What pages draw a vehicle with."""


def find(*parts: str) -> Path:
    """Path of a file or folder such as ("config", "pendulum.yaml").

    Raises
    ------
    InputError
        When it is neither in the source tree nor installed.
    """
    prefixes = [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]
    roots = [Path(__file__).resolve().parent.parent]
    roots += [Path(prefix) / "share" / "iolspi_ros" for prefix in prefixes if prefix]
    for root in roots:
        if (root / "package.xml").is_file() and root.joinpath(*parts).exists():
            return root.joinpath(*parts)
    raise InputError(f"{'/'.join(parts)} is not there; allowed: a file of this package")


def config(task: str) -> Path | None:
    """The parameter file that is shipped for a task, if there is one."""
    try:
        return find("config", f"{task}.yaml")
    except InputError:
        return None


def cache_folder() -> Path:
    """$XDG_CACHE_HOME/iolspi_ros, or that in ~/.cache (XDG Base Directory Specification)."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    # A relative path there is invalid, says the specification.
    base = Path(given) if os.path.isabs(given) else Path(os.path.expanduser("~"), ".cache")
    return base / "iolspi_ros"


def make_folder(path: Path) -> None:
    """Make a folder for results, unless it is there.

    Raises
    ------
    InputError
        When it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"--out {path} cannot be made: {error.strerror}; allowed: a place you may write to"
        ) from error


def parameters(path: Path, node: str) -> dict[str, Any]:
    """What a ROS parameter file says to one node of the root namespace; later sections count.

    Raises
    ------
    InputError
        When the file is missing or is no ROS parameter file.
    """
    found: dict[str, Any] = {}
    for pattern, section in arguments.read_sections(path).items():
        if arguments.matches(pattern, f"/{node}"):
            found |= section
    return found
