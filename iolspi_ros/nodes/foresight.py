"""What the learner would get from the episodes kept so far: learned beside, never waited for."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from rclpy.node import Node

from iolspi_ros.beside import beside
from iolspi_ros.core.learner import DEFAULT, Learner
from iolspi_ros.core.samples import Transitions
from iolspi_ros.learner_asked import LearnerAsked
from iolspi_ros.preview_request import Request
from iolspi_ros.task import TaskDescription

MODULE = "iolspi_ros.experiments.preview"
"""Runs in a process of its own, of low priority: see there."""
TOO_LONG = 300.0
"""Seconds after which nobody waits for an answer any more."""


class Foresight:
    """Asks a process what would be learned; of several sets only the newest matters.

    Parameters
    ----------
    node : rclpy.node.Node
        On whose graph the learner is asked for its settings; until it answers, it has defaults.
    task : TaskDescription
    """

    def __init__(self, node: Node, task: TaskDescription) -> None:
        self._task = task
        self._learner, self._settings = DEFAULT, dict[str, Any]()
        self._asked = LearnerAsked(node, task, self._like)
        self._process: subprocess.Popen[bytes] | None = None
        self._found: Future[Mapping[str, Any] | None] | None = None

    def _like(self, learner: Learner) -> None:
        self._settings = asdict(learner.settings)

    def ask(self, rows: Transitions) -> None:
        """Begin to learn from a set; what was begun of another one is forgotten."""
        self._stop()
        if not len(rows):
            return
        request = Request(self._task, self._learner, self._settings, rows)
        self._process = process = subprocess.Popen(
            [sys.executable, "-P", "-m", MODULE], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        self._found = beside(lambda: _answer(process, request))

    @property
    def busy(self) -> bool:
        """Whether something is being learned."""
        return self._found is not None

    def look(self) -> Mapping[str, Any] | None:
        """The answer to the newest question, once: see `experiments.preview.foresee`."""
        self._asked.ask()
        if self._found is None or not self._found.done():
            return None
        found, self._found, self._process = self._found, None, None
        return found.result() or {}

    def _stop(self) -> None:
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()  # the thread that waits for it takes its status
        self._process = self._found = None

    def close(self) -> None:
        """Learn nothing more."""
        self._stop()
        self._asked.close()


def _answer(process: subprocess.Popen[bytes], request: Request) -> Mapping[str, Any] | None:
    """What a process says to a request; None when it was ended, or had nothing to say."""
    try:
        said, _ = process.communicate(request.pack(), TOO_LONG)
        found = json.loads(said)
    except (OSError, ValueError, subprocess.TimeoutExpired):
        process.kill()
        process.wait()
        return None
    return found if isinstance(found, dict) else None
