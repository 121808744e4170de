"""Driving the vehicle: joystick or script answers it, and samples come of that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import Joy

from iolspi_ros import qos, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.nodes.control_loop import ControlLoop
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings
from iolspi_ros.nodes.samples_out import SamplesOut
from iolspi_ros.settings import Settings, setting
from sim_nodes.pilots import ScriptedPilot


@dataclass(frozen=True)
class TeleopSettings(Settings):
    """How long a demonstration is, and how much of it is left to chance."""

    seed: int = setting(0, "of the scripted pilot and of the corruption", low=0)
    corruption: float = setting(
        0.0, "probability that an action is replaced by a random one (T Table 1)",
        low=0.0, high=1.0,
    )  # fmt: skip
    episodes: int = setting(21, "episodes to fly; T flies one from each of 21 starts", low=1)
    vehicle_timeout: float = setting(
        10.0, "give up when no vehicle was heard for this long at the start [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


class Teleop:
    """Controls the vehicle for a number of episodes.

    Parameters
    ----------
    node : SamplesOut
    settings : TeleopSettings
    pilot : ScriptedPilot, optional
        Who flies; a person with the joystick when there is none.
    joystick : JoystickSettings
    """

    busy = False
    """A pilot always has an answer."""

    def __init__(
        self,
        node: SamplesOut,
        settings: TeleopSettings,
        pilot: ScriptedPilot | None,
        joystick: JoystickSettings,
    ) -> None:
        self._node, self._settings, self._pilot = node, settings, pilot
        self._rng = np.random.default_rng([settings.seed, 2]) if pilot is None else pilot.rng
        self._rewards, self._states = wire.RewardRows(), wire.states(node.task)
        self._given: dict[tuple[int, int], tuple[int, Source]] = {}
        self._ended = 0
        self._begun = self._over = False
        self._joystick = Joystick(joystick, node.task.n_actions, node.task.neutral)
        self._joy = node.create_subscription(Joy, "joy", self._on_joy, qos.CONTROL)
        self._loop = ControlLoop(node, node.task, self, settings.vehicle_timeout)
        if pilot is None:
            topic = node.resolve_topic_name("joy")
            node.get_logger().info(f"waiting for a joystick on {topic}")

    def resume(self) -> None:
        """Fly, or go on flying."""
        if self._begun or self._pilot is not None:
            self._begin()

    def pause(self) -> None:
        """Leave the vehicle alone."""
        self._loop.stop()

    def close(self) -> None:
        """Stop for good."""
        self._loop.close()
        self._node.destroy_subscription(self._joy)

    def _begin(self) -> None:
        if self._over:
            return
        if not self._begun:
            self._begun = True
            self._node.begin()
        self._loop.start()

    def _on_joy(self, message: Joy) -> None:
        self._joystick.take(message)
        if self._pilot is None and not self._begun and self._node.active:
            self._node.get_logger().info("the joystick is there; flying")
            self._begin()

    def answered(self, observation: Observation, source: Source, answer: bytes) -> None:
        """Record what the vehicle showed and what it was told; end after the last episode."""
        stamp = observation.stamp
        self._node.record("state", self._states.kind, stamp, self._states.of(observation))
        self._node.record("reward", wire.ROW, stamp, self._rewards.of(observation))
        self._node.record("action", wire.ROW, stamp, answer)
        if self._ended >= self._settings.episodes:
            self._over = True
            self._loop.stop()
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
            action, source = self._joystick.action(), Source.HUMAN
        if self._rng.random() < self._node.corruption:
            action = int(self._rng.integers(self._node.task.n_actions))
            source = Source.CORRUPTED
        self._given[observation.episode, observation.step] = (action, source)
        return action, source
