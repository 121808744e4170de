"""Realisations on disk: one file each, written whole or not at all, found again by what made it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from iolspi_ros import __version__
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.cells import Cell, Result
from iolspi_ros.experiments.versions import describe, libraries
from iolspi_ros.folders import atomic_file


class Store:
    """A folder of results.

    Parameters
    ----------
    folder : Path
        Made when it is not there.
    warn : callable
        Is told, in one line, of a file that cannot be used.

    Raises
    ------
    InputError
        When the folder cannot be made or written to.
    """

    def __init__(self, folder: Path, warn: Callable[[str], None] = lambda text: None) -> None:
        self.folder, self._warn = folder, warn
        self._read: dict[Path, Result] = {}  # figures share most of what they are made of
        try:
            with atomic_file(folder / ".writable"):
                pass
            (folder / ".writable").unlink(missing_ok=True)
        except OSError as error:
            raise InputError(
                f"results cannot be written to {folder}: {error.strerror}; "
                "allowed: a folder with room that you may write to"
            ) from error

    def path(self, cell: Cell, seed: int) -> Path:
        """Where a realisation is, or will be."""
        return self.folder / f"{cell.realise.__name__}-{cell.key}" / f"{seed}.npz"

    def read(self, cell: Cell, seed: int) -> Result | None:
        """A realisation; None when it is not there, or its file is cut short or damaged."""
        path = self.path(cell, seed)
        if path in self._read:
            return self._read[path]
        try:
            with np.load(path, allow_pickle=False) as file:
                found = {name: file[name] for name in file.files if name != "about"}
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            self._warn(f"{path} is cut short or damaged; that realisation is computed again")
            return None
        self._read[path] = found
        return found

    def write(self, cell: Cell, seed: int, result: Result) -> None:
        """Put a realisation away, with what made it.

        Raises
        ------
        InputError
            When it cannot be written; what was there before stays.
        """
        about = {
            "setting": describe(cell.setting),
            "seed": seed,
            "realise": f"{cell.realise.__module__}.{cell.realise.__qualname__}",
            "key": cell.key,
            "versions": {"iolspi_ros": __version__, **libraries()},
        }
        try:
            with atomic_file(self.path(cell, seed)) as file:
                np.savez_compressed(file, allow_pickle=False, about=json.dumps(about), **result)
        except OSError as error:
            raise InputError(
                f"a result cannot be written to {self.folder}: {error.strerror}; allowed: a folder "
                "with room that you may write to. What was computed before is kept there: make "
                "room, and the same command goes on"
            ) from error
