"""Keeps a learner's checkpoints while it learns: in the background, the last few, never another's.

`policy.npz` is always the newest. The one before becomes `policy.N.npz` with the first number that
is free; of those that this series of runs made, the last few are kept. What somebody else left
under that name is set aside in the same way, and never deleted.
"""

from __future__ import annotations

import fcntl
import os
import re
import secrets
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import IO

from iolspi_ros.errors import InputError
from iolspi_ros.folders import state_folder
from iolspi_ros.saving import checkpoint
from iolspi_ros.saving.checkpoint import Content, DamagedError

SHARE = 0.05
"""Of the time that writing may take at most; a large learner is saved less often for it."""

Snapshot = Callable[[], Content]
Say = Callable[[str], None]


class NotSavedError(InputError):
    """Learned, and not where it was to be saved."""


class Keeper:
    """The checkpoints of one learner.

    Parameters
    ----------
    path : Path
        Of the newest.
    kept : int
        How many of this series to keep, the newest among them.
    say : callable
        Takes words for people.

    Attributes
    ----------
    run : str
        Name of the series, in each of its files: one for a learner and all that resume from it.
    failure : str
        Why the last try failed; empty when it did not.
    saved : float
        When the last was on disk, by `time.monotonic`; 0 for never.

    Raises
    ------
    InputError
        When nothing can be saved there, or another learner does.
    """

    def __init__(self, path: Path, kept: int, say: Say) -> None:
        self.path, self._kept, self._say = path, kept, say
        self.run = secrets.token_hex(8)
        self.failure = ""
        self.saved = 0.0
        self._took = 0.0
        self._updates = 0  # since the last was begun
        self._begun = time.monotonic()
        self._grown_from_it = False  # whether the file there is of this series
        self._earlier: list[Path] = []  # of this series, oldest first
        self._writing: Future[None] | None = None
        _check_place(path)
        self._lock = _locked(path)
        _check_writable(path)
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="checkpoint")

    # ------------------------------------------------------------ going on

    def newest(self) -> tuple[Path, Content] | None:
        """The newest whole checkpoint, and where it was; None when there is none.

        What is damaged is said and left where it is.
        """
        for path in [self.path, *reversed(self._numbered().values())]:
            if not path.exists():
                continue
            try:
                return path, checkpoint.read(path)
            except DamagedError as error:
                self._say(f"{error}; looking for an earlier one")
        return None

    def go_on_from(self, path: Path, content: Content) -> None:
        """Make this a continuation of the series of a checkpoint."""
        self.run = str(content.about["run"]) or self.run
        self._grown_from_it = path == self.path
        others = self._numbered().values()
        self._earlier = [other for other in others if self._is_of_this_run(other)]

    def _is_of_this_run(self, path: Path) -> bool:
        try:
            return bool(checkpoint.read(path).about["run"] == self.run)
        except InputError:
            return False

    def _numbered(self) -> dict[int, Path]:
        """Earlier files of that name, oldest first."""
        stem, suffix = re.escape(self.path.stem), re.escape(self.path.suffix)
        found = {}
        for path in self.path.parent.iterdir():
            if match := re.fullmatch(f"{stem}\\.(\\d+){suffix}", path.name):
                found[int(match.group(1))] = path
        return dict(sorted(found.items()))

    # ------------------------------------------------------------ saving

    def updated(self) -> None:
        """Count an update."""
        self._updates += 1

    def due(self, updates: int, seconds: float) -> bool:
        """Whether so many updates or seconds have passed, and nothing is being written."""
        passed = time.monotonic() - self._begun
        if self._writing is not None and not self._writing.done():
            return False
        wanted = (updates and self._updates >= updates) or (seconds and passed >= seconds)
        return bool(wanted) and passed * SHARE >= self._took

    def offer(self, snapshot: Snapshot) -> None:
        """Have a checkpoint written in the background."""
        self._begun, self._updates = time.monotonic(), 0
        self._writing = self._writer.submit(self._attempt, snapshot)

    def _attempt(self, snapshot: Snapshot) -> None:
        """Write one; a failure is kept for whoever asks, and the next try may succeed."""
        try:
            self._write(snapshot())
        except Exception as error:  # also of a learner whose state cannot be written
            if not self.failure:
                self._say(f"{error}; learning goes on, and it is tried again")
            self.failure = str(error)
        else:
            self.failure = ""

    def _write(self, content: Content) -> None:
        start = time.monotonic()
        checkpoint.write(self.path, content, self._make_way)
        self._grown_from_it, self.saved = True, time.monotonic()
        self._took = self.saved - start
        while len(self._earlier) > self._kept - 1:
            with suppress(OSError):
                self._earlier[0].unlink()
            del self._earlier[0]

    def _make_way(self) -> None:
        """Give what stands there another name."""
        if not self.path.exists() or (self._grown_from_it and self._kept == 1):
            return
        number = max(self._numbered(), default=0) + 1
        while not _given_name(self.path, other := numbered(self.path, number)):
            number += 1
        if self._grown_from_it:
            self._earlier.append(other)
        else:
            self._say(f"{self.path} was there already; it is {other} now")

    def save(self, snapshot: Snapshot) -> str:
        """Write a checkpoint now, in the place that is offered when its own fails.

        Returns
        -------
        str
            Where it is, in words.

        Raises
        ------
        NotSavedError
            When it is not in its own place.
        """
        self._attempt_now(snapshot)
        if not self.failure:
            return f"saved {self.path}"
        other = self.elsewhere()
        try:
            checkpoint.write(other, snapshot())
        except InputError as error:
            raise NotSavedError(f"{self.failure}; nor elsewhere: {error}") from None
        raise NotSavedError(f"{self.failure}; it is in {other}")

    def _attempt_now(self, snapshot: Snapshot) -> None:
        self._begun, self._updates = time.monotonic(), 0
        self._writer.submit(self._attempt, snapshot).result()

    def elsewhere(self) -> Path:
        """Where it goes at the end when its own place fails."""
        name = f"{self.path.stem}-{time.strftime('%Y%m%d-%H%M%S')}-{self.run[:6]}"
        return state_folder() / f"{name}{self.path.suffix}"

    def close(self) -> None:
        """Let others have the place."""
        self._writer.shutdown(wait=True)
        if self._lock is not None:
            place = _lock_path(self.path)
            with suppress(OSError):
                if os.fstat(self._lock.fileno()).st_ino == place.stat().st_ino:
                    place.unlink()
            self._lock.close()
            self._lock = None


