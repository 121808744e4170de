"""Samples as a dataset of LeRobot, on this machine alone; written by its own library."""

from __future__ import annotations

import contextlib
import importlib
import os
import shutil
import tempfile
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros.bags.demonstration import Demonstration
from iolspi_ros.bags.export import pieces, refused
from iolspi_ros.core.samples import Sample
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription

SUFFIX = ".lerobot"


def write_lerobot(path: Path, found: Demonstration) -> None:
    """Make a dataset in a new folder.

    A piece of an episode in which no step is missing is an episode there, and a sample a frame:
    the state left, the action, and what came of it (`next.reward`, `next.terminated`, `next.done`).
    Where a piece ends, the state it came to is left out: LeRobot has no place for it.

    Parameters
    ----------
    path : Path
    found : Demonstration

    Raises
    ------
    InputError
        Without LeRobot, without samples, or when it cannot be made there.
    """
    if not found.samples:
        raise InputError(f"bag {found.path} has no samples; allowed: some")
    library, task = _library(), found.task
    try:
        work = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.absolute().parent))
    except OSError as error:
        raise refused(path, error) from error
    try:
        with _quiet():
            _fill(library, work / path.stem, found.samples, task)
        (work / path.stem).rename(path)
    except Exception as error:  # whatever a library of somebody's raises
        raise InputError(f"LeRobot does not make {path}: {error}") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _fill(library: Any, root: Path, samples: Sequence[Sample], task: TaskDescription) -> None:
    rate = 1.0 / task.sampling_time
    whole = round(rate)
    dataset = library.create(
        f"local/{root.name}", whole if abs(rate - whole) < 1e-6 * rate else rate,
        _features(task), root=root, robot_type=task.name, use_videos=False,
    )  # fmt: skip
    for piece in pieces(samples):
        for k, sample in enumerate(piece):
            dataset.add_frame(_frame(sample, task, last=k == len(piece) - 1))
        dataset.save_episode()
    dataset.finalize()


def _library() -> Any:
    # Nothing is looked up or sent: the dataset is a folder of this machine.
    os.environ.setdefault("HF_HUB_OFFLINE", "1")
    try:
        dataset = importlib.import_module("lerobot.datasets.lerobot_dataset")
    except ImportError as error:
        raise InputError(
            f"LeRobot cannot be loaded ({error}); install it with pip install lerobot"
        ) from error
    return dataset.LeRobotDataset


@contextlib.contextmanager
def _quiet() -> Any:
    """Without the bars and warnings that the libraries below print for each episode."""
    logging = importlib.import_module("datasets.utils").logging
    logging.disable_progress_bar()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.enable_progress_bar()


def _features(task: TaskDescription) -> dict[str, Any]:
    def one(dtype: str, *names: str) -> dict[str, Any]:
        return {"dtype": dtype, "shape": (max(len(names), 1),), "names": list(names) or None}

    n_values = _n_values(task)
    unit = task.action_unit or "value"
    units = [unit if n_values == 1 else f"{unit} {i}" for i in range(n_values)]
    return {
        "observation.state": one("float64", *task.names),
        "action": one("float64", *units) if n_values else one("int64"),
        "action_index": one("int64"),
        "next.reward": one("float64"),
        "next.done": one("bool"),
        "next.terminated": one("bool"),
        "source": one("int64"),
        "stamp": one("int64"),
    }


def _n_values(task: TaskDescription) -> int:
    """Numbers that each action is known by; 0 when some are known by their names alone."""
    lengths = {len(action.value) for action in task.actions}
    return lengths.pop() if len(lengths) == 1 else 0


def _frame(sample: Sample, task: TaskDescription, last: bool) -> dict[str, Any]:
    t = sample.transition
    values = task.actions[t.action].value if _n_values(task) else (t.action,)
    kind = np.float64 if _n_values(task) else np.int64
    return {
        "observation.state": np.asarray(t.state, np.float64),
        "action": np.array(values, kind),
        "action_index": np.array([t.action], np.int64),
        "next.reward": np.array([t.reward]),
        "next.done": np.array([last]),
        "next.terminated": np.array([bool(t.terminated)]),
        "source": np.array([int(sample.source)], np.int64),
        "stamp": np.array([sample.stamp], np.int64),
        "task": task.name,
    }
