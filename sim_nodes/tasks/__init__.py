"""The tasks by name. A new one is a module of its own, here or anywhere, and an entry point."""

from __future__ import annotations

from typing import Any

from iolspi_ros import registry
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, from_mapping
from iolspi_ros.task import TaskDescription
from sim_nodes.tasks.base import Task

GROUP = "iolspi_ros.tasks"


def names() -> tuple[str, ...]:
    """Names of the registered tasks."""
    return registry.names(GROUP)


def task_class(name: str) -> type[Any]:
    """Class of a registered task, or of `module:Class`.

    Raises
    ------
    InputError
        When no task has this name; lists those that there are.
    """
    found = registry.find(GROUP, "task", name)
    members = ("step", "initial_states", "draw_initial")
    lacking = [member for member in members if not hasattr(found, member)]
    if lacking or not isinstance(getattr(found, "description", None), TaskDescription):
        raise InputError(
            f"task {name} has no {', '.join(lacking) or 'description'}; allowed: a class as "
            "described in sim_nodes.tasks.base.Task"
        )
    return found


def make_task(name: str, values: dict[str, Any], where: str) -> Task:
    """A task with the settings that a YAML file gives it.

    Raises
    ------
    InputError
        When the task is unknown or a value is not allowed.
    """
    cls = task_class(name)
    task: Task = from_mapping(cls, values, where) if issubclass(cls, Settings) else cls()
    return task
