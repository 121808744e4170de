"""What plans would earn, flown ahead on the true model: for a planner, not for a learner."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from sim_nodes.quadrotor import control
from sim_nodes.quadrotor.airframe import Airframe, Payload
from sim_nodes.quadrotor.body import LOAD, LOAD_VELOCITY, SIZE, STAGES, move
from sim_nodes.quadrotor.control import Gains, steer
from sim_nodes.quadrotor.flight import STEP
from sim_nodes.tasks.slung_load_3d.scene import DUNK, MISS, Basket, crash, landing

Array = NDArray[np.float64]


@cached_njit()
def foresee(
    state: Array, memory: Array, wind: Array, sticks: Array, plans: NDArray[np.int64],
    basket: Basket, gains: Gains, frame: Airframe, payload: Payload, steps: int, gamma: float,
    returns: Array,
) -> None:  # fmt: skip
    """Discounted returns of plans, by when the load is released.

    Parameters
    ----------
    state, memory, wind : ndarray
        As of `Vehicle`; the wind stays as it is. Unchanged.
    sticks : ndarray of shape (n_actions, 4)
        What each action asks of the controller.
    plans : ndarray of int, shape (n, length)
        Actions, none of them the release.
    basket, gains, frame, payload
        Of the task.
    steps : int
        Of `STEP` in each action.
    gamma : float
    returns : ndarray of shape (n, length + 1)
        Written: when the load is released in place of the k-th action; at the end, when all are
        flown and the load then released. After a crash all are as bad as it.
    """
    room, command = np.empty((STAGES, SIZE)), np.empty(4)
    for n in range(len(plans)):
        flying, held = state.copy(), memory.copy()
        earned, share = 0.0, 1.0
        for k in range(plans.shape[1] + 1):
            place = landing(
                flying[LOAD], flying[LOAD_VELOCITY], wind, payload.drag, basket.rim
            )  # NaN, where it hangs below the rim, is no dunk
            hit = math.hypot(place[0] - basket.x, place[1] - basket.y) <= basket.radius
            returns[n, k] = earned + share * (DUNK if hit else MISS)
            if k == plans.shape[1]:
                break
            cost = -0.5 * math.hypot(flying[0] - basket.x, flying[1] - basket.y)
            for _ in range(steps):
                steer(
                    flying, held, control.ACCELERATION, sticks[plans[n, k]], gains, frame, STEP,
                    command,
                )  # fmt: skip
                move(flying, command, wind, frame, payload, STEP, room)
            crashed = crash(flying)
            earned += share * (crashed if crashed != 0.0 else cost)
            share *= gamma
            if crashed != 0.0:
                returns[n, k + 1 :] = earned
                break
