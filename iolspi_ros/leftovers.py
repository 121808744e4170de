"""What killed processes left in shared memory, and who of them may be forgotten.

Fast DDS puts segments and ports into /dev/shm and locks each as long as somebody uses it; a killed
process loses its locks and leaves the files. Segments that nobody has locked, of this user and not
fresh, are in nobody's way but the disk's. Ports stay: their names come again, and one that goes
while a process opens it leaves that process deaf; they are small, and few.
"""

from __future__ import annotations

import fcntl
import os
import re
import time
from contextlib import suppress
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
_LOCK = re.compile(r"fastrtps_[0-9a-f]{16}_[es]l")
_YOUNG = 10.0
"""Seconds during which a file may be one whose lock is still to come."""


def sweep(place: Path = SHARED_MEMORY) -> int:
    """Remove what no living process holds; the bytes gained."""
    gained = 0
    with suppress(OSError):
        for lock in sorted(place.iterdir()):
            if _LOCK.fullmatch(lock.name):
                gained += _remove_if_left(lock)
    return gained


def left(place: Path = SHARED_MEMORY) -> tuple[int, int]:
    """Files of Fast DDS there, and their bytes."""
    sizes = []
    with suppress(OSError):
        for path in place.iterdir():
            if "fastrtps_" in path.name:
                with suppress(OSError):
                    sizes.append(path.stat().st_size)
    return len(sizes), sum(sizes)


def _remove_if_left(lock: Path) -> int:
    """Remove a segment whose lock nobody holds, with its lock and semaphore; its bytes."""
    try:
        about = lock.lstat()
        if about.st_uid != os.getuid() or time.time() - about.st_mtime < _YOUNG:
            return 0
        with lock.open("ab") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            segment = lock.with_name(re.sub("_[es]l$", "", lock.name))
            gained = 0
            for path in (segment, lock.with_name(f"sem.{segment.name}_mutex"), lock):
                with suppress(OSError):
                    gained += path.stat().st_size
                    path.unlink()
            return gained
    except OSError:
        return 0  # in use, or gone
