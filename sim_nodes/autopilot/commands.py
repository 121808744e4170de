"""What the autopilot does with each message that comes in."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_nodes.autopilot import setpoints, telemetry
from sim_nodes.autopilot.ardupilot import ArduPilot
from sim_nodes.autopilot.commander import CRITICAL, FORCE, INFO, Result
from sim_nodes.autopilot.connection import Connection
from sim_nodes.autopilot.firmware import Mode
from sim_nodes.autopilot.onboard import Onboard
from sim_nodes.autopilot.px4 import Px4


class Inbox:
    """Takes messages in turn.

    Parameters
    ----------
    autopilot : Onboard
        Whom they are for.
    """

    def __init__(self, autopilot: Onboard) -> None:
        self._a = autopilot
        self._handlers = {
            "HEARTBEAT": self._heartbeat, "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command, "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._setpoint, "TIMESYNC": self._timesync,
            "PARAM_REQUEST_LIST": self._param_list, "PARAM_REQUEST_READ": self._param_read,
            "PARAM_SET": self._param_set, "MANUAL_CONTROL": self._manual,
            "RC_CHANNELS_OVERRIDE": self._override, "MISSION_REQUEST_LIST": self._mission,
            "SETUP_SIGNING": self._signing,
        }  # fmt: skip
        self._commands = {
            22: self._take_off, 20: self._return, 21: self._land, 176: self._do_set_mode,
            183: self._servo, 187: self._actuator, 211: self._gripper, 246: self._reboot,
            400: self._arm, 410: self._get_home, 510: self._get_interval, 511: self._interval,
            512: self._request, 520: self._version,
        }  # fmt: skip

    def take(self, message: Any, link: Connection) -> None:
        """Act on a message, if it is for this autopilot."""
        handler = self._handlers.get(message.get_type())
        if handler is None or self._a.commander.aborted:
            return
        target = getattr(message, "target_system", getattr(message, "target", 0))
        if target not in (0, self._a.system):
            return
        component = getattr(message, "target_component", 0)
        if not self._a.firmware.any_component and component not in (0, 1):
            return
        handler(message, link)

    # ------------------------------------------------------------ flying

    def _heartbeat(self, message: Any, link: Connection) -> None:
        if self._is_station(message):
            self._a.commander.ground_station_seen = self._a.now

    def _is_station(self, message: Any) -> bool:
        """ArduCopter knows its ground station by its number, PX4 by its type."""
        if isinstance(self._a.commander, ArduPilot):
            return bool(message.get_srcSystem() == self._a.parameters["MAV_GCS_SYSID"])
        return bool(message.type == mavlink.MAV_TYPE_GCS)

    def _setpoint(self, message: Any, link: Connection) -> None:
        commander, body = self._a.commander, self._a.body
        yaw = float(body.attitude[0, 2])
        if isinstance(commander, Px4):
            target = setpoints.of_px4(message, yaw)
            if target is None:
                frame, mask = message.coordinate_frame, message.type_mask
                self._a.say(CRITICAL, f"Setpoint unsupported: frame {frame}, mask 0x{mask:04X}")
            else:
                commander.setpoint(target)
        elif isinstance(commander, ArduPilot):
            try:
                target = setpoints.of_ardupilot(message, body.position, yaw)
            except setpoints.NotFiniteError:
                commander.aborted = "an acceleration setpoint was not finite"
                return
            if target is None:
                commander.stop()
            else:
                commander.setpoint(target)

    def _manual(self, message: Any, link: Connection) -> None:
        if isinstance(self._a.commander, Px4):
            self._a.commander.manual()

    def _override(self, message: Any, link: Connection) -> None:
        if isinstance(self._a.commander, ArduPilot) and self._is_station(message):
            widths = [getattr(message, f"chan{i}_raw") for i in range(1, 9)]
            self._a.commander.override(widths)

    def _set_mode(self, message: Any, link: Connection) -> None:
        self._change_mode(message.custom_mode)

    def _change_mode(self, custom: int) -> bool:
        mode = self._a.commander.mode_of(custom)
        if mode is None:
            if not isinstance(self._a.commander, Px4):
                self._a.say(CRITICAL, f"No such mode {custom}")
            return False
        return self._a.commander.set_mode(mode)

    # ------------------------------------------------------------ commands

    def _command(self, message: Any, link: Connection) -> None:
        handler = self._commands.get(message.command)

        def answer(result: Result) -> None:
            ack = mavlink.MAVLink_command_ack_message(
                message.command, int(result), 0, 0, message.get_srcSystem(),
                message.get_srcComponent(),
            )  # fmt: skip
            self._a.send(ack, link)

        if handler is None:
            answer(Result.UNSUPPORTED)
            return
        outcome = handler(message, link, answer)
        if outcome is not None:
            answer(outcome)

    def _arm(self, m: Any, link: Connection, _: Any) -> Result:
        change = self._a.commander.arm if m.param1 >= 0.5 else self._a.commander.disarm
        return change(m.param2 == FORCE)

    def _do_set_mode(self, m: Any, link: Connection, _: Any) -> Result:
        if not isinstance(self._a.commander, Px4):
            return Result.ACCEPTED if self._change_mode(_whole(m.param2)) else Result.FAILED
        self._change_mode(_whole(m.param2) << 16 | _whole(m.param3) << 24)
        return Result.ACCEPTED  # also when it was refused: measured

    def _take_off(self, m: Any, link: Connection, _: Any) -> Result:
        height = float(m.param7 if m.get_type() == "COMMAND_LONG" else m.z)
        if isinstance(self._a.commander, Px4):
            default = float(self._a.parameters["MIS_TAKEOFF_ALT"])
            height = height - telemetry.HOME[2] if math.isfinite(height) else default
        return self._a.commander.take_off(height)

    def _return(self, m: Any, link: Connection, _: Any) -> Result:
        return Result.ACCEPTED if self._a.commander.set_mode(Mode.RETURN) else Result.FAILED

    def _land(self, m: Any, link: Connection, _: Any) -> Result:
        return Result.ACCEPTED if self._a.commander.set_mode(Mode.LAND) else Result.FAILED

    def _gripper(self, m: Any, link: Connection, answer: Any) -> Result | None:
        if isinstance(self._a.commander, Px4):
            return self._a.release.gripper_of_px4(_whole(m.param2), answer, self._a.commander.armed)
        return self._a.release.gripper_of_ardupilot(_whole(m.param2))

    def _servo(self, m: Any, link: Connection, _: Any) -> Result:
        if isinstance(self._a.commander, Px4):
            return Result.UNSUPPORTED
        return self._a.release.servo_of_ardupilot(_whole(m.param1), m.param2)

    def _actuator(self, m: Any, link: Connection, _: Any) -> Result:
        if not isinstance(self._a.commander, Px4):
            return Result.UNSUPPORTED
        return self._a.release.actuator_of_px4(m.param1)

    def _reboot(self, m: Any, link: Connection, answer: Any) -> Result | None:
        if _whole(m.param1) != 1:
            return Result.DENIED
        forced = (m.param6 if m.get_type() == "COMMAND_LONG" else m.y) == 20190226
        if self._a.commander.armed and not forced:
            return Result.FAILED
        answer(Result.ACCEPTED)
        self._a.boot()
        return None

    # ------------------------------------------------------------ what it is asked to tell

    def _interval(self, m: Any, link: Connection, _: Any) -> Result:
        name = telemetry.NAMES.get(_whole(m.param1))
        if name is None or name in self._a.firmware.lacks:
            if isinstance(self._a.commander, ArduPilot):  # its simulator does
                self._a.say(INFO, f"No ap_message for mavlink id ({_whole(m.param1)})")
                return Result.DENIED
            return Result.FAILED
        if name == "HEARTBEAT" and self._a.firmware.fixed_heartbeat:
            return Result.ACCEPTED
        standard = self._a.firmware.rates.get(name, 0.0)
        interval = min(m.param2, 2e9)
        rate = 1e6 / interval if interval > 0 else 0.0 if interval < 0 else standard
        link.set_rate(name, rate)
        return Result.ACCEPTED

    def _get_interval(self, m: Any, link: Connection, _: Any) -> Result:
        number = _whole(m.param1)
        name = telemetry.NAMES.get(number)
        if name is None:
            return Result.FAILED
        rate = link.rates.get(name, 0.0)
        interval = round(1e6 / rate) if rate else -1
        self._a.send(mavlink.MAVLink_message_interval_message(number, interval), link)
        return Result.ACCEPTED

    def _request(self, m: Any, link: Connection, _: Any) -> Result:
        name = telemetry.NAMES.get(_whole(m.param1))
        message = telemetry.BUILDERS[name](self._a) if name else None
        if message is None:
            return Result.DENIED
        self._a.send(message, link)
        return Result.ACCEPTED

    def _get_home(self, m: Any, link: Connection, _: Any) -> Result:
        message = telemetry.BUILDERS["HOME_POSITION"](self._a)
        if message is None:
            return Result.FAILED
        self._a.send(message, link)
        return Result.ACCEPTED

    def _version(self, m: Any, link: Connection, _: Any) -> Result:
        self._a.send(telemetry.BUILDERS["AUTOPILOT_VERSION"](self._a), link)
        return Result.ACCEPTED

    def _timesync(self, message: Any, link: Connection) -> None:
        if message.tc1 == 0:
            nanoseconds = self._a.microseconds * 1000
            self._a.send(mavlink.MAVLink_timesync_message(nanoseconds, message.ts1), link)

    def _mission(self, message: Any, link: Connection) -> None:
        system, component = message.get_srcSystem(), message.get_srcComponent()
        self._a.send(mavlink.MAVLink_mission_count_message(system, component, 0), link)

    # ------------------------------------------------------------ parameters

    def _show(self, name: str, link: Connection | None, index: int | None = None) -> None:
        number, kind = self._a.parameters.encode(name)
        place = self._a.parameters.names.index(name) if index is None else index
        count = len(self._a.parameters)
        self._a.send(
            mavlink.MAVLink_param_value_message(name.encode(), number, kind, count, place), link
        )

    def _param_list(self, message: Any, link: Connection) -> None:
        for index, name in enumerate(self._a.parameters.names):
            self._show(name, link, index)

    def _param_read(self, message: Any, link: Connection) -> None:
        if message.param_index >= 0:
            if message.param_index < len(self._a.parameters):
                self._show(self._a.parameters.names[message.param_index], link)
        elif message.param_id in self._a.parameters:
            self._show(message.param_id, link)

    def _param_set(self, message: Any, link: Connection) -> None:
        name = message.param_id
        if name in self._a.parameters:
            value = self._a.parameters.decode(name, message.param_value, message.param_type)
            if value is not None:
                self._a.change(name, value)
            self._show(name, None)

    def _signing(self, message: Any, link: Connection) -> None:
        if not self._a.commander.armed:
            self._a.sign(bytes(message.secret_key))


def _whole(number: float) -> int:
    """A parameter of a command as the whole number it stands for; -1 where it is none."""
    return int(number) if math.isfinite(number) else -1
