"""Where ArduCopter differs: see `firmware.ARDUPILOT` for its numbers."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from typing import Any

from sim_nodes.autopilot.commander import INFO, WARNING, Commander, Result, spot
from sim_nodes.autopilot.control import HAS_POSITION, HAS_VELOCITY, Gains, Target
from sim_nodes.autopilot.firmware import Mode
from sim_nodes.quadrotor.airframe import G

RECEIVER = (1500, 1500, 1000, 1500, 1800, 1000, 1000, 1800)
"""What the simulated receiver says when nobody overrides it [µs]: no throttle, mode 6."""

_SWITCH = (1231, 1361, 1491, 1621, 1750)
"""Widths of pulse from which the mode switch is in its next position [µs]."""
_JERKS = ("PSC_JERK_XY", "PSC_JERK_NE", "PSC_NE_JERK")
"""What one parameter is called in one version after the other."""
_EKF_PATIENCE = 1.0  # [s]
_DEAD_STICK = 0.2  # of the throttle, to both sides


class ArduPilot(Commander):
    """ArduCopter: GUIDED needs a take-off, holds its last setpoint, and obeys everybody."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._jerk = next(name for name in _JERKS if name in self.parameters)
        self.channels = list(RECEIVER)
        self._setpoint_at = self._override_at = -math.inf
        self._climbing = self._station_lost = self._estimator_acted = False

    def setpoint(self, target: Target) -> None:
        """A setpoint has come; on the ground it does nothing."""
        if self.mode is Mode.EXTERNAL and self.airborne and not self._climbing:
            if self.target is None:
                self.body.begin()
            self.target, self._setpoint_at = target, self.now

    def stop(self) -> None:
        """A setpoint that it cannot use: the vehicle stops, and nothing is said."""
        if self.target is not None:
            self.target = self._place = None

    def take_off(self, height: float) -> Result:
        """Climb, in GUIDED."""
        if not (self.armed and self.mode is Mode.EXTERNAL and self.body.landed and height > 0.0):
            return Result.FAILED
        self._enter()
        self._height, self._climbing = height, True
        return Result.ACCEPTED

    def override(self, channels: Sequence[int]) -> None:
        """RC_CHANNELS_OVERRIDE: 0 gives a channel back, 65535 leaves it as it is."""
        self._override_at = self.now
        before = self.channels[4]
        for i, width in enumerate(channels[: len(RECEIVER)]):
            if width != 65535:
                self.channels[i] = width or RECEIVER[i]
        self._switch(before)

    def gains(self) -> Gains:
        """Along a shaped reference."""
        value = self.parameters
        tilt = math.radians(float(value["ANGLE_MAX"]) / 100.0)
        return Gains(
            shaped=True,
            jerk=(self._most_jerk, float(value["PSC_JERK_Z"])),
            acceleration=(float(value["WPNAV_ACCEL"]) / 100.0, 1.0),
            speed=(float(value["WPNAV_SPEED"]) / 100.0, float(value["WPNAV_SPEED_UP"]) / 100.0,
                   float(value["WPNAV_SPEED_DN"]) / 100.0),
            top_speed=9.3,  # the fastest that a held acceleration was seen to lead to
            position=(1.0, 1.0),
            velocity=(2.0, 5.0),
            integral=(0.5, 1.0),
            velocity_scale=1.0,
            lift_error=0.0,
            tilt=tilt,
            push=0.71 * G * math.tan(tilt),  # 4.3 m/s² at 30°, as measured
            yaw_rate=math.radians(200.0),
        )  # fmt: skip

    @property
    def _most_jerk(self) -> float:
        """Of the horizontal [m/s³]: never more than half the root of acceleration times snap.

        So in its source (AC_PosControl, `set_max_speed_accel_NE_m`), and so it flies: 10.8 m/s³
        with its defaults, whatever more is asked for.
        """
        turning = math.radians(float(self.parameters["ATC_ACCEL_P_MAX"]) / 100.0)
        snap = turning * G
        able = 0.5 * math.sqrt(float(self.parameters["WPNAV_ACCEL"]) / 100.0 * snap)
        return min(float(self.parameters[self._jerk]), able)

    @property
    def _late(self) -> bool:
        """Whether setpoints have stopped that were no places."""
        if self.target is None or self.target.use[0] & HAS_POSITION:
            return False
        return self.now - self._setpoint_at > float(self.parameters["GUID_TIMEOUT"])

    # ------------------------------------------------------------ refusals

    def _against_arming(self) -> Result | None:
        if not self.ready:
            self.say(WARNING, "Arm: Need Position Estimate")
        elif self.mode not in (Mode.EXTERNAL, Mode.HOLD, Mode.MANUAL):
            self.say(WARNING, f"Arm: {self.firmware.names[self.mode]} mode not armable")
        else:
            return None
        return Result.FAILED

    def _refuse_disarming(self) -> Result:
        return Result.FAILED

    def _say_refused(self, mode: Mode, why: str) -> None:
        self.say(WARNING, f"Mode change to {self.firmware.names[mode]} failed: {why}")

    # ------------------------------------------------------------ failsafes

    @property
    def critical(self) -> bool:
        """Whether its heartbeat says that a failsafe acts: its modes do not tell."""
        station = self._station_lost and bool(self.parameters["FS_GCS_ENABLE"])
        return self._estimator_acted or station

    def tick(self, now: float) -> None:
        """Look after the override too: it lapses, armed or not."""
        if now - self._override_at > float(self.parameters["RC_OVERRIDE_TIME"]):
            self._override_at = math.inf
            before = self.channels[4]
            self.channels = list(RECEIVER)
            self._switch(before)
        super().tick(now)

    def _switch(self, before: int) -> None:
        """Channel 5 changes the mode when it comes to another position."""
        position = bisect.bisect(_SWITCH, self.channels[4])
        if position != bisect.bisect(_SWITCH, before):
            mode = self.mode_of(int(self.parameters[f"FLTMODE{position + 1}"]))
            if mode is not None:
                self.set_mode(mode)

    def _watch(self) -> None:
        lost = self.now - self._lost_since if self._lost_since >= 0.0 else 0.0
        if lost > _EKF_PATIENCE and not self._estimator_acted:
            self._estimator_acted = True
            if self.parameters["FS_EKF_ACTION"] and self.mode is not Mode.MANUAL:
                self.say(WARNING, "EKF Failsafe: changed to LAND Mode")
                self.intended = Mode.LAND
        elif lost == 0.0:
            self._estimator_acted = False
        silent = self.now - self.ground_station_seen
        gone = silent > float(self.parameters["FS_GCS_TIMEOUT"]) and self.ground_station_seen >= 0.0
        if gone and not self._station_lost and self.parameters["FS_GCS_ENABLE"]:
            self.say(WARNING, "GCS Failsafe")
            self.intended = Mode.RETURN
        self._station_lost = gone

    def _estimator_lost(self) -> None:
        self.say(WARNING, "EKF variance")

    # ------------------------------------------------------------ steering

    def _enter(self) -> None:
        super()._enter()
        self.target, self._climbing = None, False

    def _follow(self) -> Target | None:
        if self._climbing:
            target = self._climb()
            self._climbing = self._stage != 2
            return target
        if not self.airborne:
            return None
        if self.target is None:
            return self._hold()
        if self._late:
            return spot(self.body.position, (0.0, 0.0, 0.0))
        turn = self.channels[3] - 1500
        if abs(turn) > 20:  # the stick's yaw is obeyed, its other axes are not
            rate = math.radians(202.5) * turn / 400.0
            return self.target._replace(yaw=math.nan, yaw_rate=rate)
        return self.target

    def _hold(self) -> Target:
        """In LOITER the throttle is obeyed: the simulator's, which nobody holds, is down."""
        target = super()._hold()
        stick = (self.channels[2] - 1500) / 500.0
        if self.mode is Mode.HOLD and abs(stick) > _DEAD_STICK and self.airborne:
            target.use[2], target.values[1, 2] = HAS_VELOCITY, -self.firmware.stick_speed * stick
        return target

    def _land_speed(self) -> float:
        return float(self.parameters["LAND_SPEED"]) / 100.0

    def _return_height(self, distance: float) -> float:
        return float(self.parameters["RTL_ALT"]) / 100.0

    def _idle_time(self) -> float:
        return float(self.parameters["DISARM_DELAY"])

    def _disarm_on_ground(self) -> None:
        super()._disarm_on_ground()
        idle = self._idle_time()
        if self.armed and self.airborne and self.now - self._down_since > idle > 0.0:
            self.say(INFO, "Disarming motors")
            self._stop()
