"""How a quadrotor and its load move: rigid body, rotors, air and cable.

World: x east, y north, z up. Body: x ahead, y left, z up. No gyroscopic moments of the rotors,
no ground effect, no blade flapping; the air's drag is linear in the airspeed.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.quadrotor.airframe import Airframe, G, Payload
from sim_nodes.quadrotor.cable import GONE, SLACK, TAUT, distance, tension, tighten

Array = NDArray[np.float64]

POSITION, VELOCITY, ATTITUDE, RATES = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
ROTORS, LOAD, LOAD_VELOCITY, CABLE = slice(13, 17), slice(17, 20), slice(20, 23), 23
SIZE = 24
"""Entries of a state: position and velocity of the vehicle [m, m/s]; attitude as a unit quaternion
(w, x, y, z) from body to world; rates on the body [rad/s]; speeds of the rotors [rad/s]; position
and velocity of the load [m, m/s]; what the cable is, `cable.GONE`, `SLACK` or `TAUT`."""

STAGES = 5
"""Rows of the room that a step works in."""
_CONTACTS = 4  # times that a cable may change within one step


@cached_njit()
def derivative(
    state: Array, command: Array, wind: Array, frame: Airframe, payload: Payload, out: Array
) -> float:
    """Rates of all entries of a state.

    Parameters
    ----------
    state : ndarray of shape (24,)
    command : ndarray of shape (4,)
        Speeds that the rotors are to have [rad/s].
    wind : ndarray of shape (3,)
        Velocity of the air [m/s].
    frame : Airframe
    payload : Payload
    out : ndarray of shape (24,)

    Returns
    -------
    float
        Tension of a taut cable [N], negative where it would have to push; 0 of any other.
    """
    w, x, y, z = state[6], state[7], state[8], state[9]
    up_x, up_y, up_z = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
    s0, s1 = state[13] * state[13], state[14] * state[14]
    s2, s3 = state[15] * state[15], state[16] * state[16]

    # Newton: thrust along the body's z, the air, the cable
    air_x, air_y, air_z = state[3] - wind[0], state[4] - wind[1], state[5] - wind[2]
    along = (frame.drag_along - frame.drag_across) * (air_x * up_x + air_y * up_y + air_z * up_z)
    lift = frame.thrust * (s0 + s1 + s2 + s3) / frame.mass - along
    ax = lift * up_x - frame.drag_across * air_x
    ay = lift * up_y - frame.drag_across * air_y
    az = lift * up_z - frame.drag_across * air_z - G
    lx = -payload.drag * (state[20] - wind[0])
    ly = -payload.drag * (state[21] - wind[1])
    lz = -payload.drag * (state[22] - wind[2]) - G
    pull = 0.0
    if state[CABLE] == TAUT:
        pull, ux, uy, uz = tension(state, (lx - ax, ly - ay, lz - az), frame.mass, payload)
        a, b = pull / frame.mass, pull / payload.mass
        ax, ay, az = ax + a * ux, ay + a * uy, az + a * uz
        lx, ly, lz = lx - b * ux, ly - b * uy, lz - b * uz
    out[0], out[1], out[2], out[3], out[4], out[5] = state[3], state[4], state[5], ax, ay, az
    out[17], out[18], out[19], out[20], out[21], out[22] = (
        state[20],
        state[21],
        state[22],
        lx,
        ly,
        lz,
    )

    # Euler: the rotors' moments
    p, q, r = state[10], state[11], state[12]
    out[6] = 0.5 * (-x * p - y * q - z * r)
    out[7] = 0.5 * (w * p + y * r - z * q)
    out[8] = 0.5 * (w * q + z * p - x * r)
    out[9] = 0.5 * (w * r + x * q - y * p)
    lever = frame.thrust * frame.arm * math.sqrt(0.5)
    jx, jy, jz = frame.inertia_x, frame.inertia_y, frame.inertia_z
    out[10] = (lever * (s0 - s1 - s2 + s3) + (jy - jz) * q * r) / jx
    out[11] = (lever * (-s0 - s1 + s2 + s3) + (jz - jx) * r * p) / jy
    out[12] = (frame.torque * (s0 - s1 + s2 - s3) + (jx - jy) * p * q) / jz
    for i in range(4):
        wanted = min(max(command[i], frame.rotor_low), frame.rotor_high)
        out[13 + i] = (wanted - state[13 + i]) / frame.rotor_time
    out[CABLE] = 0.0
    return pull


@cached_njit()
def _runge_kutta(
    state: Array, command: Array, wind: Array, frame: Airframe, payload: Payload, dt: float,
    room: Array,
) -> None:  # fmt: skip
    """One classical step of fourth order into `room[0]`; `room[1]` has the rates here already."""
    for stage in range(1, 4):
        part = dt if stage == 3 else 0.5 * dt
        for i in range(SIZE):
            room[0, i] = state[i] + part * room[stage, i]
        derivative(room[0], command, wind, frame, payload, room[stage + 1])
    for i in range(SIZE):
        room[0, i] = state[i] + dt / 6.0 * (
            room[1, i] + 2.0 * room[2, i] + 2.0 * room[3, i] + room[4, i]
        )


@cached_njit()
def move(
    state: Array, command: Array, wind: Array, frame: Airframe, payload: Payload, dt: float,
    room: Array,
) -> None:  # fmt: skip
    """Advance a state in place by a step.

    Parameters
    ----------
    state : ndarray of shape (24,)
    command, wind, frame, payload
        As of `derivative`; they stay during the step.
    dt : float
        [s]; 0.005 keeps six digits in a second.
    room : ndarray of shape (STAGES, 24)
        To work in.
    """
    left = dt
    for contact in range(_CONTACTS + 1):
        pull = derivative(state, command, wind, frame, payload, room[1])
        if pull < 0.0 and contact < _CONTACTS:
            state[CABLE] = SLACK
            derivative(state, command, wind, frame, payload, room[1])
        _runge_kutta(state, command, wind, frame, payload, left, room)
        step = left
        caught = state[CABLE] == SLACK and distance(room[0]) > payload.length
        if caught:
            step = _until_taut(state, command, wind, frame, payload, left, room)
        state[:] = room[0]
        if caught:
            state[CABLE] = TAUT
        if state[CABLE] == TAUT:
            tighten(state, frame.mass, payload)
        left -= step
        if left <= 0.0:
            break
    norm = math.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    for i in range(6, 10):
        state[i] /= norm


@cached_njit()
def _until_taut(
    state: Array, command: Array, wind: Array, frame: Airframe, payload: Payload, dt: float,
    room: Array,
) -> float:  # fmt: skip
    """Time within a step after which a slack cable reaches its length; `room[0]` is the state then.

    By bisection, to a billionth of the step.
    """
    low, high = 0.0, dt
    while high - low > 1e-9 * dt:
        middle = 0.5 * (low + high)
        _runge_kutta(state, command, wind, frame, payload, middle, room)
        if distance(room[0]) > payload.length:
            high = middle
        else:
            low = middle
    _runge_kutta(state, command, wind, frame, payload, high, room)
    return high


@cached_njit()
def moves(
    states: Array, commands: Array, wind: Array, frame: Airframe, payload: Payload, dt: float,
    steps: int,
) -> None:  # fmt: skip
    """Advance many vehicles in place, each by itself, for some steps.

    Parameters
    ----------
    states : ndarray of shape (n, 24)
    commands : ndarray of shape (n, 4)
    wind : ndarray of shape (n, 3)
    frame, payload, dt
        As of `move`.
    steps : int
    """
    room = np.empty((STAGES, SIZE))
    for n in range(len(states)):
        for _ in range(steps):
            move(states[n], commands[n], wind[n], frame, payload, dt, room)


def hovering(
    frame: Airframe, payload: Payload, position: tuple[float, float, float],
    swing: tuple[float, float] = (0.0, 0.0),
) -> Array:  # fmt: skip
    """A state at rest with a load on a taut cable, its rotors carrying both.

    Parameters
    ----------
    frame : Airframe
    payload : Payload
    position : tuple of float
        Of the vehicle [m].
    swing : tuple of float
        Angles of the cable in the planes of x and of y, from hanging down [rad].

    Returns
    -------
    ndarray of shape (24,)
    """
    state = np.zeros(SIZE)
    state[POSITION], state[6], state[CABLE] = position, 1.0, TAUT
    state[ROTORS] = frame.hover * math.sqrt(1.0 + payload.mass / frame.mass)
    state[LOAD] = state[POSITION] + payload.length * direction(*swing)
    return state


def direction(angle_x: float, angle_y: float) -> Array:
    """Where a hanging cable points to, shape (3,), from its angles towards x and towards y."""
    x, y = math.sin(angle_x), math.sin(angle_y)
    return np.array([x, y, -math.sqrt(max(1.0 - x * x - y * y, 0.0))])


@cached_njit()
def swing(state: Array, out: Array) -> None:
    """Angles of the cable and their rates, into four places: (θx, θ̇x, θy, θ̇y) [rad, rad/s].

    θx is the angle by which the cable leaves the vertical plane of y towards x, T's θ where the
    load swings in x alone; θy the same towards y. So mirrors and quarter turns of the world only
    change their signs and places.
    """
    away = max(distance(state), 1e-9)
    stretch = 0.0
    for i in range(3):
        stretch += (state[17 + i] - state[i]) * (state[20 + i] - state[3 + i]) / away
    for i in range(2):
        sine = (state[17 + i] - state[i]) / away
        turning = (state[20 + i] - state[3 + i] - sine * stretch) / away
        out[2 * i] = math.asin(min(max(sine, -1.0), 1.0))
        out[2 * i + 1] = turning / max(math.sqrt(max(1.0 - sine * sine, 0.0)), 0.05)


def release(state: Array) -> None:
    """Let the load go, in place."""
    state[CABLE] = GONE