def numbered(path: Path, number: int) -> Path:
    """Name of an earlier checkpoint."""
    return path.with_name(f"{path.stem}.{number}{path.suffix}")


def _given_name(path: Path, other: Path) -> bool:
    """Give a file another name, which nobody has; False when somebody does."""
    try:
        os.link(path, other)
    except FileExistsError:
        return False
    except OSError:  # a file system without links
        if other.exists():
            return False
        path.rename(other)
    return True


def _check_place(path: Path) -> None:
    if path.is_symlink() or (path.exists() and not path.is_file()):
        what = "a symbolic link" if path.is_symlink() else "no file"
        raise InputError(f"checkpoint {path} is {what}; allowed: a file, or none yet")


def _check_writable(path: Path) -> None:
    probe = path.with_name(f".{path.name}.{os.getpid()}.try")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        probe.write_bytes(b"\0" * 4096)
        probe.unlink()
    except OSError as error:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
        raise InputError(
            f"checkpoint {path} cannot be written: {error.strerror}; "
            "allowed: a file in a folder with room that you may write to"
        ) from error


def _lock_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.lock")


def _locked(path: Path) -> IO[str] | None:
    """A lock that ends with this process, however it ends; None where there are no locks."""
    place = _lock_path(path)
    while True:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            file = place.open("a+", encoding="ascii")
        except OSError:
            return None  # what is wrong with the place is said by whoever writes there
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            file.seek(0)
            holder = file.read(20).strip() or "unknown"
            file.close()
            raise InputError(
                f"checkpoint {path} is another learner's (process {holder}); allowed: another file"
            ) from None
        except OSError:
            file.close()
            return None
        with suppress(OSError):
            if os.fstat(file.fileno()).st_ino == place.stat().st_ino:
                file.truncate(0)
                file.write(f"{os.getpid()}\n")
                file.flush()
                return file
        file.close()  # another learner has just ended and removed it
