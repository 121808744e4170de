"""The drop-off in three dimensions as a task (T 6-2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Ending, Symmetry, TaskDescription, Variable
from sim_nodes.quadrotor import control
from sim_nodes.quadrotor.airframe import AIRFRAMES, Payload, check_payload
from sim_nodes.quadrotor.body import (
    LOAD,
    LOAD_VELOCITY,
    POSITION,
    SIZE,
    VELOCITY,
    hovering,
)
from sim_nodes.quadrotor.flight import STEP, Vehicle, fly, vehicle
from sim_nodes.quadrotor.wind import Gusts, check_wind, gusts
from sim_nodes.tasks.law import Law
from sim_nodes.tasks.shapes import Picture, Point
from sim_nodes.tasks.slung_load_3d import actions, picture
from sim_nodes.tasks.slung_load_3d.actions import Actions, symmetries
from sim_nodes.tasks.slung_load_3d.foresight import foresee
from sim_nodes.tasks.slung_load_3d.pilot import Explore, Perform
from sim_nodes.tasks.slung_load_3d.scene import (
    CABLE,
    CEILING,
    DUNK,
    HALL,
    MISS,
    SEEN,
    WALL,
    Basket,
    check_basket,
    crash,
    crashed,
    distance,
    dunks,
    landing,
    load_of,
    see,
)

Array = NDArray[np.float64]

SAMPLING_TIME = 0.1
"""T_s [s], as in two dimensions."""
_STEPS = round(SAMPLING_TIME / STEP)
_START, _ALTITUDE, _SWING = 4.0, (2.4, 3.2), math.pi / 6  # [m], [m], [rad]
_GAINS = control.Gains()
_CATCHES_UP = -math.expm1(-SAMPLING_TIME / 1.0)
"""Share of its error that the wind's estimate makes good in a step: its lag is 1 s."""


def describe(chosen: Actions, symmetries: tuple[Symmetry, ...]) -> TaskDescription:
    """The task with some actions, and what may be exchanged in it."""
    vertical = chosen.values.shape[1] == 3
    axes = (("x", -HALL, HALL, 8.0), ("y", -HALL, HALL, 8.0), ("z", 0.0, CEILING, 3.0))
    swings = (("swing_x", "the cable ahead"), ("swing_y", "the cable to the left"))
    variables = [
        variable
        for name, low, high, fast in axes
        for variable in (
            Variable(f"{name}.position", "m", low, high, label=name),
            Variable(f"{name}.velocity", "m/s", -fast, fast, label=f"speed in {name}"),
        )
    ]
    for name, label in swings:
        variables += [
            Variable(f"{name}.position", "rad", -math.pi / 2, math.pi / 2, label=label),
            Variable(f"{name}.velocity", "rad/s", -8.0, 8.0, label=f"rate of {label}"),
        ]
    return TaskDescription(
        name="slung_load_3d",
        variables=tuple(variables),
        actions=chosen.described(),
        action_unit="m/s^2, m/s^2, m/s" if vertical else "m/s^2",
        neutral=chosen.neutral,
        sampling_time=SAMPLING_TIME,
        episode_steps=60,
        gamma=0.98,
        endings=(
            Ending("time-out"),
            Ending("dunk", DUNK, success=True),
            Ending("miss", MISS),
            Ending("crash: cable", CABLE),
            Ending("crash: wall or ground", WALL),
        ),
        success="end with a dunk",
        map_variables=("x.position", "y.position"),
        symmetries=symmetries,
    )


@dataclass
class _Episode:
    """What flies now."""

    craft: Vehicle
    payload: Payload
    air: Gusts
    rng: np.random.Generator
    seen: Array
    estimate: Array  # of the wind, towards x and y [m/s]


