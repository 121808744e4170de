"""A learner on disk: written whole or not at all, checked before it is believed.

A checkpoint is a .npz file, so numpy reads it, too: `about` is JSON, the rest are arrays, nothing
is compressed, and the zip's comment is a SHA-256 of all that stands before it. `keeper` has the
files' names.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import typing
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, fields, is_dataclass
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from iolspi_ros import task as tasks
from iolspi_ros.core.learner import Learner
from iolspi_ros.errors import InputError
from iolspi_ros.folders import atomic_file
from iolspi_ros.task import plain

FORMAT = 5
LARGEST = 2**33
"""Bytes of a checkpoint at most."""
MOST_ARRAYS = 1000
_HASH = b"sha256:"
_SEAL = len(_HASH) + 64
_KINDS = "biuf"  # of numbers that an array may hold
_OWN = "learner"  # part of a checkpoint that is the learner's own
T = typing.TypeVar("T")


class DamagedError(InputError):
    """A file that is no whole checkpoint."""


class Content(NamedTuple):
    """What a checkpoint holds.

    Attributes
    ----------
    about : mapping
        Plain values: `learner`, `run`, `task`, `settings`, and the rest of each part.
    arrays : mapping of str to ndarray
        Of the parts, by their paths.
    """

    about: Mapping[str, Any]
    arrays: Mapping[str, Any]


def snapshot(learner: Learner, name: str, run: str = "", **parts: Any) -> Callable[[], Content]:
    """What a learner is now, to be put into words later, in any thread.

    Parameters
    ----------
    learner : Learner
    name : str
        Under which it is registered.
    run : str
        Whose series of checkpoints it belongs to.
    **parts : dataclass instances
        What else must be known to go on; None is left out.

    Returns
    -------
    callable
    """
    task, settings = learner.task, learner.settings
    held = {_OWN: learner.state()} | {k: part for k, part in parts.items() if part is not None}

    def content() -> Content:
        arrays: dict[str, Any] = {}
        about = {
            "format": FORMAT, "learner": name, "run": run, "task": tasks.dump(task),
            "settings": asdict(settings),
            "parts": {k: _split(part, f"{k}.", arrays) for k, part in held.items()},
        }  # fmt: skip
        return Content(about, arrays)

    return content


def save(path: Path, learner: Learner, name: str) -> None:
    """Write a learner's state, its task and its settings.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    write(path, snapshot(learner, name)())


def load(path: Path, learner: Learner, name: str) -> None:
    """Make `learner`, registered under `name`, go on from a checkpoint; see `restore`."""
    restore(read(path), learner, name, f"checkpoint {path}")


# ---------------------------------------------------------------- writing


