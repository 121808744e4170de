"""The tasks by name. A new task is one module here and one line below."""

from __future__ import annotations

from typing import Any

from iolspi_ros.errors import InputError
from iolspi_ros.settings import from_mapping
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.cart_pole import CartPole
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

TASKS: dict[str, type[Any]] = {
    "pendulum": Pendulum,
    "slung_load": SlungLoad,
    "cart_pole": CartPole,
}


def task_class(name: str) -> type[Any]:
    """Settings dataclass of a task.

    Raises
    ------
    InputError
        When no task has this name; lists those that there are.
    """
    if name not in TASKS:
        raise InputError(f"task is {name!r}; allowed: {', '.join(TASKS)}")
    return TASKS[name]


def make_task(name: str, values: dict[str, Any], where: str) -> Task:
    """A task with the settings that a YAML file gives it.

    Raises
    ------
    InputError
        When the task is unknown or a value is not allowed.
    """
    task: Task = from_mapping(task_class(name), values, where)
    return task
