"""Informed online least-squares policy iteration on a ROS 2 graph."""

import ctypes
import os

# Before numpy loads its BLAS: the matrices of an update are small, several nodes share
# the cores, and one thread gives the same bits on every machine.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

__version__ = "0.1.0"


def _keep_freed_memory() -> None:
    """Let glibc keep what is freed for the next update, instead of giving it back each time.

    Fresh pages for the megabytes of an update otherwise cost a third of its time.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):  # not glibc: nothing to gain
        return
    for option in (-1, -3):  # M_TRIM_THRESHOLD, M_MMAP_THRESHOLD
        mallopt(option, 256 * 2**20)


_keep_freed_memory()
