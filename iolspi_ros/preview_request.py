"""What a node asks of the process that learns beside it: some transitions, and by which learner."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np

from iolspi_ros import task as tasks
from iolspi_ros.core.samples import Transitions
from iolspi_ros.task import TaskDescription

_COLUMNS = tuple(field.name for field in fields(Transitions))


class Request(NamedTuple):
    """One question.

    Attributes
    ----------
    task : TaskDescription
    learner : str
        As registered.
    settings : mapping
        Its settings, by name.
    rows : Transitions
    """

    task: TaskDescription
    learner: str
    settings: Mapping[str, Any]
    rows: Transitions

    def pack(self) -> bytes:
        """As bytes."""
        about = {
            "task": tasks.dump(self.task), "learner": self.learner, "settings": dict(self.settings)
        }  # fmt: skip
        columns = {name: getattr(self.rows, name) for name in _COLUMNS}
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, about=json.dumps(about), **columns)
        return buffer.getvalue()

    @classmethod
    def unpack(cls, data: bytes) -> Request:
        """What `pack` gave.

        Raises
        ------
        InputError
            When the task in it is none.
        """
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            rows = Transitions(*(file[name] for name in _COLUMNS))
        return cls(
            tasks.load(about["task"], "the request"), about["learner"], about["settings"], rows
        )
