"""Letting the load go, watching where it lands, and getting the next one."""

from __future__ import annotations

from collections import Counter
from enum import StrEnum
from typing import NamedTuple

from msg_bridge.mavlink.estimator import StateEstimator
from msg_bridge.mavlink.flown import FlownTask
from msg_bridge.mavlink.gripper import MOVED, Gripper
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.motion import Motion
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import AutopilotProfile
from msg_bridge.mavlink.settings import FlightSettings

_LONGEST = 2.0  # that a load is watched after it was let go [s]
_PATIENCE = 5.0  # before a person is told that no load comes [s]
_LATELY = 1.0  # so long ago an output was where it is [s]
_FRESH = 0.2  # a load seen so long after the gripper was shut is the new one [s]


class Seen(StrEnum):
    """What is known of a release, beside that the autopilot said yes."""

    FALL = "the load was seen to fall"
    OUTPUT = "the output was seen to move, and the rest is the parabola of an estimated swing"
    ACKNOWLEDGED = "nothing was seen, and all is the parabola of an estimated swing"
    FAILED = "nothing fell"


class PayloadReport(NamedTuple):
    """How it stands with the load.

    Attributes
    ----------
    gone : bool
        There is no load on the cable.
    reward : float or None
        Of the task, for where it came down; None while that is open.
    failure : str
        Why it did not come down; empty as long as it may.
    reloaded : bool
        A load hangs on the cable again.
    lacking : str
        What a person should know while no load comes; empty for nothing yet.
    """

    gone: bool = False
    reward: float | None = None
    failure: str = ""
    reloaded: bool = False
    lacking: str = ""


class Payload:
    """One load's way down, and the next one's way up.

    Parameters
    ----------
    task : FlownTask
    link : AutopilotLink
    profile : AutopilotProfile
    settings : FlightSettings
    estimator : StateEstimator
    output : int, optional
        Which output of the autopilot, from 1, moves when it lets go: it is watched.
    """

    def __init__(
        self,
        task: FlownTask,
        link: AutopilotLink,
        profile: AutopilotProfile,
        settings: FlightSettings,
        estimator: StateEstimator,
        output: int | None = None,
    ) -> None:
        self._task, self._estimator = task, estimator
        self._telemetry = link.telemetry
        self._gripper = Gripper(link, profile, settings)
        self._output = output
        self._width: int | None = None  # of the output's pulse at the release, if it was heard
        self._since = 0.0
        self._released = Motion()
        self.releases: Counter[Seen] = Counter()
        """How often what was seen of a release that was acknowledged, or of one that failed."""

    def release(self, motion: Motion, now: float) -> None:
        """Let it go, now."""
        self._width = self._pulse if now - self._telemetry.outputs_time < _LATELY else None
        self._gripper.turn(open_it=True, now=now)
        self._since = now
        self._released = motion
        self._estimator.let_go(motion, self._task.rim(motion))

    def reload(self, now: float) -> None:
        """Shut the gripper: a simulator hangs a new load there, as a person would."""
        self._gripper.turn(open_it=False, now=now)
        self._since = now

    def report(self, phase: Phase, now: float) -> PayloadReport:
        """How it stands, asking the gripper again where it has not answered."""
        if phase is Phase.RELEASE:
            reward = self._reward(now)
            failure = self._failure(now) if reward is None else ""
            if reward is not None or failure:
                self.releases[self._seen(failure)] += 1
            return PayloadReport(self._gone, reward, failure)
        if phase is Phase.RELOAD:
            reloaded = self._reloaded(now)
            lacking = "" if reloaded else self._lacking(now)
            return PayloadReport(self._gone, reloaded=reloaded, lacking=lacking)
        return PayloadReport(self._gone)

    def _seen(self, failure: str) -> Seen:
        """What there is to show that a load fell."""
        if failure:
            return Seen.FAILED
        if self._estimator.feed:
            return Seen.FALL
        return Seen.ACKNOWLEDGED if self._output is None else Seen.OUTPUT

    @property
    def _pulse(self) -> int | None:
        """Of the output that is watched [µs]; None for none, or as long as it was not heard."""
        outputs, n = self._telemetry.outputs, self._output or 0
        return outputs[n - 1] if 0 < n <= len(outputs) else None

    @property
    def _moved(self) -> bool:
        """Whether the output has moved since the release, if there is one to watch."""
        if self._output is None:
            return True
        pulse = self._pulse if self._telemetry.outputs_time > self._since else None
        if self._width is None:
            self._width = pulse  # first heard since: nobody knows from where
        return pulse is not None and self._width is not None and abs(pulse - self._width) >= MOVED

    @property
    def _gone(self) -> bool:
        """Let go; or seen so far away that it fell by itself, or when nobody heard the answer."""
        return self._estimator.fall is not None or self._estimator.away()

    def _reward(self, now: float) -> float | None:
        """The task's reward for where the load came down; None while that is open.

        It is the place that the load's own system reported. Where there is none, it is that of
        the parabola from the state in which the load was let go.
        """
        self._gripper.tick(now)
        fall = self._estimator.fall
        if not self._estimator.feed:
            answered = self._gripper.result() is not None and not self._gripper.refusal(now)
            if not (answered and self._moved):
                return None
            return self._task.dropped(self._released)
        if fall is None or not fall.fell:
            return None
        if fall.landing is None and fall.lowest > fall.plane:
            return None
        return self._task.landed(fall.landing)

    def _failure(self, now: float) -> str:
        why = self._gripper.refusal(now)
        if not why and now - self._since > _LONGEST:
            what = "it was" if self._estimator.feed else f"output {self._output} was"
            seen = "fall" if self._estimator.feed else "move"
            why = f"the load was let go, says the gripper, but {what} not seen to {seen}"
        if why and self._estimator.hangs():
            self._estimator.fall = None
            self._gripper.turn(open_it=False, now=now)  # it may think that it is open
        return why

    def _reloaded(self, now: float) -> bool:
        self._gripper.tick(now)
        seen = not self._estimator.feed or self._telemetry.load_time > self._since + _FRESH
        if self._gripper.result() is None or not seen or not self._estimator.hangs():
            return False
        self._estimator.loaded()
        return True

    def _lacking(self, now: float) -> str:
        if now - self._since < _PATIENCE:
            return ""
        return self._gripper.refusal(now) or "no load is seen on the cable"