@dataclass(eq=False)
class SlungLoad3D(Settings):
    """A quadrotor with six degrees of freedom brings its load to a basket; a `Stateful` vehicle.

    Seen is [x, ẋ, y, ẏ, z, ż, θx, θ̇x, θy, θ̇y]: position of the quadrotor, east, north and up
    [m], and the cable's angles from hanging down in the planes of x and of y [rad], each with its
    rate. Hidden are its attitude, the rotors, the air and whether the cable is slack. Actions ask
    the low-level controller for accelerations, which it leans for, and hold the altitude; the
    last lets the load go.

    References
    ----------
    T 6-2, with the reward of T Eq. 20: the distance is that in the plane, of the state left.
    """

    vehicle: str = setting("ar_drone_2", "T 6-3's, or a 1.5 kg one", choices=tuple(AIRFRAMES))
    load: float = setting(0.06, "mass of the load [kg]")
    cable: float = setting(1.0, "length of the cable [m]")
    load_spread: float = setting(
        0.0, "the load differs between episodes, by this share each way", low=0.0, high=0.9
    )
    cable_spread: float = setting(
        0.0, "the cable differs between episodes, by this share each way", low=0.0, high=0.9
    )
    wind: float = setting(0.0, "steady wind [m/s]")
    wind_direction: float = setting(0.0, "where it blows to, counter-clockwise from +x [rad]")
    gusts: bool = setting(True, "in wind: gusts of MIL-F-8785C besides")
    wind_held: bool = setting(
        False, "the controller leans against the wind, which it estimates with a lag of 1 s"
    )
    basket: tuple[float, ...] = setting((0.0, 0.0, 1.0), "its x, y and rim [m]")
    basket_radius: float = setting(1.5, "[m]: T Table 2's half width")
    vertical: bool = setting(False, "actions that climb and descend besides")
    accelerations: tuple[float, ...] = setting(
        (), "actions in place of nine of 3.0 m/s^2: x and y of each in turn; vertical: and climb"
    )

    description: ClassVar[TaskDescription] = describe(
        actions.usual(False), symmetries(actions.usual(False), np.zeros((2, 2)))
    )
    starts: ClassVar[int] = 100
    altitudes: ClassVar[tuple[float, float]] = _ALTITUDE
    """Least and greatest of a start [m]."""
    usual_episodes: ClassVar[int] = 1000

    def __post_init__(self) -> None:
        super().__post_init__()
        self._frame = AIRFRAMES[self.vehicle]
        self._payload = Payload(self.load, self.cable)
        check_wind(self.wind, self.wind_direction)
        self._check_loads()
        if len(self.basket) != 3:
            raise InputError(f"basket has {len(self.basket)} entries; allowed: x, y and rim [m]")
        self._basket = Basket(*self.basket, self.basket_radius)
        check_basket(self._basket)
        highest = _ALTITUDE[1] - self.cable * (1.0 - self.cable_spread)
        if self._basket.rim >= highest and not self.vertical:
            raise InputError(
                f"the basket's rim is at {self._basket.rim} m, and no load hangs higher than "
                f"{highest:.2f} m: it could not fall in; allowed: a rim below, a shorter cable, or "
                "vertical actions"
            )
        self.actions = actions.listed(self.accelerations, self.vertical)
        blown = 0.0 if self.wind_held else self.wind
        angle = self.wind_direction
        fixed = [self.basket[:2], (blown * math.cos(angle), blown * math.sin(angle))]
        kept = symmetries(self.actions, np.array(fixed))
        vars(self)["description"] = describe(self.actions, kept)
        self._episode: _Episode | None = None

    def _check_loads(self) -> None:
        """The load and cable as they are, and at both ends of what episodes may bring."""
        for side in (0.0, -1.0, 1.0):
            heavy, long = 1.0 + side * self.load_spread, 1.0 + side * self.cable_spread
            check_payload(
                self._frame, Payload(self.load * heavy, self.cable * long),
                "load" if side == 0.0 else f"load, where episodes differ ({side:+g})",
            )  # fmt: skip
        lowest = _ALTITUDE[0] - self.cable * (1.0 + self.cable_spread)
        if lowest < 0.1:
            raise InputError(
                f"cable is {self.cable} m, cable_spread {self.cable_spread}: the load would begin "
                f"{lowest:.2f} m above the ground; allowed: at least 0.1"
            )

    def fresh(self) -> SlungLoad3D:
        """Another of the kind."""
        return type(self)(**{field.name: getattr(self, field.name) for field in fields(self)})

    def begin(self, seed: int) -> Array:
        """At rest anywhere in the hall, the load swung out; load, cable and air of this episode."""
        rng = np.random.default_rng(seed)
        x, y = rng.uniform(-_START, _START, 2).tolist()
        z = float(rng.uniform(*_ALTITUDE))
        ahead, left = rng.uniform(-_SWING, _SWING, 2).tolist()
        heavy, long = rng.uniform(-1.0, 1.0, 2).tolist()
        payload = self._payload._replace(
            mass=self.load * (1.0 + self.load_spread * heavy),
            length=self.cable * (1.0 + self.cable_spread * long),
        )
        air = gusts(self.wind, self.wind_direction, z, STEP, 1.0 if self.gusts else 0.0)
        craft = vehicle(hovering(self._frame, payload, (x, y, z), (ahead, left)), air, rng)
        control.begin(craft.state, payload.mass / self._frame.mass, craft.memory)
        self._episode = _Episode(craft, payload, air, rng, np.empty(SEEN), craft.wind[:2].copy())
        see(craft.state, self._episode.seen)
        return self._episode.seen.copy()

    def advance(self, action: int, noise: float = 0.0) -> tuple[Array, float, bool, bool]:
        """Hold an action for T_s; noise is added to its accelerations towards x and y alike.

        A release is judged on the state left, a crash on the state reached, a wall before the
        cable, as in two dimensions.
        """
        now = self._flying()
        before = now.seen.copy()
        sticks = self._sticks(now, action)
        sticks[:2] += noise
        state = now.craft.state
        landed = None
        if action == self.actions.release:
            landed = landing(
                state[LOAD], state[LOAD_VELOCITY], now.craft.wind, now.payload.drag,
                self._basket.rim,
            )  # fmt: skip
        fly(
            now.craft, control.ACCELERATION, sticks, now.air, now.rng, _GAINS, self._frame,
            now.payload, _STEPS,
        )  # fmt: skip
        see(state, now.seen)
        now.estimate += _CATCHES_UP * (now.craft.wind[:2] - now.estimate)
        after = now.seen.copy()
        if landed is not None:
            return after, DUNK if dunks(landed, self._basket) else MISS, True, False
        reward = crash(state)
        if reward:
            return after, reward, True, False
        return after, -0.5 * distance(before, self._basket), False, False

    def foresee(self, plans: NDArray[np.int64]) -> Array:
        """Discounted returns of plans from here, on the true model, in the wind as it is now.

        Parameters
        ----------
        plans : ndarray of int, shape (n, length)
            Actions, none of them the release.

        Returns
        -------
        ndarray of shape (n, length + 1)
            When the load is released in place of the k-th action, or after the last.
        """
        now = self._flying()
        sticks = np.array([self._sticks(now, action) for action in range(self.actions.release)])
        returns = np.empty((len(plans), plans.shape[1] + 1))
        foresee(
            now.craft.state, now.craft.memory, now.craft.wind, sticks, plans, self._basket, _GAINS,
            self._frame, now.payload, _STEPS, self.description.gamma, returns,
        )  # fmt: skip
        return returns

    def _sticks(self, now: _Episode, action: int) -> Array:
        """What an action asks of the controller, shape (4,)."""
        sticks = np.zeros(4)
        push = self.actions.values[action]
        sticks[: len(push)] = push
        if self.wind_held:
            sticks[:2] -= self._frame.drag_across * now.estimate
        return sticks

    def _flying(self) -> _Episode:
        if self._episode is None:
            raise InputError("no episode has begun; allowed: begin, then advance")
        return self._episode

    def close(self) -> None:
        """Nothing to let go of."""

    # ------------------------------------------------------------ of what was flown elsewhere

    def seen(self, place: Array, velocity: Array, cable: Array, cable_rate: Array) -> Array:
        """What is seen of a vehicle whose load is on its cable.

        Parameters
        ----------
        place, velocity : ndarray of shape (3,)
            Of the vehicle [m], [m/s].
        cable, cable_rate : ndarray of shape (3,)
            Unit vector from it to the load, and its rate [1/s].

        Returns
        -------
        ndarray of shape (10,)
        """
        state, found = np.zeros(SIZE), np.empty(SEEN)
        state[POSITION], state[VELOCITY] = place, velocity
        state[LOAD], state[LOAD_VELOCITY] = place + cable, velocity + cable_rate
        see(state, found)
        return found

    def judge(self, before: Array, place: Array, up: Array, cable: Array) -> tuple[float, bool]:
        """Reward and end of a step that was flown with the load on its cable, not computed.

        Parameters
        ----------
        before : ndarray of shape (10,)
            As seen when the step began.
        place, up, cable : ndarray of shape (3,)
            When it ended: the vehicle [m]; unit vectors along the rotors' axis and to the load.
        """
        x, y, z = up.tolist()
        reward = crashed(place, (x, y, z), place + self.cable * cable, True)
        return (reward, True) if reward else (-0.5 * distance(before, self._basket), False)

    def landing(self, seen: Array) -> Array:
        """Where a load released here crosses the rim's plane in calm air: (x, y) [m], NaN below."""
        position, velocity = load_of(seen, self.cable)
        return landing(position, velocity, np.zeros(3), self._payload.drag, self._basket.rim)[:2]

    def landed(self, place: Array | None) -> float:
        """Reward for a load that crossed the rim's plane at (x, y) [m], or (None) never did."""
        return DUNK if place is not None and dunks(place, self._basket) else MISS

    # ------------------------------------------------------------ what a task may have besides

    def pilot(self, mode: str, rng: np.random.Generator) -> Law:
        """The law of a scripted pilot who performs or explores."""
        perform = Perform(self.actions, self._basket, self._payload)
        return perform if mode == "perform" else Explore(perform, rng)

    def picture(self, state: Array, released: Point | None = None) -> Picture:
        """What a state looks like, with the load elsewhere [m] when it was released."""
        return picture.picture(state, self._basket, self.cable, released)

    def released(self, before: Array, reward: float, times: Array) -> Array:
        """Where a load is that was released in an episode's last step, as without wind [m].

        Returns
        -------
        ndarray of shape (n, 3)
            Of shape (0, 3) when nothing was released.
        """
        return picture.released(before, reward, times, self._basket, self._payload)
