"""Driving the vehicle: a pilot answers it, and samples come of that."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iolspi_ros import wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.nodes.control_loop import ControlLoop
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
        0.0, "give up when no vehicle was heard for this long at the start [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


class Teleop:
    """Controls the vehicle for a number of episodes; who flies is a subclass.

    Parameters
    ----------
    node : SamplesOut
    settings : TeleopSettings
    rng : numpy.random.Generator
        Of the corruption.
    timeout : float
        As of `ControlLoop`.
    """

    def __init__(
        self, node: SamplesOut, settings: TeleopSettings, rng: np.random.Generator, timeout: float
    ) -> None:
        self._node, self._settings, self._rng = node, settings, rng
        self._rewards, self._states = wire.RewardRows(), wire.states(node.task)
        self._given: dict[tuple[int, int], tuple[int, Source]] = {}
        self._begun = self._over = False
        self._loop = ControlLoop(node, node.task, self, timeout)

    # ------------------------------------------------------------ for subclasses

    @property
    def busy(self) -> bool:
        """Whether nothing is to be answered now."""
        return False

    def resume(self) -> None:
        """Fly, or go on flying."""
        raise NotImplementedError

    def pilot(self, observation: Observation) -> tuple[int, Source]:
        """What the pilot does."""
        raise NotImplementedError

    def write(self, episode: int, topic: str, kind: str, stamp: int, data: bytes) -> None:
        """Record a message of an episode."""
        raise NotImplementedError

    def take(self, sample: Sample) -> None:
        """Take a step that was flown."""
        raise NotImplementedError

    def landed(self, episode: int) -> None:
        """An episode has come to its end; sets `_over` after the last."""
        raise NotImplementedError

    # ------------------------------------------------------------ life

    def pause(self) -> None:
        """Leave the vehicle alone."""
        self._loop.stop()

    def put_away(self) -> None:
        """Record what was flown and is not recorded yet."""

    def close(self) -> None:
        """Stop for good."""
        self._loop.close()

    def begin(self) -> None:
        """Say that the demonstration begins, once."""
        if not self._begun:
            self._begun = True
            self._node.begin()

    # ------------------------------------------------------------ in the control loop

    def answered(self, observation: Observation, source: Source, answer: bytes) -> None:
        """Record what the vehicle showed and what it was told; end after the last episode."""
        if not observation.last:
            self._record(observation)
            self.write(observation.episode, "action", wire.ROW, observation.stamp, answer)
        if self._over:
            self._loop.stop()
            self._node.end()

    def _record(self, observation: Observation) -> None:
        episode, stamp = observation.episode, observation.stamp
        self.write(episode, "state", self._states.kind, stamp, self._states.of(observation))
        self.write(episode, "reward", wire.ROW, stamp, self._rewards.of(observation))

    def transition(self, before: Observation, transition: Transition) -> None:
        """Make a sample of a step."""
        action, source = self._given.pop((before.episode, before.step), (-1, Source.HOLD))
        who = transition.source  # what the vehicle says of it
        if who < 0:
            who = source if action == transition.action else Source.HOLD
        if np.isfinite((*transition.state, transition.reward, *transition.next_state)).all():
            self.take(Sample(before.episode, before.step, before.stamp, transition, who))
        if transition.terminated or transition.truncated:
            self._given.clear()
            if self._loop.seen is not None and self._loop.seen.last:
                self._record(self._loop.seen)
            self.landed(before.episode)

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """What the pilot does, or now and then a random action instead."""
        action, source = self.pilot(observation)
        if source is not Source.HOLD and self._rng.random() < self._node.corruption:
            action = int(self._rng.integers(self._node.task.n_actions))
            source = Source.CORRUPTED
        self._given[observation.episode, observation.step] = (action, source)
        return action, source


class ScriptedFlight(Teleop):
    """The scripted pilot flies; what it does is recorded and sent at once.

    Parameters
    ----------
    node : SamplesOut
    settings : TeleopSettings
    pilot : ScriptedPilot
    """

    def __init__(self, node: SamplesOut, settings: TeleopSettings, pilot: ScriptedPilot) -> None:
        super().__init__(node, settings, pilot.rng, settings.vehicle_timeout)
        self._pilot, self._ended = pilot, 0

    def resume(self) -> None:
        """Fly, or go on flying."""
        if not self._over:
            self.begin()
            self._loop.start()

    def pilot(self, observation: Observation) -> tuple[int, Source]:
        """What the script says."""
        if observation.step == 0:
            self._pilot.begin()
        return self._pilot.act(observation.state), Source.SCRIPTED

    def write(self, episode: int, topic: str, kind: str, stamp: int, data: bytes) -> None:
        """Record a message."""
        self._node.record(topic, kind, stamp, data)

    def take(self, sample: Sample) -> None:
        """Record and send a step."""
        self._node.send(sample)

    def landed(self, episode: int) -> None:
        """Count episodes."""
        self._ended += 1
        total = self._settings.episodes
        self._node.get_logger().info(f"episode {self._ended} of {total} flown")
        self._over = self._ended >= total
