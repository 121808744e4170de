"""From sticks to rotors: the low-level controller, as pure functions.

A cascade. Velocities, or accelerations, or leaning angles give the direction of the thrust; the
attitude follows on the quaternion's error, the rates under it, and a mixer shares the moments
among the rotors. The altitude is held, and so is the heading, while their sticks are at rest.
It knows the vehicle's mass and inertia; the load is for its integrals to find.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.quadrotor.airframe import Airframe, G

Array = NDArray[np.float64]

ATTITUDE, VELOCITY, ACCELERATION = 0, 1, 2
"""What the first two sticks ask for: leaning ahead and to the left [rad]; velocity [m/s] or
acceleration [m/s²] ahead and to the left, as the nose points."""

MODES = {"attitude": ATTITUDE, "velocity": VELOCITY, "acceleration": ACCELERATION}

MEMORY = 6
"""Entries of the controller's memory: altitude held [m]; heading held [rad]; integrals, ahead,
left and up [m/s²]; 1 once it has begun."""


class Gains(NamedTuple):
    """How it steers."""

    attitude: float = 110.0  # of an angle's error [1/s²]
    rate: float = 16.0  # of a rate's error [1/s]
    heading: float = 9.0  # the same about the vertical: rotors have little moment there
    heading_rate: float = 6.0
    velocity: float = 2.0  # [1/s]
    velocity_integral: float = 0.4  # [1/s²]
    altitude: float = 1.6  # speed for a metre [1/s]
    climb: float = 4.0  # [1/s]
    climb_integral: float = 2.5  # [1/s²]
    tilt: float = 0.6  # farthest that it leans [rad]
    climb_limit: float = 1.5  # [m/s]


@cached_njit(inline="always")
def clip(value: float, low: float, high: float) -> float:
    """Keep a value between two limits."""
    return min(max(value, low), high)


@cached_njit()
def heading_of(state: Array) -> float:
    """Where the nose points, counter-clockwise from east [rad]."""
    w, x, y, z = state[6], state[7], state[8], state[9]
    return math.atan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))


@cached_njit()
def begin(state: Array, load_share: float, memory: Array) -> None:
    """Hold where it is now, in place; `load_share` of its own mass hangs below it."""
    memory[:] = state[2], heading_of(state), 0.0, 0.0, G * load_share, 1.0


@cached_njit()
def steer(
    state: Array, memory: Array, mode: int, sticks: Array, gains: Gains, frame: Airframe,
    dt: float, command: Array,
) -> None:  # fmt: skip
    """Speeds for the rotors, once every dt.

    Parameters
    ----------
    state : ndarray of shape (24,)
    memory : ndarray of shape (6,)
        Changed in place.
    mode : int
        ATTITUDE, VELOCITY or ACCELERATION.
    sticks : ndarray of shape (4,)
        Ahead and left, as the mode has it; climb [m/s]; turn counter-clockwise [rad/s].
    gains, frame
        Of the vehicle.
    dt : float
        [s]
    command : ndarray of shape (4,)
        [rad/s], written.
    """
    nose = heading_of(state)
    cosine, sine = math.cos(nose), math.sin(nose)
    ahead, left = sticks[0], sticks[1]
    if mode == VELOCITY:
        ahead -= cosine * state[3] + sine * state[4]
        left -= -sine * state[3] + cosine * state[4]
        for i, error in ((2, ahead), (3, left)):
            memory[i] = clip(memory[i] + gains.velocity_integral * error * dt, -2.0, 2.0)
        ahead = gains.velocity * ahead + memory[2]
        left = gains.velocity * left + memory[3]
    elif mode == ATTITUDE:
        ahead, left = G * math.tan(clip(ahead, -1.2, 1.2)), G * math.tan(clip(left, -1.2, 1.2))
    lift = G + _climb(state, memory, sticks[2], gains, dt)
    # What the load weighs is lifted, but leans the vehicle no less.
    most = G * math.tan(gains.tilt)
    level = math.hypot(ahead, left)
    if level > most:
        ahead, left = ahead * most / level, left * most / level
    ahead, left = ahead * lift / G, left * lift / G
    if sticks[3] != 0.0:
        memory[1] = nose
    thrust, moments = attitude(
        state, (cosine * ahead - sine * left, sine * ahead + cosine * left, lift), memory[1],
        sticks[3], gains, frame,
    )  # fmt: skip
    mix(thrust, moments, frame, command)


@cached_njit()
def _climb(state: Array, memory: Array, stick: float, gains: Gains, dt: float) -> float:
    """Acceleration upwards [m/s²] that holds the altitude, or climbs as the stick says."""
    wanted = clip(stick, -gains.climb_limit, gains.climb_limit)
    if stick != 0.0:
        # Where it will come to rest is what is held when the stick is.
        memory[0] = state[2] + state[5] / gains.climb
    else:
        wanted = gains.altitude * (memory[0] - state[2])
        wanted = clip(wanted, -gains.climb_limit, gains.climb_limit)
    error = wanted - state[5]
    memory[4] = clip(memory[4] + gains.climb_integral * error * dt, -0.6 * G, 0.6 * G)
    return clip(gains.climb * error + memory[4], -0.7 * G, 1.5 * G)


@cached_njit()
def attitude(
    state: Array, push: tuple[float, float, float], heading: float, turn: float, gains: Gains,
    frame: Airframe,
) -> tuple[float, tuple[float, float, float]]:  # fmt: skip
    """Thrust [N] and moments [N m] that turn the body's z to `push`, and the nose to a heading."""
    size = math.sqrt(push[0] ** 2 + push[1] ** 2 + push[2] ** 2)
    ux, uy, uz = push[0] / size, push[1] / size, push[2] / size
    # The shortest turn that leans upright z to u, after one about the vertical to the heading.
    lean_w = math.sqrt(0.5 * (1.0 + uz))
    lean_x, lean_y = -uy / (2.0 * lean_w), ux / (2.0 * lean_w)
    half = 0.5 * heading
    cosine, sine = math.cos(half), math.sin(half)
    dw, dx = lean_w * cosine, lean_x * cosine + lean_y * sine
    dy, dz = lean_y * cosine - lean_x * sine, lean_w * sine
    w, x, y, z = state[6], state[7], state[8], state[9]
    # error = wanted⁻¹ × attitude, on the body
    ew = dw * w + dx * x + dy * y + dz * z
    ex = dw * x - dx * w - dy * z + dz * y
    ey = dw * y + dx * z - dy * w - dz * x
    ez = dw * z - dx * y + dy * x - dz * w
    turned = 2.0 if ew >= 0.0 else -2.0
    p, q, r = state[10], state[11], state[12]
    jx, jy, jz = frame.inertia_x, frame.inertia_y, frame.inertia_z
    roll = jx * (-gains.attitude * turned * ex - gains.rate * p) - (jy - jz) * q * r
    pitch = jy * (-gains.attitude * turned * ey - gains.rate * q) - (jz - jx) * r * p
    yaw = -gains.heading * turned * ez - gains.heading_rate * (r - turn)
    up = (
        2.0 * (x * z + w * y) * push[0]
        + 2.0 * (y * z - w * x) * push[1]
        + (1.0 - 2.0 * (x * x + y * y)) * push[2]
    )
    return max(up, 0.0) * frame.mass, (roll, pitch, jz * yaw)


@cached_njit()
def mix(
    thrust: float, moments: tuple[float, float, float], frame: Airframe, command: Array
) -> None:
    """Share thrust and moments among the rotors; where they cannot all be had, the turn goes."""
    low = frame.thrust * frame.rotor_low**2
    high = frame.thrust * frame.rotor_high**2
    lever = 2.0 * math.sqrt(2.0) * frame.arm
    roll, pitch = moments[0] / lever, moments[1] / lever
    base = clip(0.25 * thrust, low + abs(roll) + abs(pitch), high - abs(roll) - abs(pitch))
    spare = max(min(base - low, high - base) - abs(roll) - abs(pitch), 0.0)
    yaw = clip(0.25 * moments[2] * frame.thrust / frame.torque, -spare, spare)
    for i in range(4):
        side = roll if i in (0, 3) else -roll
        nose = pitch if i > 1 else -pitch
        turn = yaw if i % 2 == 0 else -yaw
        command[i] = math.sqrt(clip(base + side + nose + turn, low, high) / frame.thrust)
