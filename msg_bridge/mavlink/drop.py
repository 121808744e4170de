"""Letting the load go, watching where it lands, and getting the next one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.mavlink.envelope import Motion
from msg_bridge.mavlink.gripper import Gripper
from msg_bridge.mavlink.link import Link
from msg_bridge.mavlink.profiles import Profile
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.sight import Sight
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad

Array = NDArray[np.float64]

_LONGEST = 2.0  # that a load is watched after it was let go [s]
_PATIENCE = 5.0  # before a person is told that no load comes [s]
_FRESH = 0.2  # a load seen so long after the gripper was shut is the new one [s]


class Drop:
    """One load's way down, and the next one's way up.

    Parameters
    ----------
    task : SlungLoad
    link : Link
    profile : Profile
    settings : FlightSettings
    sight : Sight
    """

    def __init__(
        self,
        task: SlungLoad,
        link: Link,
        profile: Profile,
        settings: FlightSettings,
        sight: Sight,
    ) -> None:
        self._task, self._sight = task, sight
        self._telemetry = link.telemetry
        self._gripper = Gripper(link, profile, settings)
        self._since = 0.0
        self.state: Array = np.zeros(4)
        """In which the load was let go."""

    def begin(self, state: Array, motion: Motion, now: float) -> None:
        """Let it go, now."""
        self._gripper.turn(open_it=True, now=now)
        self._since, self.state = now, state
        self._sight.let_go(motion, self._task.rim)

    def reward(self, now: float) -> float | None:
        """The task's reward for where the load came down; None while that is open.

        It is the place that the load's own system reported. Where there is none, it is that of
        the parabola from the state in which the load was let go.
        """
        self._gripper.tick(now)
        fall = self._sight.fall
        if not self._sight.feed:
            answered = self._gripper.result() is not None and not self._gripper.refusal(now)
            return float(self._task.step(self.state, RELEASE)[1]) if answered else None
        if fall is None or self._sight.hangs():
            return None
        if fall.landing is None and fall.lowest > fall.plane:
            return None
        return self._task.landed(fall.landing)

    def failure(self, now: float) -> str:
        """Why the load did not come down; empty as long as it may."""
        why = self._gripper.refusal(now)
        if not why and now - self._since > _LONGEST:
            why = "the load was let go, says the gripper, but it was not seen to fall"
        if why and self._sight.hangs():
            self._sight.fall = None
        return why

    # ------------------------------------------------------------ the next one

    @property
    def needed(self) -> bool:
        """Whether there is no load on the cable."""
        return self._sight.fall is not None

    def reload(self, now: float) -> None:
        """Shut the gripper: a simulator hangs a new load there, as a person would."""
        self._gripper.turn(open_it=False, now=now)
        self._since = now

    def reloaded(self, now: float) -> bool:
        """Whether a load hangs on the cable again."""
        self._gripper.tick(now)
        seen = not self._sight.feed or self._telemetry.load_time > self._since + _FRESH
        if self._gripper.result() is None or not seen or not self._sight.hangs():
            return False
        self._sight.loaded()
        return True

    def lacking(self, now: float) -> str:
        """What a person should know while no load comes; empty for nothing yet."""
        if now - self._since < _PATIENCE:
            return ""
        return self._gripper.refusal(now) or "no load is seen on the cable"
