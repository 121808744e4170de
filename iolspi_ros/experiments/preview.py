"""What a learner would get from some demonstrations now: learned, and flown on the task's model.

`python -m iolspi_ros.experiments.preview` does it in a process of its own and of low priority, for
a node whose control thread must not wait: it reads a request from its input, and writes a line of
JSON.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.errors import InputError
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import make_learner
from iolspi_ros.preview_request import Request
from iolspi_ros.task import TaskDescription
from sim_nodes.tasks import make_task, names
from sim_nodes.tasks.base import Task

NICE = 15


def model_of(task: TaskDescription) -> Task | None:
    """The model of a task, where a registered one is the same; nothing else is ever imported."""
    if task.name not in names():
        return None
    model = make_task(task.name, {}, task.name)
    return None if task.differences(model.description) else model


def foresee(request: Request) -> dict[str, Any]:
    """Learn from some transitions, and fly what was learned from every start.

    Returns
    -------
    dict
        `accepted`: whether a policy came of it. `share`: of the starts from which it succeeds;
        None without a model.

    Raises
    ------
    InputError
        When nothing can be learned from them.
    """
    core = make_learner(request.learner, request.task, request.settings, "the learner", 0)
    update = core.pretrain(request.rows)
    model = model_of(request.task)
    share = evaluate(model, greedy_policy(core)).success_fraction if model is not None else None
    return {"accepted": bool(update.accepted), "share": share}


def main() -> int:
    """Answer one request; 2 when nothing can be learned from it."""
    os.nice(NICE)
    try:
        found = foresee(Request.unpack(sys.stdin.buffer.read()))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    print(json.dumps(found))
    return 0


if __name__ == "__main__":
    sys.exit(main())
