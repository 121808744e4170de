#!/usr/bin/env python3
"""Say how a vehicle answered accelerations in flights of the slung load, from their bags.

    python scripts/measure_answer.py out/fly/*/bag

It fits delay, lag, drag, gain and push (`Answer` in msg_bridge/mavlink/profiles.py) to the changes
of speed from step to step, by least squares over all episodes; then drag and push of each episode.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from iolspi_ros.bags import read_demonstration
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load.as_flown import Response, move
from sim_nodes.tasks.slung_load.dynamics import ACCELERATIONS

Array = NDArray[np.float64]
Episode = tuple[Array, NDArray[np.int64], Array]

_SHORTEST = 10  # steps of an episode that tells something
_DELAYS = np.arange(0.0, 0.21, 0.02)  # tried; the rest is fitted [s]


def episodes(bag: Path) -> list[Episode]:
    """Speeds left, actions and speeds reached, of each unbroken episode; not of the release."""
    batch = read_demonstration(bag, SlungLoad.description).transitions()
    follows = (batch.next_state[:-1] == batch.state[1:]).all(axis=1)
    parts = np.split(np.arange(len(batch)), np.flatnonzero(~follows) + 1)
    return [
        (batch.state[part[:-1]], batch.action[part[:-1]], batch.next_state[part[:-1]])
        for part in parts
        if len(part) > _SHORTEST
    ]


def errors(response: Response, flown: Episode) -> Array:
    """Of the speed reached in each step, from the state that was left [m/s]."""
    states, actions, next_states = flown
    memory, found = np.zeros(6), np.empty(len(states))
    parameters = SlungLoad().parameters(0.0)
    for n, (state, action) in enumerate(zip(states, actions.tolist(), strict=True)):
        reached = state.copy()
        move(reached, memory, ACCELERATIONS[action], response, parameters)
        found[n] = reached[1] - next_states[n, 1]
    return found


def fit(flights: list[Episode], delay: float) -> tuple[float, Response]:
    """Standard deviation that is left [m/s], and the response that leaves least."""

    def left(p: Array) -> Array:
        lag, drag, gain, push = p.tolist()
        response = Response(delay, lag, drag, push, gain)
        return np.concatenate([errors(response, flown) for flown in flights])

    found = least_squares(left, (0.1, 0.5, 1.0, 0.0), bounds=((0.0, -1, 0.3, -2), (1, 4, 2, 2)))
    lag, drag, gain, push = found.x.tolist()
    return float(found.fun.std()), Response(delay, lag, drag, push, gain)


def single(flown: Episode, shared: Response) -> Array:
    """Drag and push of an episode by itself."""

    def left(p: Array) -> Array:
        return errors(shared._replace(drag=p[0], push=p[1]), flown)

    return least_squares(left, (shared.drag, 0.0)).x


def main() -> int:
    """Fit, and print."""
    bags = [Path(text) for text in sys.argv[1:]]
    if not bags:
        print(__doc__)
        return 2
    flights = [flown for bag in bags for flown in episodes(bag)]
    std, response = min(fit(flights, delay) for delay in _DELAYS.tolist())
    alone = np.array([single(flown, response) for flown in flights])
    print(f"{len(flights)} episodes: {std:.3f} m/s a step are left unexplained")
    for name, value in response._asdict().items():
        print(f"  {name:6} {value:6.2f}")
    for name, column in zip(("drag", "push"), alone.T, strict=True):
        low, middle, high = np.percentile(column, (5, 50, 95))
        print(
            f"  {name} of single episodes: {low:.2f} to {high:.2f} (5 to 95 %), median {middle:.2f}"
        )
    gust = std / math.sqrt(SlungLoad.description.sampling_time)
    print(f"  as if gusts of {gust:.2f} m/s² per sqrt(Hz) pushed it besides")
    return 0


if __name__ == "__main__":
    sys.exit(main())
