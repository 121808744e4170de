"""What is asked of the autopilot in each phase, for whoever commands."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.envelope import Limits, Motion, limit, stick_bounds
from msg_bridge.mavlink.estimator import StateEstimator
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import AutopilotProfile
from msg_bridge.mavlink.setpoints import (
    AccelerationSetpoint,
    Integral,
    PositionSetpoint,
    Setpoint,
    VelocitySetpoint,
)
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.transit import Transit, across, upwards
from sim_nodes.tasks.base import G
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad

_SLOW = 0.3  # below this it is told where to stay, above it to stop [m/s]
_STICK_SPEED = 2.0  # of a stick held all the way [m/s]


class Guidance:
    """Turns intentions into setpoints inside the envelope.

    Parameters
    ----------
    task : SlungLoad
    profile : AutopilotProfile
    settings : FlightSettings
    limits : Limits
    estimator : StateEstimator

    Attributes
    ----------
    limits : Limits
        Those in force now.
    """

    def __init__(
        self,
        task: SlungLoad,
        profile: AutopilotProfile,
        settings: FlightSettings,
        limits: Limits,
        estimator: StateEstimator,
    ) -> None:
        self._profile, self._settings, self.limits = profile, settings, limits
        self._estimator, self._neutral = estimator, task.description.neutral
        self._choices = np.array([action.value[0] for action in task.description.actions[:RELEASE]])
        self._transit = Transit(limits.cable, limits.response)
        self._integral = Integral()
        self._anchor: tuple[float, float, float] | None = None
        self._before, self._resting = 0.0, False
        self.applied = task.description.neutral
        """The action that comes nearest to the acceleration in force."""
        self.interventions: Counter[str] = Counter()

    def begin(self) -> None:
        """A phase begins: nothing of the one before is kept but the acceleration in force."""
        self._anchor = None
        self._resting = False
        self._integral.forget()

    def rest(self) -> None:
        """An episode begins, with the neutral action."""
        self._before, self.applied = 0.0, self._neutral

    def setpoint(
        self,
        authority: Authority,
        phase: Phase,
        motion: Motion,
        *,
        wanted: float,
        target: float,
        stick: float,
        dt: float,
    ) -> Setpoint | None:
        """What to ask for now; None for nothing.

        Parameters
        ----------
        authority, phase, motion
        wanted : float
            Acceleration of the actor's action [m/s²].
        target : float
            x to fly to between episodes [m].
        stick : float
            Of a person who has taken over, -1 to 1.
        dt : float
            Since the last setpoint [s].
        """
        if authority in (Authority.NOBODY, Authority.LAND):
            return None
        if authority is Authority.PILOT:
            self._anchor = None
            slow, fast = stick_bounds(self.limits, motion)
            speed = max(slow, min(stick * _STICK_SPEED, fast))
            return VelocitySetpoint(speed, *self._back(motion))
        if authority is Authority.OTHER:
            self._anchor = None  # so that it stays where it is when it is given back
            return self._hold(motion) if self._profile.stream_first else None
        if authority in (Authority.ACTOR, Authority.NEUTRAL):
            return self._push(wanted if authority is Authority.ACTOR else 0.0, motion, dt)
        if authority is Authority.BRIDGE and phase is Phase.TRANSIT:
            if self._rests(target, motion):
                return PositionSetpoint(target, 0.0, self._settings.height)
            return self._push(self._transit.along(target, motion, dt), motion, dt)
        if authority is Authority.BRIDGE and phase in (Phase.ARMING, Phase.TAKEOFF):
            return self._start(phase)
        return self._hold(motion)

    def _rests(self, target: float, m: Motion) -> bool:
        """Whether the autopilot's own position hold does the rest of the way.

        Accelerations from a noisy estimate would stir up again what is nearly at rest.
        """
        away, pull = abs(m.x - target), G / self.limits.cable
        swing = math.hypot(m.swing, m.swing_rate / math.sqrt(pull))  # its amplitude
        if self._resting:
            self._resting = away < 1.2 and swing < 0.3
        else:
            self._resting = away < 0.5 and abs(m.speed) < 0.4 and swing < 0.15
        if self._resting:
            self._before = 0.0
            self._integral.forget()
        return self._resting

    def _start(self, phase: Phase) -> Setpoint | None:
        """Where to stay before take-off, and where to climb to, without a take-off by command."""
        if not self._profile.stream_first:
            return None
        here = self._anchor or self._estimator.place()
        if not np.isfinite(here).all():
            return None
        self._anchor = here
        return PositionSetpoint(
            *here[:2], self._settings.height if phase is Phase.TAKEOFF else here[2]
        )

    def _hold(self, m: Motion) -> Setpoint:
        """Brake, then stay."""
        if self._anchor is None and max(abs(m.speed), abs(m.drift)) > _SLOW:
            return VelocitySetpoint(0.0, 0.0, 0.0)
        if self._anchor is None:
            self._anchor = (m.x, m.across, m.height)
        return PositionSetpoint(*self._anchor)

    def _back(self, m: Motion) -> tuple[float, float]:
        """Velocities across and upwards that lead back to the track [m/s]."""
        up = 0.8 * (self._settings.height - m.height)
        return max(-1.0, min(-0.8 * m.across, 1.0)), max(-1.0, min(up, 1.0))

    def _push(self, wanted: float, m: Motion, dt: float) -> Setpoint:
        """An acceleration inside the envelope, and which of the actions that is."""
        limited = limit(self.limits, wanted, m, self._before, dt)
        reasons = [reason for reason in limited.reasons if reason != "jerk"]
        self.interventions.update(reasons)
        applied = limited.acceleration if reasons else wanted
        self.applied = int(np.argmin(np.abs(self._choices - applied)))
        self._before = limited.acceleration
        if self._settings.setpoints == "velocity":
            velocity = self._integral.velocity(limited.acceleration, m.speed, dt)
            return VelocitySetpoint(velocity, *self._back(m))
        height = self._settings.height
        return AccelerationSetpoint(limited.acceleration, across(m), upwards(height, m), height)
