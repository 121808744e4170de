"""What our own processes have in common; importing the package changes nothing."""

from __future__ import annotations

import ctypes
import os
import sys

_TURN = 1e-4  # [s]
_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
_ROOM = 256 * 2**20  # [B]
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of glibc's mallopt


def prepare() -> None:
    """One BLAS thread, freed memory kept, short turns. For entry points, before they import numpy.

    The matrices of an update are small, several nodes share the cores, and one thread gives the
    same bits on every machine. What the user has set stays. Fresh pages for the megabytes of an
    update otherwise cost a third of its time. And the thread that answers a vehicle must not wait
    for Python's usual 5 ms, a whole step, until one that computes beside lets it have its turn.
    """
    sys.setswitchinterval(_TURN)
    for variable in _THREADS:
        os.environ.setdefault(variable, "1")
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # not glibc: nothing to gain
        return
    for option in (_TRIM_THRESHOLD, _MMAP_THRESHOLD):
        mallopt(option, _ROOM)


def say(text: str) -> None:
    """Tell a person; that a full disk or a closed pipe takes no words ends nothing."""
    if sys.stderr is None:
        return
    try:
        print(text, file=sys.stderr, flush=True)
    except (OSError, ValueError):  # ValueError: of a stream that is closed
        # What it could not write Python would try again at the end, and exit with 120.
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115
