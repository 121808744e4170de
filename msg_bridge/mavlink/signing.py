"""Stamps of signed packets: what was taken once is never taken again, whatever was restarted.

References
----------
MAVLink 2, packet signing, handling of timestamps: of one link of one component stamps only grow;
what comes over a link that is new may be a minute behind; stamps are kept over a restart.
"""

from __future__ import annotations

import hashlib
import json
import threading
import time
from pathlib import Path
from typing import NamedTuple

from iolspi_ros.errors import InputError
from iolspi_ros.folders import atomic_file

_EPOCH = 1_420_070_400  # 2015-01-01 in Unix time: from where stamps count their 10 µs
_SECOND = 100_000  # in stamps
_MINUTE = 60 * _SECOND
_SAVING = threading.Lock()
_SAVE = 0.5  # between two times that stamps are written down [s]


class Stream(NamedTuple):
    """Who signs on which of their links."""

    link: int
    system: int
    component: int


class StampBook:
    """The newest stamp of each stream that is signed with one key; thread-safe.

    Parameters
    ----------
    path : Path, optional
        Where it is kept over a restart, written half a second after a change at the latest, by a
        thread of its own.

    Raises
    ------
    InputError
        When what is there is no such file, or none can be written.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path, self._lock = path, threading.Lock()
        self._stamps: dict[Stream, int] = {}
        self._changed = False
        if path is not None:
            self._stamps = _read(path)
            self._changed = True
            self.save()
            threading.Thread(target=self._keep, name="stamps", daemon=True).start()

    def next(self, us: Stream) -> int:
        """A stamp for a packet of ours: the clock's, but later than all that were seen."""
        with self._lock:
            stamp = max(self._now(), self._stamps.get(us, 0) + 1)
            self._stamps[us] = stamp
            self._changed = True
            return stamp

    def fresh(self, stream: Stream, stamp: int) -> bool:
        """Whether a packet with this stamp can be new.

        Over a link that is new, of somebody who was heard over another, it is so only when it is
        newer than what that one brought: else what was recorded there would be taken here.
        """
        with self._lock:
            before = self._stamps.get(stream)
            if before is None:
                same = [
                    s for known, s in self._stamps.items() if known[1:] == (stream[1], stream[2])
                ]
                before = max(same, default=None)
            if before is not None:
                return stamp > before
            return stamp >= self._now() - _MINUTE

    def take(self, stream: Stream, stamp: int) -> None:
        """A packet with a good signature has come."""
        with self._lock:
            self._stamps[stream] = max(stamp, self._stamps.get(stream, 0))
            self._changed = True

    def save(self) -> None:
        """Write it down now, if there is anything new.

        Raises
        ------
        InputError
            When that cannot be.
        """
        if self._path is None:
            return
        with _SAVING:
            self._save(self._path)

    def _save(self, path: Path) -> None:
        with self._lock:
            if not self._changed:
                return
            self._changed = False
            stamps = dict(self._stamps)
        try:
            for stream, stamp in _read(path).items():  # another bridge may have the same key
                stamps[stream] = max(stamp, stamps.get(stream, 0))
            rows = [[*stream, stamp] for stream, stamp in sorted(stamps.items())]
            with atomic_file(path) as file:
                file.write(json.dumps(rows).encode() + b"\n")
        except OSError as error:
            raise InputError(
                f"stamps of signed packets cannot be kept in {path}: {error.strerror}"
            ) from error

    def _now(self) -> int:
        return max(_clock(), *self._stamps.values(), 0)

    def _keep(self) -> None:
        while True:
            time.sleep(_SAVE)
            try:
                self.save()
            except InputError:  # said when it was opened; a disk may be full for a while
                self._changed = True


def _clock() -> int:
    return int((time.time() - _EPOCH) * _SECOND)


def _read(path: Path) -> dict[Stream, int]:
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))
        return {Stream(*map(int, row[:3])): int(row[3]) for row in rows}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError, IndexError, KeyError) as error:
        raise InputError(
            f"{path} holds no stamps of signed packets ({error}); without them recorded packets "
            "would be taken again; allowed: such a file, or none"
        ) from error


_BOOKS: dict[Path, StampBook] = {}
_OPENING = threading.Lock()


def open_book(key: bytes, folder: Path) -> StampBook:
    """The book for a key, one for all links of this process, kept in a folder."""
    path = folder / f"stamps_{hashlib.sha256(key).hexdigest()[:16]}.json"
    with _OPENING:
        if path not in _BOOKS:
            _BOOKS[path] = StampBook(path)
        return _BOOKS[path]
