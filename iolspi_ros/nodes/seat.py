"""The pilot's seat: whoever sits in it answers each observation of the vehicle once."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.online import Source
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.pairing import Pairer

RESTARTED = 20
"""Observations in a row, all older than the newest, after which they are another run's."""


class Occupant(Protocol):
    """Who sits in the seat."""

    def transition(self, before: Observation, transition: Transition) -> None:
        """Take a transition that left `before`; each comes once."""
        ...

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Action for an observation whose state is finite and not the last of its episode."""
        ...

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Take an observation and the message that answered it; the vehicle moves already."""
        ...


class Seat:
    """Pairs `state` with `reward`, and answers with `action`.

    A repeated observation gets the same answer again; one older than the newest gets none; the
    last of an episode, and one that is not finite, gets a `hold`.

    Parameters
    ----------
    node : rclpy.node.Node
    joints : sequence of str
    neutral : int
        The action that does nothing.
    occupant : Occupant
    simulator_timeout : float
        Seconds from `take` to the first state, after which to give up; 0 for never.
    """

    def __init__(
        self,
        node: Node,
        joints: Sequence[str],
        neutral: int,
        occupant: Occupant,
        simulator_timeout: float,
    ) -> None:
        self._node, self._occupant, self._timeout = node, occupant, simulator_timeout
        self._neutral = neutral
        self._pairer = Pairer(joints)
        self._rows = wire.Rows("action", wire.ACTION)
        self._out = node.create_publisher(Float64MultiArray, "action", qos.OUTGOING)
        self._joints = joints
        self._newest = (-1, -1)
        self._older = 0
        self._answer: Any = None
        self._heard = False
        self._watch: Any = None
        self.taken = False
        self.invalid = 0
        node.create_subscription(
            JointState, "state", lambda m: self._receive(self._pairer.state, m), qos.CONTROL
        )
        node.create_subscription(
            Float64MultiArray,
            "reward",
            lambda m: self._receive(self._pairer.reward, m),
            qos.CONTROL,
        )

    def take(self) -> None:
        """Begin to answer."""
        self.taken = True
        if self._timeout and self._watch is None:
            self._watch = runtime.wall_timer(self._node, self._timeout, self._check_simulator)

    def leave(self) -> None:
        """Stop answering; somebody else flies."""
        self.taken = False

    def ignore(self, why: str) -> None:
        """Count an unusable message and say why, not too often."""
        self.invalid += 1
        self._node.get_logger().warning(f"ignored: {why}", throttle_duration_sec=5.0)

    def _receive(self, pair: Callable[[Any], Observation | None], message: Any) -> None:
        try:
            observation = pair(message)
        except InputError as error:
            self.ignore(str(error))
            return
        self._heard = True
        if observation is not None and self.taken:
            self._respond(observation)

    def _respond(self, observation: Observation) -> None:
        key = (observation.episode, observation.step)
        if self._started_anew(key):
            return  # what comes next is paired afresh
        if key == self._newest:
            runtime.publish(self._out, self._answer)
            return
        for before, transition in self._pairer.transitions(observation):
            self._occupant.transition(before, transition)
        if key < self._newest or not self.taken:
            return
        self._newest = key
        action, source = self._choose(observation)
        self._answer = self._rows.message(*key, *wire.split(observation.stamp), action, source)
        runtime.publish(self._out, self._answer)
        self._occupant.answered(observation, source, self._answer)

    def _started_anew(self, key: tuple[int, int]) -> bool:
        """Whether the simulator counts from the beginning again: only old keys for a while."""
        self._older = self._older + 1 if key < self._newest else 0
        if self._older < RESTARTED:
            return False
        self._node.get_logger().warning("the simulator has started anew")
        self._pairer, self._newest, self._older = Pairer(self._joints), (-1, -1), 0
        return True

    def _choose(self, observation: Observation) -> tuple[int, Source]:
        finite = all(map(math.isfinite, observation.state.tolist()))
        if not (finite and math.isfinite(observation.reward)):
            self.ignore(
                f"state {observation.state.tolist()} or reward {observation.reward} of step "
                f"{observation.step} of episode {observation.episode} is not finite"
            )
        if observation.last:
            return self._neutral, Source.HOLD
        if not finite:
            return (observation.action if observation.action >= 0 else self._neutral), Source.HOLD
        return self._occupant.choose(observation)

    def _check_simulator(self) -> None:
        self._watch.cancel()
        if not self._heard:
            raise InputError(
                f"no simulator: nothing on {self._node.resolve_topic_name('state')} for "
                f"{self._timeout:g} s; start one in the same ROS_DOMAIN_ID, or set the parameter "
                "simulator_timeout to 0.0 to wait for ever"
            )
