"""A learner on disk: written whole or not at all, and gone on with bit by bit the same."""

from __future__ import annotations

import json
import os
import typing
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields, is_dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from iolspi_ros import task as tasks
from iolspi_ros.core.learner import Learner
from iolspi_ros.errors import InputError

FORMAT = 4


@contextmanager
def atomic_file(path: Path) -> Iterator[IO[bytes]]:
    """Write beside `path` and put it in place only when all of it is on disk."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def save(path: Path, learner: Learner, name: str) -> None:
    """Write a learner's state, its task and its settings.

    Parameters
    ----------
    path : Path
    learner : Learner
    name : str
        Under which it is registered.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    arrays: dict[str, Any] = {}
    about = {
        "format": FORMAT,
        "learner": name,
        "task": tasks.dump(learner.task),
        "settings": asdict(learner.settings),
        "state": _split(learner.state(), "", arrays),
    }
    try:
        with atomic_file(path) as file:
            np.savez(file, allow_pickle=False, about=np.array(json.dumps(about)), **arrays)
    except OSError as error:
        raise InputError(
            f"checkpoint {path} cannot be written: {error.strerror}; "
            "allowed: a folder with room that you may write to"
        ) from error


def set_aside(path: Path) -> Path:
    """Rename a checkpoint of somebody else out of the way; return its new name."""
    number = 1
    while (other := path.with_name(f"{path.stem}.{number}{path.suffix}")).exists():
        number += 1
    return path.rename(other)


def load(path: Path, learner: Learner, name: str) -> None:
    """Make `learner`, registered under `name`, go on from a checkpoint.

    The settings of the learner stay; those that shape its state must be the checkpoint's.

    Raises
    ------
    InputError
        When the file is missing, damaged, of another task, learner or shape.
    """
    about, arrays = _read(path)
    here = f"checkpoint {path}"
    if about["learner"] != name:
        raise InputError(f"{here} is of learner {about['learner']!r}; allowed: {name!r}, this one")
    tasks.load(about["task"], here).check_same(learner.task, here, "the vehicle")
    mine = json.loads(json.dumps(asdict(learner.settings)))
    for setting in learner.shaping:
        if about["settings"].get(setting) != mine[setting]:
            raise InputError(
                f"{here} has {setting} {about['settings'].get(setting)}; "
                f"allowed: {mine[setting]}, this learner's"
            )
    try:
        learner.restore(_join(learner.State, about["state"], "", arrays))
    except InputError as error:
        raise InputError(f"{here}: {error}") from None


def _split(part: Any, path: str, arrays: dict[str, Any]) -> dict[str, Any]:
    """Put the arrays of a dataclass into `arrays`, by their paths, and return the rest of it."""
    rest: dict[str, Any] = {}
    for field in fields(part):
        value, place = getattr(part, field.name), f"{path}{field.name}"
        if isinstance(value, np.ndarray):
            arrays[place] = value
        elif is_dataclass(value):
            rest[field.name] = _split(value, f"{place}.", arrays)
        else:
            rest[field.name] = value
    return rest


def _join(cls: type[Any], rest: dict[str, Any], path: str, arrays: dict[str, Any]) -> Any:
    """The dataclass that `_split` took apart, its types checked."""
    hints, values = typing.get_type_hints(cls), {}
    for field in fields(cls):
        hint, place = hints[field.name], f"{path}{field.name}"
        origin = typing.get_origin(hint) or hint
        try:
            if origin is np.ndarray:
                value = arrays[place]
                wanted = np.dtype(typing.get_args(typing.get_args(hint)[1])[0])
                if value.dtype != wanted:
                    raise InputError(f"{place} is of type {value.dtype}; allowed: {wanted}")
            elif is_dataclass(hint):
                value = _join(typing.cast("type[Any]", hint), rest[field.name], f"{place}.", arrays)
            else:
                value = rest[field.name]
                if origin is tuple and isinstance(value, list):
                    value = tuple(value)
                if type(value) is int and origin is float:
                    value = float(value)
                if type(value) is not origin:
                    raise InputError(f"{place} is {value!r:.60}; allowed: {origin.__name__}")
        except (KeyError, TypeError):
            raise InputError(f"{place} is missing; allowed: a whole checkpoint") from None
        values[field.name] = value
    return cls(**values)


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(str(arrays.pop("about")))
        known = about["format"] == FORMAT and isinstance(about["task"], str)
        known = known and all(isinstance(about[part], dict) for part in ("settings", "state"))
    except FileNotFoundError:
        raise InputError(
            f"checkpoint {path} does not exist; allowed: a file that a learner saved"
        ) from None
    except (OSError, ValueError, LookupError, TypeError, EOFError, zipfile.BadZipFile):
        known = False
    if not known or "learner" not in about:
        raise InputError(
            f"checkpoint {path} is damaged or of another format; "
            f"allowed: a file that a learner saved (format {FORMAT})"
        )
    return about, arrays
