"""A quadrotor with a load on a cable, in three dimensions: pure functions, compiled.

Everything here is in the autopilot's own frame: north, east, down, from where it was switched
on; the ground is at zero. The cable holds no push: a load may lie on the ground, hang, swing and
fly away when it is let go.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

POSITION, VELOCITY = slice(0, 3), slice(3, 6)
ROLL, PITCH, YAW, ROLL_RATE, PITCH_RATE, YAW_RATE, THRUST = range(6, 13)
LOAD, LOAD_VELOCITY = slice(13, 16), slice(16, 19)
SIZE = 19
"""Entries of a state: position and velocity of the quadrotor [m, m/s]; attitude [rad] and its
rates [rad/s]; thrust over mass [m/s^2]; position and velocity of the load [m, m/s]."""


class Airframe(NamedTuple):
    """What the vehicle is made of."""

    g: float = 9.81  # [m/s^2]
    mass: float = 1.5  # of the quadrotor [kg]
    load: float = 0.1  # mass of the load [kg]
    length: float = 1.0  # of the cable [m]
    drag: float = 0.1  # of the quadrotor, over its mass [1/s]
    load_drag: float = 0.02  # of the load, over its mass [1/s]
    bandwidth: float = 12.0  # of the attitude [rad/s]
    damping: float = 0.9  # of the attitude
    yaw_time: float = 0.1  # of the yaw's rate [s]
    thrust_time: float = 0.04  # of the motors [s]
    stiffness: float = 20.0  # with which the cable returns to its length [rad/s]
    friction: float = 0.05  # time in which a load on the ground stops [s]


@njit(cache=True)
def thrust_direction(roll: float, pitch: float, yaw: float) -> tuple[float, float, float]:
    """Where the rotors push the air: the body's down axis, in the world."""
    sr, cr = math.sin(roll), math.cos(roll)
    sp, cp = math.sin(pitch), math.cos(pitch)
    sy, cy = math.sin(yaw), math.cos(yaw)
    return cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr


@njit(cache=True)
def _cable(state: Array, free: Array, load_free: Array, frame: Airframe) -> float:
    """Pull of the cable [N] that keeps its length, zero where it hangs loose.

    Along the cable the load must not accelerate away from the quadrotor, but for what turns it
    round; an error of its length dies out with `stiffness`, damped critically.
    """
    distance, along, speed2 = 0.0, 0.0, 0.0
    for i in range(3):
        distance += (state[13 + i] - state[i]) ** 2
    distance = math.sqrt(distance)
    if distance < 0.999 * frame.length:
        return 0.0
    pulling = 0.0
    for i in range(3):
        unit = (state[13 + i] - state[i]) / distance
        relative = state[16 + i] - state[3 + i]
        along += unit * relative
        speed2 += relative * relative
        pulling += unit * (load_free[i] - free[i])
    turning = (speed2 - along * along) / distance
    w = frame.stiffness
    wanted = pulling + turning + 2.0 * w * along + w * w * (distance - frame.length)
    return max(0.0, wanted / (1.0 / frame.load + 1.0 / frame.mass))


@njit(cache=True)
def derivative(
    state: Array, command: Array, wind: Array, attached: bool, frame: Airframe, out: Array
) -> None:
    """Rates of all entries of a state.

    Parameters
    ----------
    state : ndarray of shape (19,)
    command : ndarray of shape (4,)
        Roll and pitch [rad], rate of yaw [rad/s], thrust over mass [m/s^2].
    wind : ndarray of shape (3,)
        Velocity of the air [m/s].
    attached : bool
        Whether the load hangs on the cable.
    frame : Airframe
    out : ndarray of shape (19,)
    """
    push = thrust_direction(state[ROLL], state[PITCH], state[YAW])
    free, load_free = np.empty(3), np.empty(3)
    for i in range(3):
        gravity = frame.g if i == 2 else 0.0
        free[i] = gravity - push[i] * state[THRUST] - frame.drag * (state[3 + i] - wind[i])
        load_free[i] = gravity - frame.load_drag * (state[16 + i] - wind[i])
    pull = _cable(state, free, load_free, frame) if attached else 0.0
    distance = 0.0
    for i in range(3):
        distance += (state[13 + i] - state[i]) ** 2
    distance = max(math.sqrt(distance), 1e-9)
    for i in range(3):
        unit = (state[13 + i] - state[i]) / distance
        out[i], out[13 + i] = state[3 + i], state[16 + i]
        out[3 + i] = free[i] + pull * unit / frame.mass
        out[16 + i] = load_free[i] - pull * unit / frame.load
    w, z = frame.bandwidth, frame.damping
    out[ROLL], out[PITCH], out[YAW] = state[ROLL_RATE], state[PITCH_RATE], state[YAW_RATE]
    out[ROLL_RATE] = w * w * (command[0] - state[ROLL]) - 2.0 * z * w * state[ROLL_RATE]
    out[PITCH_RATE] = w * w * (command[1] - state[PITCH]) - 2.0 * z * w * state[PITCH_RATE]
    out[YAW_RATE] = (command[2] - state[YAW_RATE]) / frame.yaw_time
    out[THRUST] = (command[3] - state[THRUST]) / frame.thrust_time


@njit(cache=True)
def move(
    state: Array, command: Array, wind: Array, attached: bool, frame: Airframe, dt: float
) -> float:
    """Advance a state in place by one Runge-Kutta step, and stop it at the ground.

    Returns
    -------
    float
        Speed with which the quadrotor came to the ground in this step [m/s].
    """
    k1, k2, k3, k4 = np.empty(SIZE), np.empty(SIZE), np.empty(SIZE), np.empty(SIZE)
    derivative(state, command, wind, attached, frame, k1)
    derivative(state + 0.5 * dt * k1, command, wind, attached, frame, k2)
    derivative(state + 0.5 * dt * k2, command, wind, attached, frame, k3)
    derivative(state + dt * k3, command, wind, attached, frame, k4)
    state += dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    state[YAW] = (state[YAW] + math.pi) % (2.0 * math.pi) - math.pi
    if state[15] > 0.0:
        slip = math.exp(-dt / frame.friction)
        state[15] = 0.0
        state[16], state[17], state[18] = state[16] * slip, state[17] * slip, min(state[18], 0.0)
    impact = 0.0
    if state[2] > 0.0:
        impact = max(state[5], 0.0)
        state[2] = 0.0
        state[3], state[4], state[5] = 0.0, 0.0, min(state[5], 0.0)
        state[ROLL:THRUST] = np.array([0.0, 0.0, state[YAW], 0.0, 0.0, 0.0])
    return impact


def at_rest(load: tuple[float, float, float]) -> Array:
    """State on the ground with the load lying beside it."""
    state = np.zeros(SIZE)
    state[LOAD] = load
    return state
