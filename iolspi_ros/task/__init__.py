"""The task as data: what everybody but the dynamics needs to know of a vehicle. No ROS here."""

from iolspi_ros.task.description import Action, Ending, TaskDescription, Variable
from iolspi_ros.task.symmetry import Symmetry
from iolspi_ros.task.text import dump, load, make, read, read_plain

__all__ = [
    "Action",
    "Ending",
    "Symmetry",
    "TaskDescription",
    "Variable",
    "dump",
    "load",
    "make",
    "read",
    "read_plain",
]
