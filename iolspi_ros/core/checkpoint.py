"""A learner on disk: written whole or not at all, and gone on with bit by bit the same."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from iolspi_ros.core.moments import Moments
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transitions
from iolspi_ros.errors import InputError

FORMAT = 3
_MOMENTS = tuple(field.name for field in fields(Moments))
_ROWS = tuple(field.name for field in fields(Transitions))
_SHIELD = ("gram", "cross", "seen", "ended")
_ARRAYS = (
    "weights", "starts", "born", "demonstrated", *(f"moments_{name}" for name in _MOMENTS),
    *(f"shield_{name}" for name in _SHIELD),
    *(f"{part}_{name}" for part in ("batch", "buffer") for name in _ROWS),
)  # fmt: skip
_NUMBERS = ("step", "n_samples", "updates", "dropped", "vetoes", "rng")
_SHAPING = (
    "algorithm", "n_actions", "basis", "low", "high", "centers", "periodic", "normalisation",
    "width",
)  # fmt: skip


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


def save(path: Path, learner: OnlineLSPI, task: str) -> None:
    """Write Γ, Λ, z or the samples kept, weights, counters and the random state.

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    state = learner.state()
    buffer = state["buffer"]
    arrays = {
        "weights": state["weights"],
        "starts": state["starts"],
        "born": buffer.born,
        "demonstrated": buffer.demonstrated,
    }
    arrays |= {f"moments_{name}": getattr(state["moments"], name) for name in _MOMENTS}
    arrays |= {f"shield_{name}": getattr(state["shield"], name) for name in _SHIELD}
    for part, rows in (("batch", state["batch"]), ("buffer", buffer.transitions)):
        arrays |= {f"{part}_{name}": getattr(rows, name) for name in _ROWS}
    about = {
        "format": FORMAT,
        "task": task,
        "settings": asdict(learner.settings),
        **{name: state[name] for name in _NUMBERS},
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


def load(path: Path, learner: OnlineLSPI, task: str) -> None:
    """Make `learner` go on from a checkpoint.

    The settings of the learner stay; those that shape the weights must be the checkpoint's.

    Raises
    ------
    InputError
        When the file is missing, damaged, of another task or of another grid.
    """
    about, arrays = _read(path)
    if about["task"] != task:
        raise InputError(
            f"checkpoint {path} is of task {about['task']!r}; allowed: {task!r}, this learner's"
        )
    mine = json.loads(json.dumps(asdict(learner.settings)))
    for name in _SHAPING:
        if about["settings"].get(name) != mine[name]:
            raise InputError(
                f"checkpoint {path} has {name} {about['settings'].get(name)}; "
                f"allowed: {mine[name]}, this learner's"
            )
    batch, rows = (
        Transitions(*(arrays[f"{part}_{name}"] for name in _ROWS)) for part in ("batch", "buffer")
    )
    moments = {name: arrays[f"moments_{name}"] for name in _MOMENTS}
    for name in ("n_samples", "weight", "prior"):
        moments[name] = moments[name].item()
    buffer = replace(
        learner.buffer,
        transitions=rows,
        born=arrays["born"],
        demonstrated=arrays["demonstrated"],
    )
    shield = replace(learner.shield, **{name: arrays[f"shield_{name}"] for name in _SHIELD})
    learner.restore(
        {name: arrays[name] for name in ("weights", "starts")}
        | {name: about[name] for name in _NUMBERS}
        | {"moments": Moments(**moments), "buffer": buffer, "shield": shield, "batch": batch}
    )


def _read(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(str(arrays.pop("about")))
        complete = set(_ARRAYS) <= set(arrays) and set(_NUMBERS) <= set(about)
    except FileNotFoundError:
        raise InputError(
            f"checkpoint {path} does not exist; allowed: a file that a learner saved"
        ) from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        complete = False
    if not complete or about.get("format") != FORMAT:
        raise InputError(
            f"checkpoint {path} is damaged or of another format; "
            f"allowed: a file that a learner saved (format {FORMAT})"
        )
    return about, arrays
