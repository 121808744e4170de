"""Informed online least-squares policy iteration on a ROS 2 graph."""

import os

# Before numpy loads its BLAS: the matrices of an update are small, several nodes share
# the cores, and one thread gives the same bits on every machine.
for _variable in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

__version__ = "0.1.0"
