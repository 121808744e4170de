"""The tasks by name. A new one is a module of its own, here or anywhere, and an entry point."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from iolspi_ros import registry
from iolspi_ros import task as tasks
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, from_mapping
from iolspi_ros.task import TaskDescription
from sim_nodes.tasks import gym_vehicle
from sim_nodes.tasks.base import Task

GROUP = "iolspi_ros.tasks"
FILES = (".yaml", ".yml")
STATELESS = ("step", "initial_states", "draw_initial")
STATEFUL = ("starts", "fresh", "begin", "advance", "close")


def names() -> tuple[str, ...]:
    """Names of the registered tasks."""
    return registry.names(GROUP)


def task_class(name: str) -> type[Any]:
    """Class of a registered task, of `module:Class`, of `gymnasium:ID`, or of a file about one.

    Raises
    ------
    InputError
        When no task has this name; lists those that there are.
    """
    found = _find(name)
    lacking = [member for member in STATELESS if not hasattr(found, member)]
    if all(hasattr(found, member) for member in STATEFUL):
        lacking = []
    if lacking or not isinstance(getattr(found, "description", None), TaskDescription):
        raise InputError(
            f"task {name} has no {', '.join(lacking) or 'description'}; allowed: a class as "
            "described in sim_nodes.tasks.base.Task or Stateful"
        )
    return found


def _find(name: str) -> Any:
    if name.startswith(gym_vehicle.PREFIX):
        return gym_vehicle.by_id(name)
    if not name.endswith(FILES):
        return registry.find(GROUP, "task", name)
    path = Path(name).expanduser()
    content = tasks.read_plain(path)
    if isinstance(content, dict) and "gymnasium" in content:
        return gym_vehicle.by_file(path)
    what = "says where a robot's topics are" if is_robot(content) else "names no environment"
    raise InputError(
        f"{path} {what}, so nothing here can simulate it; allowed: a file with gymnasium: ID, or "
        f"the robot itself (or its own simulator) and iolspi run vehicle --task {path}"
    )


def is_robot(content: Any) -> bool:
    """Whether what a file holds is about a robot's own topics."""
    return isinstance(content, dict) and "state" in content and "command" in content


def make_task(name: str, values: dict[str, Any], where: str) -> Task:
    """A task with the settings that a YAML file gives it.

    Raises
    ------
    InputError
        When the task is unknown or a value is not allowed.
    """
    cls = task_class(name)
    return as_set(from_mapping(cls, values, where) if issubclass(cls, Settings) else cls())


def as_set(task: Any) -> Task:
    """The vehicle that a task's settings make: the task, or what its `as_flown` gives."""
    made = task.as_flown() if hasattr(task, "as_flown") else None
    vehicle: Task = task if made is None else made
    return vehicle
