"""Arrays that took long to compute, kept in the user's cache folder; losing one costs time."""

from __future__ import annotations

import contextlib
import zipfile

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import resources
from iolspi_ros.folders import atomic_file

Array = NDArray[np.float64]


def read(name: str, shape: tuple[int, ...]) -> Array | None:
    """The array of this name; None when there is none, or it is damaged or of another shape."""
    try:
        with np.load(resources.cache_folder() / f"{name}.npz", allow_pickle=False) as file:
            values = np.asarray(file["values"])
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    usable = values.shape == shape and values.dtype == np.float64 and np.isfinite(values).all()
    return values if usable else None


def write(name: str, values: Array) -> None:
    """Keep an array, if the folder can be written."""
    with (
        contextlib.suppress(OSError),
        atomic_file(resources.cache_folder() / f"{name}.npz") as file,
    ):
        np.savez(file, allow_pickle=False, values=values)
