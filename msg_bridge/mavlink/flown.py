"""What a flight must know of a task: its axes, its state, its starts, and what it gives.

All that is judged is judged by the task's own pure code; here it is only told of a `Motion`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription
from msg_bridge.mavlink.envelope import Limits, starts
from msg_bridge.mavlink.motion import Motion, Vector
from msg_bridge.mavlink.settings import FlightSettings
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

Array = NDArray[np.float64]


class FlownTask(Protocol):
    """A task that is flown: a load is brought to a basket, and let go.

    Attributes
    ----------
    description : TaskDescription
    axes : int
        Along how many horizontal axes its actions accelerate: 1 or 2.
    release : int
        The action that lets the load go.
    goal : tuple of float
        Where the basket is along each axis [m].
    """

    description: TaskDescription
    axes: int
    release: int
    goal: tuple[float, ...]

    def state(self, motion: Motion) -> Array:
        """The task's state, shape (n_dims,)."""
        ...

    def judge(self, before: Motion, after: Motion) -> tuple[float, bool]:
        """Reward and end of a step that was flown with the load on its cable."""
        ...

    def rim(self, motion: Motion) -> float:
        """Height of the plane in which a load that is let go now is judged [m]."""
        ...

    def landed(self, place: Array | None) -> float:
        """Reward of a load that crossed that plane at (x, y) [m]; None if it never did."""
        ...

    def dropped(self, motion: Motion) -> float:
        """The same of a load let go here that nobody sees: of its parabola."""
        ...

    def heights(self) -> tuple[float, float]:
        """Least and greatest height of its starts [m]."""
        ...

    def draw_start(self, rng: np.random.Generator) -> Vector:
        """Where an episode begins, drawn at random: x, y and height [m]."""
        ...

    def sweep(self, number: int) -> Vector:
        """Where an episode begins, of those swept one after the other."""
        ...


class OneAxis:
    """The slung load (T IV-B): along a track, at one height."""

    axes, release = 1, RELEASE

    def __init__(self, task: SlungLoad, height: float) -> None:
        self._task, self._height = task, height
        self.description = task.description
        self.goal: tuple[float, ...] = (task.goal,)
        self._places = np.unique(task.initial_states()[:, 0])

    def state(self, motion: Motion) -> Array:
        """[x, ẋ, θ, θ̇]."""
        return np.array(motion.plane(0))

    def judge(self, before: Motion, after: Motion) -> tuple[float, bool]:
        """See `SlungLoad.judge`."""
        return self._task.judge(self.state(before), self.state(after))

    def rim(self, motion: Motion) -> float:
        """As far below the vehicle as the task has it."""
        return motion.height - self._task.rim

    def landed(self, place: Array | None) -> float:
        """See `SlungLoad.landed`."""
        return self._task.landed(None if place is None else float(place[0]))

    def dropped(self, motion: Motion) -> float:
        """See `SlungLoad.landing`."""
        return self._task.landed(self._task.landing(self.state(motion)))

    def heights(self) -> tuple[float, float]:
        """That which is flown at."""
        return self._height, self._height

    def draw_start(self, rng: np.random.Generator) -> Vector:
        """Of the task's own."""
        return float(self._task.draw_initial(rng)[0]), 0.0, self._height

    def sweep(self, number: int) -> Vector:
        """The places of the task's grid."""
        return float(self._places[number % len(self._places)]), 0.0, self._height


class TwoAxes:
    """The slung load in three dimensions (T 6-2): x, y, and the altitude that it begins at."""

    axes = 2

    def __init__(self, task: SlungLoad3D) -> None:
        self._task = task
        self.description, self.release = task.description, task.actions.release
        self.goal: tuple[float, ...] = task.basket[:2]

    def state(self, motion: Motion) -> Array:
        """[x, ẋ, y, ẏ, z, ż, θx, θ̇x, θy, θ̇y]."""
        return self._task.seen(
            np.array(motion.place), np.array(motion.velocity), np.array(motion.cable),
            np.array(motion.cable_rate),
        )  # fmt: skip

    def judge(self, before: Motion, after: Motion) -> tuple[float, bool]:
        """See `SlungLoad3D.judge`."""
        return self._task.judge(
            self.state(before), np.array(after.place), np.array(after.up), np.array(after.cable)
        )

    def rim(self, motion: Motion) -> float:
        """Above the ground."""
        return self._task.basket[2]

    def landed(self, place: Array | None) -> float:
        """See `SlungLoad3D.landed`."""
        return self._task.landed(place)

    def dropped(self, motion: Motion) -> float:
        """See `SlungLoad3D.landing`."""
        return self._task.landed(self._task.landing(self.state(motion)))

    def heights(self) -> tuple[float, float]:
        """Of the task."""
        return self._task.altitudes

    def draw_start(self, rng: np.random.Generator) -> Vector:
        """Of the task's own."""
        return self._start(int(rng.integers(2**32)))

    def sweep(self, number: int) -> Vector:
        """Those of the starts that policies are judged from."""
        return self._start(number % self._task.starts)

    def _start(self, seed: int) -> Vector:
        x, y, height = self._task.begin(seed)[:6:2].tolist()
        return x, y, height


TASKS: Mapping[str, type[SlungLoad] | type[SlungLoad3D]] = {
    "slung_load": SlungLoad, "slung_load_3d": SlungLoad3D,
}  # fmt: skip
"""Those that can be flown."""


def flown(task: SlungLoad | SlungLoad3D, settings: FlightSettings) -> FlownTask:
    """A task as a flight needs it.

    Raises
    ------
    InputError
        When its actions ask for more than can be flown.
    """
    found = OneAxis(task, settings.height) if isinstance(task, SlungLoad) else TwoAxes(task)
    if (size := len(found.description.actions[0].value)) != found.axes:
        raise InputError(
            f"actions of {found.description.name} have {size} numbers each; allowed for a flight: "
            f"{found.axes}, as it holds the altitude (vertical: false)"
        )
    return found


def warm_up(task: FlownTask) -> None:
    """Compile what is needed in flight: the first call takes seconds."""
    task.judge(Motion(), Motion())
    task.dropped(Motion())
    task.draw_start(np.random.default_rng(0))


def check_room(task: FlownTask, settings: FlightSettings, limits: Limits) -> None:
    """Raise unless the task fits into the envelope.

    Parameters
    ----------
    task : FlownTask
    settings : FlightSettings
    limits : Limits
        With the margin that is kept from the walls.

    Raises
    ------
    InputError
        Naming what does not, and what is allowed.
    """
    name = task.description.name
    if limits.axes != task.axes:
        raise InputError(
            f"box is {list(limits.box)}, {limits.axes} of the horizontal axes, and {name} moves "
            f"along {task.axes}; allowed: {2 * task.axes} numbers"
        )
    for axis, goal in enumerate(task.goal):
        (low, high), (least, greatest), where = limits.sides[axis], starts(limits, axis), "xy"[axis]
        if least >= greatest:
            raise InputError(
                f"box is {list(limits.box)}: {high - low:g} m in {where} leave no room to start in "
                f"between margins of {limits.margin:g} m; allowed: more"
            )
        if not low <= goal <= high:
            raise InputError(
                f"the basket of {name} is at {where} = {goal:g} m, outside the box of {low:g} to "
                f"{high:g} m; allowed: a box around it, or a basket within"
            )
    lowest, highest = limits.heights
    for what, height in (
        ("height", settings.height),
        *((f"height of a start of {name}", height) for height in task.heights()),
    ):
        if not lowest < height < highest:
            raise InputError(
                f"{what} is {height:g} m; allowed: within heights, {lowest:g} to {highest:g} m"
            )
