"""What is asked of the autopilot in each phase, for whoever commands."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.envelope import Limits, limit, stick_bounds
from msg_bridge.mavlink.estimator import StateEstimator
from msg_bridge.mavlink.flown import FlownTask
from msg_bridge.mavlink.motion import Creep, Motion, Vector
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

Array = NDArray[np.float64]

_SLOW = 0.3  # below this it is told where to stay, above it to stop [m/s]
_STICK_SPEED = 2.0  # of a stick held all the way [m/s]


class Guidance:
    """Turns intentions into setpoints inside the envelope.

    Parameters
    ----------
    task : FlownTask
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
        task: FlownTask,
        profile: AutopilotProfile,
        settings: FlightSettings,
        limits: Limits,
        estimator: StateEstimator,
    ) -> None:
        self._profile, self._settings, self.limits = profile, settings, limits
        self._estimator, self._neutral = estimator, task.description.neutral
        self._axes = range(task.axes)
        self._choices = np.array([a.value for a in task.description.actions[: task.release]])
        self._transits = [Transit(limits.cable, limits.response) for _ in self._axes]
        self._integrals = [Integral() for _ in self._axes]
        self._creeps, self._creep = [Creep() for _ in self._axes], [0.0 for _ in self._axes]
        self._anchor: Vector | None = None
        self._before, self._resting = np.zeros(task.axes), False
        self.applied = task.description.neutral
        """The action that comes nearest to the accelerations in force."""
        self.interventions: Counter[str] = Counter()

    def begin(self) -> None:
        """A phase begins: nothing of the one before is kept but the acceleration in force."""
        self._anchor = None
        self._resting = False
        self._forget()

    def rest(self) -> None:
        """An episode begins, with the neutral action."""
        self._before[:], self.applied = 0.0, self._neutral

    def _forget(self) -> None:
        for integral in self._integrals:
            integral.forget()

    def setpoint(
        self,
        authority: Authority,
        phase: Phase,
        motion: Motion,
        *,
        wanted: Sequence[float],
        target: Vector,
        stick: Sequence[float],
        dt: float,
    ) -> Setpoint | None:
        """What to ask for now; None for nothing.

        Parameters
        ----------
        authority, phase, motion
        wanted : sequence of float
            Accelerations of the actor's action along each axis [m/s²].
        target : tuple of float
            x, y and height to fly to between episodes; the height is held in one, too [m].
        stick : sequence of float
            Of a person who has taken over: x and y, -1 to 1.
        dt : float
            Since the last setpoint [s].
        """
        for axis, law in enumerate(self._creeps):
            self._creep[axis] = law.see(motion.place[axis], motion.velocity[axis], dt)
        if authority in (Authority.NOBODY, Authority.LAND):
            return None
        if authority is Authority.PILOT:
            self._anchor = None
            speeds = []
            for axis in self._axes:
                slow, fast = stick_bounds(self.limits, motion, axis, self._creep[axis])
                speeds.append(max(slow, min(stick[axis] * _STICK_SPEED, fast)))
            return self._velocity(speeds, motion, target)
        if authority is Authority.OTHER:
            self._anchor = None  # so that it stays where it is when it is given back
            return self._hold(motion) if self._profile.stream_first else None
        if authority in (Authority.ACTOR, Authority.NEUTRAL):
            push = np.array(wanted) * (authority is Authority.ACTOR)
            return self._push(push, motion, target, dt)
        if authority is Authority.BRIDGE and phase is Phase.TRANSIT:
            if self._rests(target, motion):
                return PositionSetpoint(*target)
            ways = zip(self._axes, self._transits, target, strict=False)
            push = np.array([law.along(to, motion.plane(axis), dt) for axis, law, to in ways])
            return self._push(push, motion, target, dt)
        if authority is Authority.BRIDGE and phase in (Phase.ARMING, Phase.TAKEOFF):
            return self._start(phase)
        return self._hold(motion)

    def _rests(self, target: Vector, m: Motion) -> bool:
        """Whether the autopilot's own position hold does the rest of the way.

        Accelerations from a noisy estimate would stir up again what is nearly at rest.
        """
        planes, pull = [m.plane(axis) for axis in self._axes], G / self.limits.cable
        away = math.hypot(*(p.place - to for p, to in zip(planes, target, strict=False)))
        speed = math.hypot(*(p.speed for p in planes))
        rates = (p.swing_rate / math.sqrt(pull) for p in planes)
        swing = math.hypot(*(p.swing for p in planes), *rates)  # its amplitude
        if self._resting:
            self._resting = away < 1.2 and swing < 0.3
        else:
            self._resting = away < 0.5 and speed < 0.4 and swing < 0.15
        if self._resting:
            self._before[:] = 0.0
            self._forget()
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

    def _velocity(self, speeds: Sequence[float], m: Motion, target: Vector) -> Setpoint:
        """Velocities along the axes; across a single one, and upwards, those that lead back."""
        up = max(-1.0, min(0.8 * (target[2] - m.height), 1.0))
        aside = speeds[1] if len(speeds) > 1 else max(-1.0, min(-0.8 * m.across, 1.0))
        return VelocitySetpoint(speeds[0], aside, up)

    def _push(self, wanted: Array, m: Motion, target: Vector, dt: float) -> Setpoint:
        """Accelerations inside the envelope, and which of the actions they are."""
        pushes, applied = wanted.copy(), wanted.copy()
        for axis in self._axes:
            limited = limit(
                self.limits, float(wanted[axis]), m, float(self._before[axis]), dt, axis,
                self._creep[axis],
            )  # fmt: skip
            pushes[axis] = limited.acceleration
            if reasons := [reason for reason in limited.reasons if reason != "jerk"]:
                self.interventions.update(reasons)
                applied[axis] = limited.acceleration
        self.applied = int(np.argmin(((self._choices - applied) ** 2).sum(axis=1)))
        self._before = pushes
        if self._settings.setpoints == "velocity":
            ways = zip(self._integrals, pushes.tolist(), m.velocity, strict=False)
            return self._velocity([law.velocity(a, v, dt) for law, a, v in ways], m, target)
        aside = float(pushes[1]) if len(pushes) > 1 else across(m)
        height = target[2]
        return AccelerationSetpoint(float(pushes[0]), aside, upwards(height, m), height)