def write(path: Path, content: Content, ready: Callable[[], None] = lambda: None) -> None:
    """Write a checkpoint, whole or not at all; `ready` as of `atomic_file`.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    try:
        with atomic_file(path, ready) as file:
            write_into(file, content)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"checkpoint {path} cannot be written: {reason}; "
            "allowed: a file in a folder with room that you may write to"
        ) from error


def write_into(file: IO[bytes], content: Content) -> None:
    """Write a checkpoint into an empty file, with its checksum."""
    arrays = {"about": np.array(json.dumps(content.about))} | dict(content.arrays)
    with zipfile.ZipFile(file, "w", zipfile.ZIP_STORED, allowZip64=True) as packed:
        for name, array in arrays.items():
            with packed.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asarray(array), allow_pickle=False)
        packed.comment = bytes(_SEAL)
    end = file.seek(-_SEAL, os.SEEK_END)
    digest = _digest(file, end)
    file.seek(end)
    file.write(digest)


def _digest(file: IO[bytes], end: int) -> bytes:
    """Checksum of the first `end` bytes, as it stands behind them."""
    file.seek(0)
    found, left = hashlib.sha256(), end
    while left:
        block = file.read(min(left, 2**20))
        if not block:
            break
        found.update(block)
        left -= len(block)
    return _HASH + found.hexdigest().encode()


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


# ---------------------------------------------------------------- reading


def read(path: Path) -> Content:
    """What a checkpoint holds, when it is one and whole.

    Nothing is made of it before its size and checksum are known to be right, and no array that
    says it is larger than the file.

    Raises
    ------
    DamagedError
        When the file is none of ours, or not as it was written.
    InputError
        When it is missing.
    """
    if not path.exists():
        raise InputError(f"checkpoint {path} does not exist; allowed: a file that a learner saved")
    try:
        if not path.is_file():
            raise ValueError("no file")
        with path.open("rb") as file:
            return _checked(file, os.fstat(file.fileno()).st_size)
    except Exception as error:  # whatever a damaged or a crafted one raises
        raise DamagedError(
            f"checkpoint {path} is damaged or of another format; "
            f"allowed: a file that a learner saved (format {FORMAT})"
        ) from error


def _checked(file: IO[bytes], size: int) -> Content:
    if not _SEAL < size <= LARGEST:
        raise ValueError(f"{size} bytes")
    file.seek(size - _SEAL)
    seal = file.read(_SEAL)
    if seal != _digest(file, size - _SEAL):
        raise ValueError("another checksum")
    with zipfile.ZipFile(file) as packed:
        members = packed.infolist()
        if len(members) > MOST_ARRAYS or sum(member.file_size for member in members) > size:
            raise ValueError("more than the file can hold")
        arrays = {m.filename.removesuffix(".npy"): _array(packed, m) for m in members}
    about = plain.parse(str(arrays.pop("about")[()]), "about")
    wanted = {"learner": str, "run": str, "task": str, "settings": dict, "parts": dict}
    if about["format"] != FORMAT or any(type(about[k]) is not t for k, t in wanted.items()):
        raise ValueError("another format")
    return Content(about, arrays)


def _array(packed: zipfile.ZipFile, member: zipfile.ZipInfo) -> Any:
    """One array; its header is compared with what is there before room is made for it."""
    if member.compress_type != zipfile.ZIP_STORED or member.file_size != member.compress_size:
        raise ValueError("compressed")
    data = packed.read(member)
    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    reader = {(1, 0): np.lib.format.read_array_header_1_0,
              (2, 0): np.lib.format.read_array_header_2_0}[version]  # fmt: skip
    shape, fortran, dtype = reader(file)
    text = member.filename == "about.npy" and dtype.kind == "U" and shape == ()
    numbers = dtype.kind in _KINDS and not dtype.hasobject and dtype.isnative
    if not (text or numbers) or any(n < 0 for n in shape) or len(shape) > 8:
        raise ValueError(f"array of {dtype} and shape {shape}")
    if math.prod(shape) * dtype.itemsize != len(data) - file.tell():
        raise ValueError("array of another size")
    flat = np.frombuffer(bytearray(data), dtype, offset=file.tell())
    return flat.reshape(shape, order="F" if fortran else "C")


def restore(content: Content, learner: Learner, name: str, where: str) -> None:
    """Make `learner`, registered under `name`, go on from what a checkpoint holds.

    The settings of the learner stay; those that shape its state must be the checkpoint's. When
    it does not fit, the learner is as it was.

    Raises
    ------
    InputError
        When it is of another task, learner or shape, or holds what cannot be.
    """
    about = content.about
    if about["learner"] != name:
        raise InputError(f"{where} is of learner {about['learner']!r}; allowed: {name!r}, this one")
    tasks.load(about["task"], where).check_same(learner.task, where, "the vehicle")
    mine = json.loads(json.dumps(asdict(learner.settings)))
    for setting in learner.shaping:
        if about["settings"].get(setting) != mine[setting]:
            raise InputError(
                f"{where} has {setting} {about['settings'].get(setting)}; "
                f"allowed: {mine[setting]}, this learner's"
            )
    state = part(content, _OWN, learner.State, where)
    if state is None:
        raise InputError(f"{where} has no {_OWN}; allowed: a whole checkpoint")
    before = learner.state()
    try:
        learner.restore(state)
    except Exception as error:  # of whatever learner, for whatever numbers
        learner.restore(before)
        raise InputError(f"{where}: {error}") from None


def part(content: Content, name: str, cls: type[T], where: str) -> T | None:
    """A part of a checkpoint as the dataclass that it was; None when there is none.

    Raises
    ------
    InputError
        When it is no such dataclass.
    """
    rest = content.about["parts"].get(name)
    if rest is None:
        return None
    try:
        return typing.cast("T", _join(cls, rest, f"{name}.", content.arrays))
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _join(cls: type[Any], rest: Any, path: str, arrays: Mapping[str, Any]) -> Any:
    """The dataclass that `_split` took apart, its types checked."""
    hints, values = typing.get_type_hints(cls), {}
    for field in fields(cls):
        hint, place = hints[field.name], f"{path}{field.name}"
        optional = field.default is not MISSING or field.default_factory is not MISSING
        if optional and place not in arrays and field.name not in rest:
            continue  # it was saved before there was such a field
        try:
            if (typing.get_origin(hint) or hint) is np.ndarray:
                values[field.name] = _array_like(arrays[place], hint, place)
            elif is_dataclass(hint):
                inner = typing.cast("type[Any]", hint)
                values[field.name] = _join(inner, rest[field.name], f"{place}.", arrays)
            else:
                values[field.name] = _plain_like(rest[field.name], hint, place)
        except (KeyError, TypeError, IndexError):
            raise InputError(f"{place} is missing; allowed: a whole checkpoint") from None
    try:
        return cls(**values)
    except (TypeError, LookupError) as error:
        raise InputError(f"{path[:-1]} cannot be: {error}") from None


def _array_like(array: Any, hint: Any, place: str) -> Any:
    wanted = np.dtype(typing.get_args(typing.get_args(hint)[1])[0])
    if array.dtype != wanted:
        raise InputError(f"{place} is of type {array.dtype}; allowed: {wanted}")
    return array


def _plain_like(value: Any, hint: Any, place: str) -> Any:
    """A plain value of the type that a field wants."""
    kind = typing.get_origin(hint) or hint
    if kind is tuple and isinstance(value, list):
        element = typing.get_args(hint)[0]
        return tuple(_plain_like(entry, element, place) for entry in value)
    if type(value) is int and kind is float:
        value = float(value)
    finite = not isinstance(value, float) or math.isfinite(value)
    small = not isinstance(value, int) or abs(value) < 2**63
    if type(value) is not kind or not (finite and small):
        raise InputError(f"{place} is {value!r:.60}; allowed: {kind.__name__}")
    return value
