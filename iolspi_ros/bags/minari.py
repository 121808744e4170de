"""Samples as a dataset of Minari (Gymnasium's offline data), and back; the extra `minari`.

A piece of an episode in which no step is missing is an episode there. Its infos hold where each
sample came from, and the dataset's description is the task, so that what was written is read back
as it was.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from iolspi_ros.bags.demonstration import Demonstration
from iolspi_ros.bags.export import pieces
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription, dump, load

KEYS = ("episode", "step", "stamp", "source")


def write_minari(name: str, found: Demonstration) -> None:
    """Make a dataset where Minari keeps its own.

    Parameters
    ----------
    name : str
        As in ``boat/human-v0``.
    found : Demonstration

    Raises
    ------
    InputError
        Without Minari, without samples, for a name that is none or is there already.
    """
    minari = _library()
    from gymnasium import spaces
    from minari.data_collector import EpisodeBuffer

    if not found.samples:
        raise InputError(f"bag {found.path} has no samples; allowed: some")
    task = found.task
    limits = np.array([[v.low for v in task.variables], [v.high for v in task.variables]])
    episodes = [
        EpisodeBuffer(id=n, **_columns(piece)) for n, piece in enumerate(pieces(found.samples))
    ]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about an environment, an author, an address
            minari.create_dataset_from_buffers(
                name, episodes,
                observation_space=spaces.Box(limits[0], limits[1], dtype=np.float64),
                action_space=spaces.Discrete(task.n_actions), description=dump(task),
                algorithm_name=str(found.card.get("pilot", "unknown")),
            )  # fmt: skip
    except (ValueError, OSError) as error:
        raise InputError(f"Minari does not make {name!r}: {error}") from error


def read_minari(name: str, task: TaskDescription | None) -> tuple[list[Sample], TaskDescription]:
    """The samples of a dataset that Minari has on this machine.

    Of a dataset that somebody else made, episodes are numbered from 0 and every action counts as
    scripted.

    Parameters
    ----------
    name : str
    task : TaskDescription, optional
        That they are of; else the one that the dataset describes.

    Raises
    ------
    InputError
        Without Minari, without the dataset or a task, or when the two do not fit.
    """
    minari = _library()
    try:
        found = minari.load_dataset(name)
    except (ValueError, OSError) as error:  # also for a name that is none
        raise InputError(f"Minari has no dataset {name!r}: {error}") from error
    task = task or _described(name, found.spec.observation_space, found)
    first = _fit(name, found, task)
    samples: list[Sample] = []
    for number, episode in enumerate(found.iterate_episodes()):
        samples += _samples(number, episode, first, len(samples), task)
    return samples, task


def _columns(piece: list[Sample]) -> dict[str, Any]:
    steps = [sample.transition for sample in piece]
    keys = {key: np.array([int(getattr(sample, key)) for sample in piece]) for key in KEYS}
    return {
        "observations": np.stack([*(t.state for t in steps), steps[-1].next_state]),
        "actions": np.array([t.action for t in steps]),
        "rewards": [t.reward for t in steps],
        "terminations": [t.terminated for t in steps],
        "truncations": [t.truncated for t in steps],
        # one more than steps: Minari's first are those of the reset
        "infos": {key: np.append(column, column[-1]) for key, column in keys.items()},
    }


def _described(name: str, space: Any, found: Any) -> TaskDescription:
    try:
        return load(str(found.storage.metadata.get("description", "")), f"dataset {name}")
    except InputError as error:
        raise InputError(
            f"dataset {name} does not say of which task it is ({space}); allowed: --task"
        ) from error


def _fit(name: str, found: Any, task: TaskDescription) -> int:
    """The number of the first action there, when the dataset is of such a task."""
    shape, actions = found.spec.observation_space.shape, found.spec.action_space
    if shape != (task.n_dims,) or getattr(actions, "n", 0) != task.n_actions:
        raise InputError(
            f"dataset {name} has observations {found.spec.observation_space} and actions {actions};"
            f" allowed for task {task.name}: {task.n_dims} variables, {task.n_actions} actions"
        )
    return int(actions.start)


def _samples(
    number: int, episode: Any, first: int, before: int, task: TaskDescription
) -> Iterator[Sample]:
    period = round(task.sampling_time * 1e9)
    infos = episode.infos or {}
    ours = all(len(infos.get(key, ())) == len(episode.actions) + 1 for key in KEYS)
    states = np.asarray(episode.observations, np.float64)
    for k, action in enumerate(episode.actions):
        transition = Transition(
            states[k], int(action) - first, float(episode.rewards[k]), states[k + 1],
            bool(episode.terminations[k]), bool(episode.truncations[k]),
        )  # fmt: skip
        if ours:
            place = [int(infos[key][k]) for key in KEYS]
        else:
            place = [number, k, (before + number + k) * period, Source.SCRIPTED]
        yield Sample(place[0], place[1], place[2], transition, place[3])


def _library() -> Any:
    try:
        import minari
    except ImportError as error:
        raise InputError(
            "Minari is not installed; install it with pip install 'minari[hdf5]'"
        ) from error
    return minari
