"""A robot living through episodes: what it is told when, and what it says. No ROS here."""

from __future__ import annotations

from enum import StrEnum
from typing import Protocol

import numpy as np

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from msg_bridge.ros.description import Robot
from msg_bridge.ros.sensing import NANOSECONDS, Sensing

GIVE_UP = 1.0
"""Seconds without a whole state after which an episode is broken off."""
LATE = 1.5
"""Sampling times after which a step has taken too long to be one."""
AGAIN = 1.0
"""Seconds after which an episode that nobody answered begins anew."""


class Phase(StrEnum):
    """What the robot is about."""

    IDLE = "idle"
    RESETTING = "waiting for the reset"
    SETTLING = "settling"
    EPISODE = "episode"
    STOPPED = "stopped"


class Body(Protocol):
    """The robot's end of the wire."""

    def command(self, action: int) -> None:
        """Publish what an action means."""
        ...

    def show(self, observation: Observation) -> None:
        """Publish a state and its reward."""
        ...

    def reset(self) -> None:
        """Ask for the robot to be put at a start; `Drive.placed` is called when it is."""
        ...

    def say(self, text: str) -> None:
        """Tell a person, not too often."""
        ...


class Drive:
    """Keeps T_s, pairs actions with states, and stands between the learner and the robot.

    Times are in nanoseconds of the vehicle's clock.

    Parameters
    ----------
    robot : Robot
    body : Body

    Attributes
    ----------
    phase : Phase
    trouble : str
        Why it stopped, or waits; empty for nothing.
    counts : dict of str to int
        Steps left out, states that nobody answered, actions that were not let through, breaches.
    """

    def __init__(self, robot: Robot, body: Body) -> None:
        self._robot, self._task, self._body = robot, robot.task, body
        self.sensing = Sensing(robot)
        self.phase, self.trouble = Phase.IDLE, ""
        self.episode, self._step, self._latest_stamp = -1, 0, 0
        self._seen: Observation | None = None
        self._until = self._missing_since = 0
        self._ticked = 0
        self._applied, self._source, self._answered = self._task.neutral, int(Source.HOLD), False
        self._gap, self._breach = False, ""
        self.counts = {"left out": 0, "not answered": 0, "not let through": 0, "limits passed": 0}

    # ------------------------------------------------------------ told from outside

    def begin(self) -> None:
        """Have the robot put at a start, and go on from there."""
        self._neutral()
        self.trouble, self.phase = "", Phase.RESETTING
        self._body.reset()

    def placed(self, now: int) -> None:
        """The robot is at a start."""
        if self.phase is Phase.RESETTING:
            self._settle(now, self._robot.reset.settle)

    def stop(self) -> None:
        """Leave the robot alone, with the neutral action."""
        self._neutral()
        self.phase = Phase.IDLE

    def hear(self, topic: str, message: object, now: int) -> None:
        """Take what one of the robot's topics says."""
        try:
            for place in self.sensing.hear(topic, message, now):
                self._watch(place)
        except InputError as error:
            self._body.say(str(error))

    def _watch(self, place: int) -> None:
        """Stop the robot at once where a variable passes its limit."""
        if self.phase is not Phase.EPISODE or self._breach:
            return
        low, high = self._robot.limits[place]
        value = self.sensing.value(place)
        if not low <= value <= high:
            self._breach = self._words(place, value)
            self.counts["limits passed"] += 1
            self._neutral()

    def _beyond(self, state: list[float]) -> str:
        """Which variable is beyond its limits, in words; empty for none."""
        for place, (low, high) in enumerate(self._robot.limits):
            if not low <= state[place] <= high:
                return self._words(place, state[place])
        return ""

    def _words(self, place: int, value: float) -> str:
        low, high = self._robot.limits[place]
        name = self._task.names[place]
        return f"{name} is {value:.4g}, beyond its limits {low:g} to {high:g}"

    def answer(self, episode: float, step: float, action: int, source: int = -1) -> None:
        """Take an action that answers a state."""
        current = self.phase is Phase.EPISODE and not self._breach
        if not current or self._answered or (episode, step) != (self.episode, self._step):
            return
        assert self._seen is not None
        self._answered = True
        rule = self._robot.allowed.get(action)
        try:
            if rule and not rule(dict(zip(self._task.names, self._seen.state, strict=True))):
                action, source = self._task.neutral, Source.HOLD
                self.counts["not let through"] += 1
        except InputError as error:
            self._halt(str(error))
            return
        self._command(action, source)

    # ------------------------------------------------------------ time

    def check(self) -> None:
        """Look whether a state was answered in time; call `answer_within` after each tick."""
        if self.phase is not Phase.EPISODE or self._answered or self._breach:
            return
        self._answered = self._gap = True  # an answer that comes now is too late
        self.counts["not answered"] += 1
        self._neutral()
        if self._step == 0:
            self._body.say("nobody answers the first state; is a learner or demonstrator there?")
            self._settle(self._latest_stamp, AGAIN)

    def tick(self, now: int) -> None:
        """Do what is due; call every T_s."""
        late = now - self._ticked > LATE * self._task.sampling_time * NANOSECONDS
        self._gap |= late and self.phase is Phase.EPISODE  # the machine slept: a longer step
        self._ticked = now
        try:
            if self.phase is Phase.SETTLING:
                self._begin_if_ready(now)
            elif self.phase is Phase.EPISODE:
                self._go_on(now)
            elif self.phase is not Phase.IDLE:
                self._neutral()
        except InputError as error:
            self._halt(str(error))

    def _begin_if_ready(self, now: int) -> None:
        self._neutral()
        if now < self._until:
            return
        try:
            state = self.sensing.state(now)
        except InputError as error:
            self._wait_for(str(error))
            return
        values = dict(zip(self._task.names, state, strict=True))
        if beyond := self._beyond(state):
            self._wait_for(beyond)
            return
        ready = self._robot.reset.ready
        if ready and not ready(values):
            self._wait_for(f"the robot is not where it is to start: {ready.text} does not hold")
            return
        self.trouble, self.phase = "", Phase.EPISODE
        self.episode, self._step, self._gap, self._breach = self.episode + 1, 0, False, ""
        self._missing_since = now
        self._show(Observation(self.episode, 0, np.array(state)), now)

    def _wait_for(self, text: str) -> None:
        self.trouble = text
        self._body.say(f"waiting: {text}")

    def _go_on(self, now: int) -> None:
        """One step further."""
        assert self._seen is not None
        self._step += 1
        try:
            state = self.sensing.state(now)
        except InputError as error:
            self._leave_out(str(error), now)
            return
        self._breach = self._breach or self._beyond(state)
        if self._gap or self._breach:  # what was in force is not one action: no transition
            self._step += 1
            self.counts["left out"] += 1
        before, self._missing_since = self._seen.state.tolist(), now
        judged = self._robot.rules.judge(before, self._applied, state)
        full = self._step >= self._task.episode_steps
        cut = not judged.terminated and (judged.truncated or full or bool(self._breach))
        self._gap = False
        observation = Observation(
            self.episode, self._step, np.array(state), judged.reward, self._applied,
            judged.terminated, cut, source=self._source,
        )  # fmt: skip
        self._show(observation, now)
        if observation.last:
            if self._breach:
                self._body.say(self._breach)
            self.begin()

    def _leave_out(self, why: str, now: int) -> None:
        """A step without a whole state."""
        self.counts["left out"] += 1
        self._gap = self._answered = True
        self._neutral()
        self._body.say(why)
        if now - self._missing_since > GIVE_UP * NANOSECONDS:
            self.trouble = why
            self.begin()

    # ------------------------------------------------------------ small things

    def _show(self, observation: Observation, now: int) -> None:
        self._latest_stamp = max(now, self._latest_stamp + 1)  # every state has one of its own
        self._seen = observation._replace(stamp=self._latest_stamp)
        self._answered = False
        self._body.show(self._seen)

    def _settle(self, now: int, seconds: float) -> None:
        self.phase, self._until = Phase.SETTLING, now + round(seconds * NANOSECONDS)
        self.sensing.restart()

    def _halt(self, text: str) -> None:
        self._neutral()
        self.phase, self.trouble = Phase.STOPPED, text
        self._body.say(f"stopped: {text}")

    def _neutral(self) -> None:
        self._command(self._task.neutral, Source.HOLD)

    def _command(self, action: int, source: int) -> None:
        self._applied, self._source = action, source
        self._body.command(action)
