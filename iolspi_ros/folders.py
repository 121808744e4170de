"""Folders and files: nothing is overwritten that this run did not make, nothing half written."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from iolspi_ros import __version__
from iolspi_ros.errors import InputError

SERIES = tuple(Path("out", name) for name in ("bench", "cockpit", "demo", "fly", "learn", "soak"))
"""Places that commands take by themselves: each keeps a numbered folder for every run."""
LATEST = "latest"
MARK = "run.txt"
"""In every folder: which command made it, and when; who makes this file has the folder."""


def new_folder(out: Path) -> Path:
    """A folder of this run alone.

    A place of `SERIES` gets a new folder 1, 2, … inside, and `latest` beside leads there. Any
    other must not exist, or be empty. Two commands at once never get the same.

    Parameters
    ----------
    out : Path
        What the option `--out` says.

    Raises
    ------
    InputError
        When the place holds something, or cannot be made.
    """
    try:
        return _next_of(out) if out in SERIES else _claimed(out)
    except OSError as error:
        raise InputError(
            f"--out {out} cannot be made: {error.strerror}; allowed: a place you may write to"
        ) from error


def check_free(out: Path) -> None:
    """Raise where `new_folder` will, before a long way there; nothing is made.

    Raises
    ------
    InputError
        When the place holds something, or is none.
    """
    if out in SERIES or not out.exists():
        return
    if not out.is_dir():
        raise InputError(f"--out {out} cannot be made: it is a file; allowed: a folder")
    if any(out.iterdir()):
        raise _others(out)


def _others(out: Path) -> InputError:
    return InputError(
        f"--out {out} holds other files; allowed: a folder that is empty or not there yet"
    )


def _claimed(out: Path) -> Path:
    check_free(out)
    out.mkdir(parents=True, exist_ok=True)
    try:
        _sign(out)
    except FileExistsError:  # another command had the same thought
        raise _others(out) from None
    return out


def _next_of(series: Path) -> Path:
    """The next folder of a series, made."""
    series.mkdir(parents=True, exist_ok=True)
    numbers = [int(path.name) for path in series.iterdir() if path.name.isdecimal()]
    number = max(numbers, default=0) + 1
    while True:
        folder = series / str(number)
        try:
            folder.mkdir()
            break
        except FileExistsError:
            number += 1
    _sign(folder)
    _point(series / LATEST, folder.name)
    return folder


def _sign(folder: Path) -> None:
    text = f"iolspi_ros {__version__}\n{time.strftime('%Y-%m-%d %H:%M:%S %z')}\n{sys.argv}\n"
    with (folder / MARK).open("x", encoding="utf-8") as file:
        file.write(text)


def _point(link: Path, target: str) -> None:
    """Let a link lead to the newest; what stands there and is no link stays."""
    if link.exists() and not link.is_symlink():
        return
    other = link.with_name(f".{link.name}.{os.getpid()}")
    with suppress(OSError):  # a file system without links has the numbers
        other.symlink_to(target)
        other.replace(link)


def state_folder() -> Path:
    """$XDG_STATE_HOME/iolspi_ros, or that in ~/.local/state (XDG Base Directory Specification)."""
    given = os.environ.get("XDG_STATE_HOME", "")
    base = Path(given) if os.path.isabs(given) else Path(os.path.expanduser("~"), ".local", "state")
    return base / "iolspi_ros"


@contextmanager
def atomic_file(path: Path, ready: Callable[[], None] = lambda: None) -> Iterator[IO[bytes]]:
    """Write beside `path` and put it in place only when all of it is on disk.

    Parameters
    ----------
    path : Path
    ready : callable
        Called just before, when all of it is.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with partial.open("w+b") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        ready()
        partial.replace(path)
        _sync_folder(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def _sync_folder(folder: Path) -> None:
    """Have the names in a folder on disk."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    except OSError:  # not every file system knows that
        pass
    finally:
        os.close(handle)
