"""What is asked of the autopilot in each phase, for each commander."""

from __future__ import annotations

from collections import Counter

import numpy as np

from msg_bridge.mavlink.authority import Commander
from msg_bridge.mavlink.envelope import Limits, Motion, limit
from msg_bridge.mavlink.ferry import Ferry, across, upwards
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import Profile
from msg_bridge.mavlink.setpoints import Integral, Push, Run, Stay, Wish
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.sight import Sight
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad

_SLOW = 0.3  # below this it is told where to stay, above it to stop [m/s]
_STICK_SPEED = 2.0  # of a stick held all the way [m/s]


class Steering:
    """Turns intentions into setpoints inside the envelope.

    Parameters
    ----------
    task : SlungLoad
    profile : Profile
    settings : FlightSettings
    limits : Limits
    sight : Sight
    """

    def __init__(
        self,
        task: SlungLoad,
        profile: Profile,
        settings: FlightSettings,
        limits: Limits,
        sight: Sight,
    ) -> None:
        self._profile, self._settings, self._limits = profile, settings, limits
        self._sight, self._neutral = sight, task.neutral
        self._choices = np.array(task.actions[:RELEASE])
        self._ferry = Ferry(limits.cable, limits.response)
        self._integral = Integral()
        self._anchor: tuple[float, float, float] | None = None
        self._before = 0.0
        self.applied = task.neutral
        """The action that comes nearest to the acceleration in force."""
        self.interventions: Counter[str] = Counter()

    def begin(self) -> None:
        """A phase begins: nothing of the one before is kept but the acceleration in force."""
        self._anchor = None
        self._integral.forget()

    def rest(self) -> None:
        """An episode begins, with the neutral action."""
        self._before, self.applied = 0.0, self._neutral

    def wish(
        self,
        commander: Commander,
        phase: Phase,
        motion: Motion,
        *,
        wanted: float,
        target: float,
        stick: float,
        dt: float,
    ) -> Wish | None:
        """What to ask for now; None for nothing.

        Parameters
        ----------
        commander, phase, motion
        wanted : float
            Acceleration of the actor's action [m/s²].
        target : float
            x to fly to between episodes [m].
        stick : float
            Of a person who has taken over, -1 to 1.
        dt : float
            Since the last wish [s].
        """
        if commander in (Commander.NOBODY, Commander.LAND):
            return None
        if commander is Commander.PILOT:
            self._anchor = None
            return Run(stick * _STICK_SPEED, *self._back(motion))
        if commander is Commander.OTHER:
            self._anchor = None  # so that it stays where it is when it is given back
            return self._hold(motion) if self._profile.stream_first else None
        if commander in (Commander.ACTOR, Commander.NEUTRAL):
            return self._push(wanted if commander is Commander.ACTOR else 0.0, motion, dt)
        if commander is Commander.BRIDGE and phase is Phase.FERRY:
            return self._push(self._ferry.along(target, motion, dt), motion, dt)
        if commander is Commander.BRIDGE and phase in (Phase.GROUND, Phase.CLIMB):
            return self._start(phase)
        return self._hold(motion)

    def _start(self, phase: Phase) -> Wish | None:
        """Where to stay before take-off, and where to climb to, without a take-off by command."""
        if not self._profile.stream_first:
            return None
        here = self._anchor or self._sight.place()
        if not np.isfinite(here).all():
            return None
        self._anchor = here
        return Stay(*here[:2], self._settings.height if phase is Phase.CLIMB else here[2])

    def _hold(self, m: Motion) -> Wish:
        """Brake, then stay."""
        if self._anchor is None and max(abs(m.speed), abs(m.drift)) > _SLOW:
            return Run(0.0, 0.0, 0.0)
        if self._anchor is None:
            self._anchor = (m.x, m.across, m.height)
        return Stay(*self._anchor)

    def _back(self, m: Motion) -> tuple[float, float]:
        """Velocities across and upwards that lead back to the track [m/s]."""
        up = 0.8 * (self._settings.height - m.height)
        return max(-1.0, min(-0.8 * m.across, 1.0)), max(-1.0, min(up, 1.0))

    def _push(self, wanted: float, m: Motion, dt: float) -> Wish:
        """An acceleration inside the envelope, and which of the actions that is."""
        limited = limit(self._limits, wanted, m, self._before, dt)
        reasons = [reason for reason in limited.reasons if reason != "jerk"]
        self.interventions.update(reasons)
        applied = limited.acceleration if reasons else wanted
        self.applied = int(np.argmin(np.abs(self._choices - applied)))
        self._before = limited.acceleration
        if self._settings.setpoints == "velocity":
            velocity = self._integral.velocity(limited.acceleration, m.speed, dt)
            return Run(velocity, *self._back(m))
        height = self._settings.height
        return Push(limited.acceleration, across(m), upwards(height, m), height)
