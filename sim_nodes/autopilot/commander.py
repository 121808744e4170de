"""Modes, arming and failsafes that the imitated autopilots have in common.

PX4 calls this module of its own by the same name.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from sim_nodes.autopilot.body import Body
from sim_nodes.autopilot.control import HAS_POSITION, HAS_VELOCITY, Gains, Target
from sim_nodes.autopilot.firmware import Firmware, Mode
from sim_nodes.autopilot.parameters import Parameters

Array = NDArray[np.float64]

CRITICAL, WARNING, INFO = 2, 4, 6
"""MAV_SEVERITY."""

FORCE = 21196
"""Second number of a command to arm or disarm whatever the state."""

_GRAVITY = (Mode.HOLD, Mode.RETURN, Mode.LAND)
_SLOW = 0.3  # below it a vehicle that brakes holds its place [m/s]
_LOST_DRIFT = np.array([0.8, 0.6, 0.0])  # of an estimate without a position [m/s]; chosen


class Result(IntEnum):
    """MAV_RESULT of a command."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6


def spot(
    place: Sequence[float] | Array, speed: Sequence[float | None] = (None, None, None)
) -> Target:
    """Hold a place [m]; on axes with a speed [m/s], move with that instead."""
    use, values = np.full(3, HAS_POSITION), np.zeros((3, 3))
    values[0] = place
    for axis, wanted in enumerate(speed):
        if wanted is not None:
            use[axis], values[1, axis] = HAS_VELOCITY, wanted
    return Target(use, values)


