"""What a learner observes between two checkpoints: on disk at once, so that a kill loses nothing.

Beside `policy.npz` stand files `.policy.npz.RUN.N.journal`, one for each checkpoint that was begun:
what was observed since. A learner that resumes goes through it as it did before.
"""

from __future__ import annotations

import glob
import json
import os
import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from iolspi_ros.core.samples import Observation

KEPT = 2
"""Of the files for checkpoints that are on disk: the newest could be damaged."""
LARGEST = 2**30
"""Bytes of a file that is read; a week of real time is less."""
_HEAD = 4096
"""Bytes of a first line, at most."""


class Mark(NamedTuple):
    """Where a learner was when a checkpoint was begun: its steps, and what it had answered last."""

    learned: int
    episode: int
    step: int


NOTHING = Mark(0, -1, -1)
"""Before anything was learned or answered."""


class Journal:
    """The files of one learner.

    Parameters
    ----------
    path : Path
        Of the checkpoint.
    n_dims : int
        Variables of a state.
    say : callable
        Takes words for people.
    """

    def __init__(self, path: Path, n_dims: int, say: Callable[[str], None]) -> None:
        self._path, self._record, self._say = path, _record(n_dims), say
        self._number = 1 + max((_number(file) for file in _files(path, "*")), default=-1)
        self._mine: list[Path] = []
        self._file = -1
        self._failed = False

    def begin(self, run: str, mark: Mark, *, saved: bool) -> None:
        """Note from now on what comes after a checkpoint that is being written.

        Parameters
        ----------
        run : str
            Name of the series of checkpoints.
        mark : Mark
        saved : bool
            Whether the checkpoint before is on disk; then what came before that is not needed.
        """
        if not self._mine:
            self._mine = _files(self._path, run)
        if saved:
            self._forget(self._mine[:-KEPT])
        self._end()
        file = self._path.with_name(f".{self._path.name}.{run}.{self._number}.journal")
        self._number += 1
        try:
            self._file = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
            os.write(self._file, json.dumps(mark).encode() + b"\n")
        except OSError as error:
            self._fail(error)
        self._mine.append(file)

    def note(self, observation: Observation) -> None:
        """Write an observation down, before anything is made of it."""
        if self._file < 0:
            return
        o = observation
        content = self._record.pack(
            o.episode, o.step, o.stamp, o.action, o.source, o.terminated, o.truncated, o.reward,
            *o.state,
        )  # fmt: skip
        try:
            os.write(self._file, content + zlib.crc32(content).to_bytes(4, "little"))
        except OSError as error:
            self._fail(error)

    def close(self, *, needed: bool) -> None:
        """End; what is not needed any more goes."""
        self._end()
        if not needed:
            self._forget(list(self._mine))

    def _fail(self, error: OSError) -> None:
        """Note nothing more until the next checkpoint."""
        self._end()
        if not self._failed:
            self._say(f"what comes after a checkpoint is not written down: {error.strerror}")
        self._failed = True

    def _end(self) -> None:
        if self._file >= 0:
            os.close(self._file)
        self._file = -1

    def _forget(self, files: list[Path]) -> None:
        for file in files:
            with suppress(OSError):
                file.unlink()
            self._mine.remove(file)


def read(path: Path, run: str, mark: Mark, n_dims: int) -> list[Observation]:
    """What was observed after a checkpoint.

    Parameters
    ----------
    path : Path
        Of the newest checkpoint.
    run : str
        Of the series.
    mark : Mark
        Of the checkpoint.
    n_dims : int

    Returns
    -------
    list of Observation
        In their order; what is cut off or damaged is left out, and all after it in that file.
    """
    found: list[Observation] = []
    files = _files(path, run)
    begun = [k for k, file in enumerate(files) if _mark(file) == mark]
    # The last, when there are more: a checkpoint that was loaded again begins anew.
    for file in files[begun[-1] :] if begun else []:
        found += _observations(file, _record(n_dims))
    return found


def begun_from_nothing(path: Path) -> str:
    """The series whose journal begins before anything was learned, the newest; empty for none."""
    found = [file for file in _files(path, "*") if _mark(file) == NOTHING]
    return found[-1].name.split(".")[-3] if found else ""


def _files(path: Path, run: str) -> list[Path]:
    """Journals of a series, oldest first."""
    pattern = f".{glob.escape(path.name)}.{run}.*.journal"
    return sorted((f for f in path.parent.glob(pattern) if _number(f) >= 0), key=_number)


def _number(file: Path) -> int:
    text = file.name.split(".")[-2]
    return int(text) if text.isdecimal() else -1


def _mark(file: Path) -> Mark | None:
    try:
        with file.open("rb") as opened:
            mark = Mark(*json.loads(opened.readline(_HEAD)))
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return mark if all(isinstance(value, int) for value in mark) else None


def _record(n_dims: int) -> struct.Struct:
    """Episode, step, stamp, action, source; terminated, truncated; reward and state."""
    return struct.Struct(f"<5q2?{1 + n_dims}d")


def _observations(file: Path, record: struct.Struct) -> list[Observation]:
    with suppress(OSError), file.open("rb") as opened:
        if os.fstat(opened.fileno()).st_size > LARGEST:
            return []
        opened.readline(_HEAD)
        found = []
        while len(content := opened.read(record.size + 4)) == record.size + 4:
            if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
                break
            episode, step, stamp, action, source, terminated, truncated, reward, *state = (
                record.unpack(content[:-4])
            )
            found.append(
                Observation(episode, step, np.array(state), reward, action, terminated, truncated,
                            stamp, source)
            )  # fmt: skip
        return found
    return []
