"""A demonstration in flight: stick or script answers the vehicle, and samples come of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from sensor_msgs.msg import Joy

from iolspi_ros import qos, wire
from iolspi_ros.core.online import Source
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.nodes.seat import Seat
from iolspi_ros.nodes.stick import Stick, StickSettings
from iolspi_ros.settings import Settings, setting
from sim_nodes.pilots import PilotSettings, ScriptedPilot

if TYPE_CHECKING:
    from iolspi_ros.nodes.demonstrator import Demonstrator


@dataclass(frozen=True)
class FlightSettings(Settings):
    """How long a demonstration is, and how much of it is left to chance."""

    seed: int = setting(0, "of the scripted pilot and of the corruption", low=0)
    corruption: float = setting(
        0.0, "probability that an action is replaced by a random one (T Table 1)",
        low=0.0, high=1.0,
    )  # fmt: skip
    episodes: int = setting(21, "episodes to fly; T flies one from each of 21 starts", low=1)
    simulator_timeout: float = setting(
        10.0, "give up when no state came for this long at the start [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


class Flight:
    """Sits in the seat for a number of episodes.

    Parameters
    ----------
    node : Demonstrator
    settings : FlightSettings
    pilot : PilotSettings
        Of the scripted pilot, when the node's source is "scripted".
    stick : StickSettings
        Of the joystick, when it is "joy".
    """

    def __init__(
        self,
        node: Demonstrator,
        settings: FlightSettings,
        pilot: PilotSettings,
        stick: StickSettings,
    ) -> None:
        self._node, self._settings = node, settings
        self._rng = np.random.default_rng([settings.seed, 2])
        self._rewards = wire.RewardRows()
        self._given: dict[tuple[int, int], tuple[int, Source]] = {}
        self._ended = 0
        self._begun = False
        self._pilot: ScriptedPilot | None = None
        if node.settings.source == "scripted":
            self._pilot = ScriptedPilot(node.task, pilot, self._rng)
        self._stick = Stick(stick, len(node.task.actions), node.task.neutral)
        node.create_subscription(Joy, "joy", self._on_joy, qos.CONTROL)
        self._seat = Seat(
            node, node.task.joints, node.task.neutral, self, settings.simulator_timeout
        )
        if self._pilot is not None:
            self._begin()
        else:
            topic = node.resolve_topic_name("joy")
            node.get_logger().info(f"waiting for a joystick on {topic}")

    def _begin(self) -> None:
        self._node.begin()
        self._seat.take()

    def _on_joy(self, message: Joy) -> None:
        self._stick.take(message)
        if self._pilot is None and not self._begun:
            self._begun = True
            self._node.get_logger().info("the joystick is there; flying")
            self._begin()

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Record what the vehicle showed and what it was told; end after the last episode."""
        stamp = observation.stamp
        state = wire.state_message(self._node.task.joints, observation.state, stamp)
        self._node.record("state", stamp, state)
        self._node.record("reward", stamp, self._rewards.of(observation))
        self._node.record("action", stamp, answer)
        if self._ended >= self._settings.episodes:
            self._seat.leave()
            self._node.end()

    def transition(self, before: Observation, transition: Transition) -> None:
        """Send a step as a sample."""
        action, source = self._given.pop((before.episode, before.step), (-1, Source.HOLD))
        if action != transition.action:
            source = Source.HOLD  # the vehicle did something else than it was told
        if np.isfinite((*transition.state, transition.reward, *transition.next_state)).all():
            self._node.send(Sample(before.episode, before.step, before.stamp, transition, source))
        if transition.terminated or transition.truncated:
            self._given.clear()
            self._ended += 1
            total = self._settings.episodes
            self._node.get_logger().info(f"episode {self._ended} of {total} flown")

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """What the pilot does, or now and then a random action instead."""
        if self._pilot is not None:
            if observation.step == 0:
                self._pilot.begin()
            action, source = self._pilot.act(observation.state), Source.SCRIPTED
        else:
            action, source = self._stick.action(), Source.HUMAN
        if self._rng.random() < self._node.get_parameter("corruption").value:
            action = int(self._rng.integers(len(self._node.task.actions)))
            source = Source.CORRUPTED
        self._given[observation.episode, observation.step] = (action, source)
        return action, source
