"""Where PX4 differs: see `firmware.PX4` for its numbers."""

from __future__ import annotations

import math
from typing import Any

from sim_nodes.autopilot.commander import CRITICAL, WARNING, Commander, Result
from sim_nodes.autopilot.control import Gains, Target
from sim_nodes.autopilot.firmware import Mode
from sim_nodes.quadrotor.airframe import G

_FLAP = 0.5  # a stream slower than the time-out by more than this is none [s]
_FRESH = 5.0  # after so long a silence a setpoint begins a stream anew [s]
_AFTER_LOSS = {
    0: Mode.RETURN, 1: Mode.RETURN, 2: Mode.RETURN,  # there is no stick, so it goes home
    3: Mode.RETURN, 4: Mode.LAND, 5: Mode.HOLD,
}  # fmt: skip
_AFTER_STATION = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND}
_OFFBOARD_EXCEPTED = 4
_LAND_SHARE = 0.85  # of the speed asked for that it sinks with: 0.6 of 0.7 m/s; measured
_LAND_DETECTED = 2.8  # after it has come down [s]; measured


class Px4(Commander):
    """PX4: refuses in silence, goes by the stream."""

    _landing_modes = frozenset(Mode)

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._setpoint_at, self._gap, self._manual_at = -math.inf, math.inf, -math.inf
        self._station_lost = False
        self._before_landing = Mode.HOLD

    @property
    def _streaming(self) -> bool:
        """Whether setpoints come often enough for OFFBOARD to begin."""
        time_out = float(self.parameters["COM_OF_LOSS_T"])
        return self.now - self._setpoint_at < time_out and self._gap < time_out + _FLAP

    def setpoint(self, target: Target) -> None:
        """A setpoint that counts has come: also one that is not obeyed feeds the stream."""
        gap = self.now - self._setpoint_at
        self._gap, self._setpoint_at = gap if gap < _FRESH else 0.0, self.now
        self.target = target

    def manual(self) -> None:
        """MANUAL_CONTROL has come; in OFFBOARD it moves nothing, but is watched from now on."""
        self._manual_at = self.now
        self.failsafes.pop("manual control", None)

    def set_mode(self, mode: Mode) -> bool:
        """Change the mode; nothing but the heartbeat tells when it does not."""
        if mode is Mode.EXTERNAL and not self._streaming:
            return False
        if mode is Mode.LAND and self.intended is not Mode.LAND:
            self._before_landing = self.intended
        if mode is Mode.TAKEOFF:
            self._height = float(self.parameters["MIS_TAKEOFF_ALT"])
        return super().set_mode(mode)

    def take_off(self, height: float) -> Result:
        """Climb in a mode of its own, then hold."""
        if not (self.armed and height > 0.0 and super().set_mode(Mode.TAKEOFF)):
            return Result.DENIED
        self._height = height
        return Result.ACCEPTED

    def gains(self) -> Gains:
        """Proportional; what the simulator's drag leaves of a velocity is not made up for."""
        value = self.parameters
        tilt = math.radians(float(value["MPC_TILTMAX_AIR"]))
        climb = "MPC_TKO_SPEED" if self.mode is Mode.TAKEOFF else "MPC_Z_VEL_MAX_UP"
        # Where nobody else steers, it flies along a reference with a limited jerk.
        return Gains(
            shaped=self.mode is not Mode.EXTERNAL,
            jerk=(6.0, 8.0),  # chosen: with it the measured way to rest
            acceleration=(3.0, 3.0),
            speed=(float(value["MPC_XY_CRUISE"]), float(value[climb]),
                   float(value["MPC_Z_VEL_MAX_DN"])),
            top_speed=float(value["MPC_XY_VEL_MAX"]),
            position=(0.95, 1.0),
            velocity=(1.8, 4.0),  # MPC_XY_VEL_P_ACC, and chosen
            integral=(0.4, 1.0),  # MPC_XY_VEL_I_ACC, and chosen
            velocity_scale=1.0,
            lift_error=0.085,  # 1 m lost in 6.5 s, as measured
            tilt=tilt,
            push=G * math.tan(tilt),
            yaw_rate=math.radians(200.0),
        )  # fmt: skip

    def _against_arming(self) -> Result | None:
        if not self.ready:
            self.say(CRITICAL, "Arming denied: Resolve system health failures first")
            return Result.TEMPORARILY_REJECTED
        if self.mode is Mode.EXTERNAL and not self._streaming:
            self.say(CRITICAL, "Arming denied: No offboard signal")
            return Result.TEMPORARILY_REJECTED
        return None

    def _refuse_disarming(self) -> Result:
        self.say(CRITICAL, "Disarming denied: not landed")
        return Result.TEMPORARILY_REJECTED

    def _watch(self) -> None:
        if self.intended is Mode.EXTERNAL:
            self._watch_stream()
            self._watch_stick()
        if self.mode is Mode.TAKEOFF and self._stage == 2:
            self.intended = Mode.HOLD
        self._watch_station()
        if self.ready:
            self.failsafes.pop("position estimate", None)

    def _fail(self, what: str, action: Mode | None) -> None:
        """Something was lost; without an action it is only told."""
        if what in self.failsafes:
            return
        if action is None:
            self.say(WARNING, f"{what} lost".capitalize())
        else:
            self.failsafes[what] = action
            self.say(WARNING, f"Failsafe: {what} lost, {self.firmware.names[action]}")

    def _watch_stream(self) -> None:
        late = self.now - self._setpoint_at - float(self.parameters["COM_OF_LOSS_T"])
        if late > self.firmware.notice and self.airborne:
            self._fail("offboard signal", _AFTER_LOSS.get(
                int(self.parameters["COM_OBL_RC_ACT"]), Mode.LAND))  # fmt: skip
        elif late <= 0.0:
            self.failsafes.pop("offboard signal", None)

    def _watch_stick(self) -> None:
        late = self.now - self._manual_at - float(self.parameters["COM_RC_LOSS_T"])
        excepted = int(self.parameters["COM_RCL_EXCEPT"]) & _OFFBOARD_EXCEPTED
        if late > self.firmware.notice and math.isfinite(late) and not excepted:
            self._manual_at = -math.inf  # once: who changes the mode then has it
            self._fail("manual control", Mode.HOLD)

    def _watch_station(self) -> None:
        time_out = float(self.parameters["COM_DL_LOSS_T"])
        lost = self.now - self.ground_station_seen > time_out and self.ground_station_seen >= 0.0
        if lost and not self._station_lost:
            self._fail("connection to ground station",
                       _AFTER_STATION.get(int(self.parameters["NAV_DLL_ACT"])))  # fmt: skip
        elif not lost:
            self.failsafes.pop("connection to ground station", None)
        self._station_lost = lost

    def _estimator_lost(self) -> None:
        self._fail("position estimate", Mode.LAND)

    def _follow(self) -> Target | None:
        if not self.airborne and self.now - self._armed_at < self.firmware.spool_up:
            return None
        return self.target or self._hold()

    def _stop(self) -> None:
        super()._stop()
        if self.intended is Mode.LAND:  # measured: it shows what it did before
            self.intended = self._before_landing

    def _land_speed(self) -> float:
        return _LAND_SHARE * float(self.parameters["MPC_LAND_SPEED"])

    def _return_height(self, distance: float) -> float:
        near = distance < float(self.parameters["RTL_MIN_DIST"])
        return 0.0 if near else float(self.parameters["RTL_RETURN_ALT"])

    def _idle_time(self) -> float:
        return float(self.parameters["COM_DISARM_PRFLT"])

    def _landed_time(self) -> float:
        return _LAND_DETECTED + float(self.parameters["COM_DISARM_LAND"])
