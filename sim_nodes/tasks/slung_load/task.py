"""A quadrotor that drops its slung load into a basket, in two dimensions (T IV-B)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import check_range
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Action, Ending, TaskDescription, Variable
from sim_nodes.tasks.base import advance
from sim_nodes.tasks.law import Law
from sim_nodes.tasks.shapes import FALL_TIME, Picture, Point
from sim_nodes.tasks.slung_load import dynamics
from sim_nodes.tasks.slung_load.as_flown import LATEST, AsFlown
from sim_nodes.tasks.slung_load.dynamics import (
    ACCELERATIONS,
    CABLE,
    DUNK,
    GOAL,
    LENGTH,
    MARGIN,
    MISS,
    PARAMETERS,
    RIM,
    SAMPLING_TIME,
    WALL,
    WALLS,
)
from sim_nodes.tasks.slung_load.picture import picture, released
from sim_nodes.tasks.slung_load.pilot import Explore, Perform

Array = NDArray[np.float64]

_RANGES = {"wide": (-6.0, 0.0), "narrow": (-5.0, -4.0)}  # x [m]: T IV-B; T 11-2
_WIDEST_ANGLE = np.pi / 3
_SWEPT = (13, 11)  # initial positions and angles


@dataclass(frozen=True)
class SlungLoad(Settings):
    """Parameters and equations of the quadrotor with a slung load.

    State [x, ẋ, θ, θ̇]: position of the quadrotor [m] and its rate [m/s], x to the right;
    angle of the cable [rad], zero hanging down and positive to the right, and its rate
    [rad/s]. Actions: accelerations of the quadrotor -3, 0, +3 m/s², and `RELEASE`.

    T leaves open, and here it is so: the walls; the load's flight, a parabola until the rim's
    plane; a load below the rim at release, a miss; the rewards of a crash, which are those of
    the step that leads into it, a wall before the cable; γ. A release ends the episode whatever
    the quadrotor does in that step.

    `step` is T's own vehicle, which answers at once; `as_flown` makes one that answers as an
    autopilot does. In T Eq. 18 the load does not pull at the quadrotor, so that no mass is in it.

    References
    ----------
    T IV-B, Eqs. 18 to 20, Table 2; 11-1 and 11-2.
    """

    initial: str = setting(
        "wide",
        "initial positions: -6 to 0 m (T IV-B), or narrow, -5 to -4 m (T 11-2)",
        choices=tuple(_RANGES),
    )
    delay: float = setting(
        0.0, "an acceleration begins to come about so late [s]", low=0.0, high=LATEST
    )
    lag: float = setting(0.0, "first-order lag with which it then does [s]", low=0.0, high=2.0)
    drag: float = setting(0.0, "of the vehicle: deceleration over speed [1/s]", low=0.0, high=5.0)
    gain: float = setting(
        1.0, "times what is asked for, an acceleration comes about", low=0.1, high=3.0
    )
    gain_spread: float = setting(
        0.0, "the gain differs between episodes, by this share each way", low=0.0, high=0.9
    )
    delay_spread: float = setting(
        0.0, "the delay differs between episodes, by this share each way", low=0.0, high=1.0
    )
    lag_spread: float = setting(
        0.0, "the lag differs between episodes, by this share each way", low=0.0, high=1.0
    )
    drag_spread: float = setting(
        0.0, "the drag differs between episodes, by this share each way", low=0.0, high=1.0
    )
    push_spread: float = setting(
        0.0,
        "something pushes the vehicle all the time: by up to so much each way [m/s^2]",
        low=0.0,
        high=3.0,
    )

    # From rest, 26 steps of 0.3 m/s reach the farther wall; no load swings faster than 6.2 rad/s.
    description = TaskDescription(
        name="slung_load",
        variables=(
            Variable("quadrotor.position", "m", *WALLS, label="position"),
            Variable("quadrotor.velocity", "m/s", -7.8, 7.8, label="speed"),
            Variable("load.position", "rad", -np.pi / 2, np.pi / 2, label="angle of the cable"),
            Variable("load.velocity", "rad/s", -6.5, 6.5, label="its rate"),
        ),
        actions=tuple(
            Action(name, (acceleration,))
            for name, acceleration in zip(
                ("-3 m/s²", "0", "+3 m/s²", "release"), ACCELERATIONS, strict=True
            )
        ),
        action_unit="m/s^2",
        neutral=1,
        sampling_time=SAMPLING_TIME,
        episode_steps=50,
        gamma=0.98,
        endings=(  # by `Outcome`
            Ending("time-out"),
            Ending("dunk", DUNK, success=True),
            Ending("miss", MISS),
            Ending("crash: cable", CABLE),
            Ending("crash: wall", WALL),
        ),
        success="end with a dunk",
        map_variables=("quadrotor.position", "load.position"),
    )
    usual_episodes = 1000
    reference_points = (39, 53, 61, 53)  # ẋ only takes multiples of 0.3 m/s: 53 points hit them
    reference_lookahead = 4
    compiled = staticmethod(dynamics.step)

    length, goal, margin, rim, walls = LENGTH, GOAL, MARGIN, RIM, WALLS  # [m]

    def __post_init__(self) -> None:
        super().__post_init__()
        longest = self.delay * (1.0 + self.delay_spread)
        check_range("delay with its spread", longest, 0.0, LATEST)

    def as_flown(self) -> AsFlown | None:
        """The same with a vehicle that answers late or is braked by the air; None for T's own."""
        changed = (self.delay, self.lag, self.drag, self.push_spread, self.gain_spread)
        return AsFlown(self) if any(changed) or self.gain != 1.0 else None

    def parameters(self, time: float) -> Array:
        """(g, L, x_goal, x_gmargin, z_goal, x of the walls, T_s), shape (8,); always the same."""
        return np.array(PARAMETERS)

    def step(
        self,
        state: Array,
        action: NDArray[np.int64] | int,
        time: float = 0.0,
        noise: Array | float = 0.0,
    ) -> tuple[Array, Any, Any]:
        """One sampling time by Euler's method, all derivatives at the state left (T Eq. 19).

        The distance in the reward is that of the state left (T Eq. 3), as the pendulum's cost;
        crashes are of the state reached, a release is of the state left.
        """
        return advance(dynamics.step, dynamics.steps, state, action, noise, self.parameters(time))

    def initial_states(self) -> Array:
        """A regular grid over the ranges of T, ends included: 13 x by 11 θ, shape (143, 4)."""
        n_x, n_angle = _SWEPT
        x = np.linspace(*_RANGES[self.initial], n_x)
        angle = np.linspace(-_WIDEST_ANGLE, _WIDEST_ANGLE, n_angle)
        states = np.zeros((n_x * n_angle, 4))
        states[:, 0], states[:, 2] = np.repeat(x, n_angle), np.tile(angle, n_x)
        return states

    def draw_initial(self, rng: np.random.Generator) -> Array:
        """At rest, x and θ uniform over their ranges."""
        x = rng.uniform(*_RANGES[self.initial])
        return np.array((x, 0.0, rng.uniform(-_WIDEST_ANGLE, _WIDEST_ANGLE), 0.0))

    def landing(self, state: Array) -> float | None:
        """Where a load released here crosses the rim's plane, x [m]; None if it hangs below."""
        return dynamics.landing(state)

    def judge(self, state: Array, next_state: Array) -> tuple[float, bool]:
        """Reward and end of a step that was flown with the load on its cable, not computed.

        Parameters
        ----------
        state, next_state : ndarray of shape (4,)
            As measured, one sampling time apart.
        """
        reward, terminated = dynamics.judge(state, next_state, self.parameters(0.0))
        return float(reward), bool(terminated)

    def landed(self, landing: float | None) -> float:
        """Reward for a load that crossed the rim's plane at x [m], or (None) never was above it."""
        inside = landing is not None and abs(landing - self.goal) <= self.margin
        return DUNK if inside else MISS

    def pilot(self, mode: str, rng: np.random.Generator) -> Law:
        """The law of a scripted pilot who performs or explores."""
        return Perform() if mode == "perform" else Explore(rng)

    def picture(self, state: Array, released: Point | None = None) -> Picture:
        """What a state looks like, with the load elsewhere [m] when it was released."""
        return picture(state, released)

    def released(self, before: Array, reward: float, times: Array) -> Array:
        """Where a load is that was released in an episode's last step.

        Parameters
        ----------
        before : ndarray of shape (4,)
            The state that the step left.
        reward : float
            Of the step.
        times : ndarray of shape (n,)
            Since then [s].

        Returns
        -------
        ndarray of shape (n, 3)
            x, y and z [m]; of shape (0, 3) when nothing was released.
        """
        return released(before, reward, times)

    def trail(self, states: Array, reward: float) -> Array:
        """The load's way in the plane, and of its fall; x and z [m], shape (n, 2).

        Parameters
        ----------
        states : ndarray of shape (n_states, 4)
            Of an episode, at least two.
        reward : float
            Of the last step.
        """
        fall = self.released(states[-2], reward, np.linspace(0.0, FALL_TIME, 15))
        x, angle = (states[:-1] if len(fall) else states)[:, [0, 2]].T
        swung = np.column_stack([x + LENGTH * np.sin(angle), -LENGTH * np.cos(angle)])
        return np.concatenate([swung, fall[:, [0, 2]]])