class Commander:
    """State of one autopilot: its mode, whether it is armed, what it steers to.

    A subclass for each autopilot says where they differ.

    Parameters
    ----------
    firmware, parameters, body
    say : callable
        Takes a severity and a text, for STATUSTEXT.
    """

    _landing_modes = frozenset({Mode.LAND, Mode.RETURN})
    """In which a vehicle that has come down disarms."""

    def __init__(
        self,
        firmware: Firmware,
        parameters: Parameters,
        body: Body,
        say: Callable[[int, str], None],
    ) -> None:
        self.firmware, self.parameters, self.body, self.say = firmware, parameters, body, say
        self.now = 0.0
        self.intended = firmware.first_mode
        self.failsafes: dict[str, Mode] = {}  # by what was lost
        self.armed, self.airborne = False, False
        self.target: Target | None = None
        self.aborted = ""
        self.ground_station_seen = -1.0
        self._armed_at = self._down_since = self._mode_since = 0.0
        self._place: Array | None = None
        self._height = 0.0
        self._stage = 0
        self._lost_since = -1.0
        self._steering: Mode | None = None

    # ------------------------------------------------------------ what is so

    @property
    def failsafe(self) -> Mode | None:
        """The gravest of the failsafes, None where there is none."""
        if not self.failsafes:
            return None
        return max(self.failsafes.values(), key=_GRAVITY.index)

    @property
    def critical(self) -> bool:
        """Whether its heartbeat says that a failsafe acts."""
        return bool(self.failsafes)

    @property
    def mode(self) -> Mode:
        """What it really does."""
        return self.failsafe or self.intended

    @property
    def ready(self) -> bool:
        """Whether the estimator knows where it is."""
        return self.now >= self.firmware.ready_after and not self.parameters["SIM_EKF_FAIL"]

    def mode_of(self, number: int) -> Mode | None:
        """The mode with a custom_mode, None where it is not imitated."""
        found = [mode for mode, custom in self.firmware.modes.items() if custom == number]
        return found[0] if found else None

    # ------------------------------------------------------------ commands

    def arm(self, force: bool) -> Result:
        """Let the motors turn, unless there is something against it."""
        if self.armed:
            return Result.ACCEPTED
        refused = None if force else self._against_arming()
        if refused is not None:
            return refused
        self.armed, self.airborne = True, False
        self._armed_at = self._down_since = self.now
        self._enter()
        return Result.ACCEPTED

    def disarm(self, force: bool) -> Result:
        """Stop the motors; in flight only by force."""
        if self.armed and self.airborne and not self.body.landed and not force:
            return self._refuse_disarming()
        self._stop()
        return Result.ACCEPTED

    def set_mode(self, mode: Mode) -> bool:
        """Change the mode as a person asks for it; whether it did."""
        if mode is self.intended and not self.failsafes:
            return True
        if self.armed and mode not in (Mode.MANUAL, Mode.LAND) and not self.ready:
            self._say_refused(mode, "requires position")
            return False
        self.intended = mode
        self.failsafes.clear()
        self._enter()
        return True

    def take_off(self, height: float) -> Result:
        """Climb to a height over the ground [m]."""
        raise NotImplementedError

    def setpoint(self, target: Target) -> None:
        """A setpoint that counts has come."""
        raise NotImplementedError

    # ------------------------------------------------------------ each tick

    def tick(self, now: float) -> None:
        """Look after arming and failsafes."""
        self.now = now
        if self.body.broken and self.armed:
            self.say(CRITICAL, "Crash: Disarming")
            self._stop()
        self._watch_estimator()
        if self.armed:
            self.airborne = self.airborne or self.body.height > 0.1
            if not self.body.landed:
                self._down_since = now
            self._watch()
            self._disarm_on_ground()
        if self.mode is not self._steering:
            self._enter()

    def steer(self) -> tuple[Target, bool, bool]:
        """Where to go; whether the motors turn; whether only to stay level."""
        level = not self.ready
        motors = self.armed and self.mode is not Mode.MANUAL
        if not motors:
            return spot(self.body.position), False, level
        if self.mode is Mode.EXTERNAL:
            target = self._follow()
        elif self.mode is Mode.LAND:
            target = self._descend()
        elif self.mode is Mode.RETURN:
            target = self._return()
        elif self.mode is Mode.TAKEOFF:
            target = self._climb()
        else:
            target = self._hold()
        return target or spot(self.body.position), target is not None, level

    def gains(self) -> Gains:
        """How to get there, from the parameters as they are."""
        raise NotImplementedError

    # ------------------------------------------------------------ where autopilots differ

    def _against_arming(self) -> Result | None:
        """Why it cannot be armed, said in a STATUSTEXT."""
        raise NotImplementedError

    def _refuse_disarming(self) -> Result:
        raise NotImplementedError

    def _watch(self) -> None:
        """Failsafes while armed."""
        raise NotImplementedError

    def _follow(self) -> Target | None:
        """The setpoint to follow; None for motors that do not turn yet."""
        raise NotImplementedError

    def _estimator_lost(self) -> None:
        raise NotImplementedError

    def _land_speed(self) -> float:
        raise NotImplementedError

    def _return_height(self, distance: float) -> float:
        """At which it flies home from a distance [m]."""
        raise NotImplementedError

    # ------------------------------------------------------------ steering

    def _enter(self) -> None:
        """A mode begins."""
        self._steering, self._mode_since = self.mode, self.now
        self._place, self._stage = None, 0
        self.body.begin()

    def _stop(self) -> None:
        self.armed, self.airborne, self.target = False, False, None
        self.failsafes.clear()

    def _say_refused(self, mode: Mode, why: str) -> None:
        """Tell that a mode was refused, where the autopilot does."""

    def _hold(self) -> Target:
        """Brake, then stay."""
        if self.body.landed:
            return spot(self.body.position, (0.0, 0.0, 0.5))
        if self._place is None:
            if np.linalg.norm(self.body.velocity) > _SLOW:
                return spot(self.body.position, (0.0, 0.0, 0.0))
            self._place = self.body.position.copy()
            self.body.begin()
        return spot(self._place)

    def _descend(self) -> Target:
        target = self._hold()
        target.use[2] = HAS_VELOCITY
        target.values[1, 2] = self._land_speed()
        return target

    def _climb(self) -> Target | None:
        """To `_height`, straight up; stages: motors spool up, climb, arrived."""
        allowed = max(self._mode_since, self._armed_at + self.firmware.arming_delay)
        if self.now - allowed < self.firmware.spool_up and self._stage == 0:
            return None
        if self._stage == 0:
            self._stage = 1
            self._place = self.body.position.copy()
            self._place[2] = -self._height
            self.body.begin()
        assert self._place is not None
        if abs(self.body.position[2] - self._place[2]) < 0.1:
            self._stage = 2
        return spot(self._place)

    def _return(self) -> Target:
        """Climb, fly home, land; stages in that order."""
        here = self.body.position
        distance = float(np.hypot(here[0], here[1]))
        if self._place is None:
            height = max(self._return_height(distance), -float(here[2]))
            self._place = np.array([here[0], here[1], -height])
        if self._stage == 0 and abs(here[2] - self._place[2]) < 0.3:
            self._stage = 1
            self._place[:2] = 0.0
        if self._stage == 1 and distance < 0.3 and np.linalg.norm(self.body.velocity) < _SLOW:
            self._stage = 2
        speed = (None, None, self._land_speed() if self._stage == 2 else None)
        return spot(self._place, speed)

    def _watch_estimator(self) -> None:
        failing = bool(self.parameters["SIM_EKF_FAIL"])
        if failing and self._lost_since < 0.0:
            self._lost_since = self.now
            if self.armed:
                self._estimator_lost()
        elif not failing and self._lost_since >= 0.0:
            self._lost_since = -1.0
            self.body.begin()

    @property
    def drift(self) -> Array:
        """Velocity with which the estimate runs away [m/s]."""
        return _LOST_DRIFT if self.parameters["SIM_EKF_FAIL"] else np.zeros(3)

    def _disarm_on_ground(self) -> None:
        if not self.airborne:
            if self.now - self._armed_at > self._idle_time() > 0.0 and self.body.landed:
                self.say(INFO, "Disarmed by auto preflight disarming")
                self._stop()
        elif self.mode in self._landing_modes and self.now - self._down_since > self._landed_time():
            self.say(INFO, "Landing detected: disarming")
            self._stop()

    def _idle_time(self) -> float:
        """After which an armed vehicle on the ground disarms [s]."""
        raise NotImplementedError

    def _landed_time(self) -> float:
        """After which a vehicle that has come down disarms [s]."""
        return 1.0
