"""A vehicle of one's own in a page: a boat that must keep to the middle of a channel.

    iolspi learn --task boat:Boat                     # with this folder on the PYTHONPATH
    iolspi run simulator --task boat:Boat
    pip install ./examples/vehicle && iolspi learn --task boat      # installed, by its name

Three variables and five actions; the dynamics are plain numpy, for one state or many at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import Action, Ending, TaskDescription, Variable

SPEED, TURNING, DAMPING = 2.0, 2.0, 2.0  # [m/s]; [rad/s^2] per unit of rudder; [1/s]
BANK = 4.0  # [m] from the middle
DT = 0.2  # [s]
RUDDER = (-1.0, -0.3, 0.0, 0.3, 1.0)


@dataclass(frozen=True)
class Boat(Settings):
    """It runs at a constant speed; a rudder turns it, a current pushes it sideways.

    State: offset from the middle of the channel [m], positive to port; heading [rad], zero along
    the channel and counter-clockwise; yaw rate [rad/s].
    """

    current: float = setting(0.2, "sideways [m/s], to port", low=-1.0, high=1.0)

    description = TaskDescription(
        name="boat",
        variables=(
            Variable("offset", "m", -BANK, BANK),
            Variable("heading", "rad", -np.pi, np.pi, periodic=True),
            Variable("yaw_rate", "rad/s", -1.0, 1.0, label="yaw rate"),
        ),
        actions=tuple(Action(f"rudder {value:+.1f}", (value,)) for value in RUDDER),
        neutral=2,
        sampling_time=DT,
        episode_steps=100,
        gamma=0.97,
        endings=(Ending("time-out", success=True), Ending("aground")),
        success="stay afloat",
        map_variables=("offset", "heading"),
    )
    usual_episodes = 150

    def step(self, state: Any, action: Any, time: float = 0.0, noise: Any = 0.0) -> Any:
        """One sampling time; the reward is a cost of the distance from the middle."""
        offset, heading, rate = np.moveaxis(np.asarray(state, float), -1, 0)
        rudder = np.take(RUDDER, action) + noise
        rate = np.clip(rate + DT * (TURNING * rudder - DAMPING * rate), -1.0, 1.0)
        heading = (heading + DT * rate + np.pi) % (2 * np.pi) - np.pi
        offset = offset + DT * (SPEED * np.sin(heading) + self.current)
        aground = np.abs(offset) > BANK
        reward = -(offset**2) - 0.1 * rudder**2 - 50.0 * aground
        return np.stack([offset, heading, rate], axis=-1), reward, aground

    def initial_states(self) -> Any:
        """From 2 m to either side, pointing up to 0.6 rad away."""
        places = [(x, h, 0.0) for x in (-2.0, -1.0, 0.0, 1.0, 2.0) for h in (-0.6, 0.0, 0.6)]
        return np.array(places)

    def draw_initial(self, rng: np.random.Generator) -> Any:
        """Anywhere among them."""
        return np.array([rng.uniform(-2.0, 2.0), rng.uniform(-0.6, 0.6), 0.0])
