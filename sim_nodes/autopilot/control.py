"""From a target (position, velocity, acceleration) to the rotors: pure functions.

Two ways to follow a target, as the autopilots have them: `shaped` lets a reference move under
limits of acceleration and jerk and steers the vehicle along it (ArduCopter); the other way a
velocity wanted gives an acceleration in proportion to its error (PX4). Targets are north, east,
down; below them is the quadrotor's own attitude loop and mixer, in its frame: east, north, up.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.autopilot.ground import push, touch
from sim_nodes.quadrotor.airframe import Airframe, G, Payload
from sim_nodes.quadrotor.body import SIZE, STAGES, move
from sim_nodes.quadrotor.control import Gains as InnerGains
from sim_nodes.quadrotor.control import attitude, clip, heading_of, mix

Array = NDArray[np.float64]

HAS_POSITION, HAS_VELOCITY, HAS_ACCELERATION = 1, 2, 4
"""What a target says about an axis: position, velocity, acceleration; added where several."""

HOVER_TIME = 1.0
"""In which the thrust of hovering is learned [s]."""

INNER = InnerGains(attitude=144.0, rate=21.6, heading_rate=10.0)
"""Of attitude and rates: an angle follows in about 0.1 s."""


class Gains(NamedTuple):
    """How a vehicle follows its targets; horizontal before vertical where there are two."""

    shaped: bool
    jerk: tuple[float, float]  # [m/s^3]
    acceleration: tuple[float, float]  # when a velocity is followed [m/s^2]
    speed: tuple[float, float, float]  # when a position is followed: horizontal, up, down [m/s]
    top_speed: float  # horizontal, beyond which no acceleration target drives [m/s]
    position: tuple[float, float]  # [1/s]
    velocity: tuple[float, float]  # [1/s]
    integral: tuple[float, float]  # [1/s^2]
    velocity_scale: float  # steady velocity over the one asked for, without drag
    lift_error: float  # of an acceleration downwards that nothing corrects [m/s^2]
    tilt: float  # largest [rad]
    push: float  # largest horizontal acceleration that a target may ask for [m/s^2]
    yaw_rate: float  # largest [rad/s]


class Target(NamedTuple):
    """Where to go: `use` of each axis says which of the rows count."""

    use: NDArray[np.int64]  # (3,)
    values: Array  # (3, 3): positions [m], velocities [m/s], accelerations [m/s^2]; NED
    yaw: float = math.nan  # [rad]; NaN for no matter
    yaw_rate: float = 0.0  # [rad/s], where yaw is NaN


@cached_njit()
def root_control(error: float, p: float, limit: float) -> float:
    """Rate that brings an error to zero: in proportion nearby, by a root where that is too fast."""
    near = limit / (p * p)
    if error > near:
        return math.sqrt(2.0 * limit * (error - 0.5 * near))
    if error < -near:
        return -math.sqrt(2.0 * limit * (-error - 0.5 * near))
    return error * p


@cached_njit()
def shape(reference: Array, axis: int, use: int, values: Array, gains: Gains, dt: float) -> None:
    """Move one axis of the reference (3, 3) towards its target under the limits."""
    kind = 1 if axis == 2 else 0
    jerk, most = gains.jerk[kind], gains.acceleration[kind]
    speed = reference[1, axis]
    wanted = 0.0
    if use & (HAS_POSITION | HAS_VELOCITY):
        if use & HAS_POSITION:
            up, down = gains.speed[kind], gains.speed[2 if axis == 2 else 0]
            error = values[0, axis] - reference[0, axis]
            ahead = root_control(error, gains.position[kind], 0.7 * most)
            wanted = clip(ahead, -up, down) + (values[1, axis] if use & HAS_VELOCITY else 0.0)
        else:
            wanted = values[1, axis]
        rate = root_control(wanted - speed, jerk / most, jerk)
        push = clip(rate, -most, most) + (values[2, axis] if use & HAS_ACCELERATION else 0.0)
    else:
        push = values[2, axis]
        if axis < 2:
            push = clip(push, -gains.push, gains.push)
            ahead = speed + abs(reference[2, axis]) * reference[2, axis] / (2.0 * jerk)
            if abs(ahead) >= gains.top_speed and push * ahead > 0.0:
                push = 0.0
    step = clip(push - reference[2, axis], -jerk * dt, jerk * dt)
    reference[2, axis] += step
    reference[1, axis] += reference[2, axis] * dt
    reference[0, axis] += reference[1, axis] * dt


@cached_njit()
def follow(
    axis: int, use: int, values: Array, reference: Array, integral: Array,
    position: Array, velocity: Array, gains: Gains, dt: float,
) -> float:  # fmt: skip
    """Acceleration [m/s^2] for one axis, from where the vehicle believes it is."""
    kind = 1 if axis == 2 else 0
    if gains.shaped:
        shape(reference, axis, use, values, gains, dt)
        goal, ahead, push = reference[0, axis], reference[1, axis], reference[2, axis]
    else:
        reference[:, axis] = position[axis], velocity[axis], 0.0
        goal, ahead = values[0, axis], values[1, axis] if use & HAS_VELOCITY else 0.0
        push = values[2, axis] if use & HAS_ACCELERATION else 0.0
        if not use & (HAS_POSITION | HAS_VELOCITY):
            integral[axis] = 0.0
            return push + (gains.lift_error if axis == 2 else 0.0)
        if not use & HAS_POSITION:
            goal = position[axis]
            if axis < 2:
                ahead = clip(ahead * gains.velocity_scale, -gains.top_speed, gains.top_speed)
    wanted = gains.position[kind] * (goal - position[axis])
    up, down = gains.speed[kind], gains.speed[2 if axis == 2 else 0]
    error = clip(wanted, -up, down) + ahead - velocity[axis]
    integral[axis] = clip(integral[axis] + gains.integral[kind] * error * dt, -3.0, 3.0)
    return push + gains.velocity[kind] * error + integral[axis]


@cached_njit()
def lean(wanted: Array, tilt: float) -> tuple[float, float, float]:
    """Thrust over mass (east, north, up) [m/s^2] that gives an acceleration (north, east, down)."""
    north, east, lift = wanted[0], wanted[1], max(G - wanted[2], 0.2 * G)
    level, most = math.hypot(north, east), lift * math.tan(tilt)
    if level > most:
        north, east = north * most / level, east * most / level
    return east, north, lift


@cached_njit()
def learn_hover(hover: Array, lift: float, sinks: float, dt: float) -> None:
    """What the thrust does not turn into acceleration is the weight of the load.

    Parameters
    ----------
    hover : ndarray of shape (1,)
        Changed in place.
    lift : float
        Of the thrust, upwards, over mass [m/s^2].
    sinks : float
        Acceleration downwards [m/s^2].
    dt : float
    """
    if G - sinks > 0.3 * G:
        ratio = clip(lift / (G - sinks), 0.8, 2.0)
        hover[0] += (ratio - hover[0]) * dt / HOVER_TIME


@cached_njit()
def fly(
    state: Array, reference: Array, integral: Array, hover: Array,
    use: NDArray[np.int64], values: Array, yaw: float, yaw_rate: float,
    error: Array, wind: Array, motors: bool, level: bool,
    gains: Gains, frame: Airframe, payload: Payload, dt: float, steps: int,
) -> float:  # fmt: skip
    """Steer and move for some steps, in place.

    Parameters
    ----------
    state : ndarray of shape (24,)
        Of the quadrotor: east, north, up.
    reference : ndarray of shape (3, 3)
        Position, velocity, acceleration that a shaped vehicle steers along.
    integral : ndarray of shape (3,)
    hover : ndarray of shape (1,)
        Thrust that hovering takes, over what the quadrotor alone would: learned in flight.
    use, values, yaw, yaw_rate
        A `Target`.
    error : ndarray of shape (2, 3)
        What the estimate of position and velocity is off by.
    wind : ndarray of shape (3,)
        Velocity of the air: east, north, up [m/s].
    motors : bool
        Whether they turn.
    level : bool
        Stay level, without a position to hold: only the vertical target counts.

    Returns
    -------
    float
        Fastest contact with the ground [m/s].
    """
    command, wanted, impact, room = np.zeros(4), np.zeros(3), 0.0, np.empty((STAGES, SIZE))
    for _ in range(steps):
        if motors:
            position = np.array([state[1], state[0], -state[2]]) + error[0]
            velocity = np.array([state[4], state[3], -state[5]]) + error[1]
            for axis in range(3):
                wanted[axis] = follow(
                    axis, use[axis], values, reference, integral, position, velocity, gains, dt
                )  # fmt: skip
            if level:
                wanted[:2] = 0.0
            nose, turn = heading_of(state), -yaw_rate
            if not math.isnan(yaw):
                turn = 2.0 * ((0.5 * math.pi - yaw - nose + math.pi) % (2.0 * math.pi) - math.pi)
            turn = clip(turn, -gains.yaw_rate, gains.yaw_rate)
            tilt = gains.tilt if state[2] > 0.0 else 0.0  # nobody leans while he stands
            thrust, moments = attitude(state, lean(wanted, tilt), nose, turn, INNER, frame)
            mix(min(thrust * hover[0], 2.5 * G * frame.mass), moments, frame, command)
        before = state[5]
        move(state, command, wind, frame, payload, dt, room)
        impact = max(impact, touch(state, payload, dt))
        if motors and state[2] > 0.1:
            upright = 1.0 - 2.0 * (state[7] ** 2 + state[8] ** 2)
            learn_hover(hover, push(state, frame) * upright, (before - state[5]) / dt, dt)
    return impact
