"""The bridge node: a MAVLink autopilot in the place of the simulator. A managed node."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from sensor_msgs.msg import Joy
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.managed import Autostart, ManagedNode
from iolspi_ros.process import say
from iolspi_ros.resources import cache_folder
from iolspi_ros.settings import Settings, replaced, setting
from iolspi_ros.vehicle_topics import VehicleTopics
from msg_bridge.mavlink.arbiter import Authority, Timeouts
from msg_bridge.mavlink.clock import VehicleClock
from msg_bridge.mavlink.codec import read_key
from msg_bridge.mavlink.envelope import Limits
from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.flown import TASKS, flown, warm_up
from msg_bridge.mavlink.joystick import SafetyPilotSettings, read_joystick
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.memory import Memory
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.preflight import ChecklistItem, Preflight
from msg_bridge.mavlink.runner import Runner
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.signing import open_book
from msg_bridge.mavlink.status import AuthorityChange, Outputs
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url

AUTHORITY = (*wire.KEY, "phase", "authority")
CHANGEABLE = ("order", "seed", "episodes", "initial")
PREFLIGHT = "bridge: preflight"
"""Of the checklist, on /diagnostics: each line a key, and `result` last of all."""
_PARTING = 1.0  # for the last words to an autopilot in flight [s]


@dataclass(frozen=True)
class BridgeSettings(Settings):
    """What the node adds to the flight."""

    task: str = setting("slung_load", "the task that is flown", choices=tuple(TASKS))


@dataclass(frozen=True)
class ManualStart(Autostart):
    """A vehicle that flies does not start by itself."""

    autostart: str = replaced(Autostart, "autostart", "never")


class Bridge(ManagedNode):
    """Publishes `task`, `state`, `reward` and `authority`; takes `action` and `joy`."""

    Autostart = ManualStart

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        super().__init__("bridge", arguments)
        self.settings = parameters.declare(self, BridgeSettings)
        self._task_class = TASKS[self.settings.task]
        classes = (
            LinkSettings, FlightSettings, Limits, Timeouts, SafetyPilotSettings, self._task_class,
        )  # fmt: skip
        for cls in classes:
            names = tuple(field.name for field in fields(cls) if field.name in CHANGEABLE)
            parameters.declare(self, cls, names)
        parameters.check_changes(self, *classes)
        parameters.warn_unknown(self)
        self.task = parameters.read(self, self._task_class)
        self._joystick = parameters.read(self, SafetyPilotSettings)
        self._timeouts = parameters.read(self, Timeouts)
        self._link: AutopilotLink | None = None
        self._flight: Flight | None = None
        self._runner: Runner | None = None
        self._preflight: Preflight | None = None
        self._checklist: dict[str, str] = {}
        self._joy = Joy()
        self._joy_time = -np.inf
        self._vehicle = VehicleTopics(self, self.task.description)
        self._authority_rows = wire.Rows("authority", AUTHORITY)
        self._authority_out = self.create_publisher(Float64MultiArray, "authority", qos.REPORTS)
        self._diagnostics_out = self.create_publisher(DiagnosticArray, "/diagnostics", qos.OUTGOING)
        self.create_subscription(Float64MultiArray, "action", self._on_action, qos.CONTROL)
        self.create_subscription(Joy, "joy", self._on_joy, qos.CONTROL)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/fly", self._on_fly)
        self.create_service(Trigger, "~/land", self._on_land)
        runtime.wall_timer(self, 0.05, self._look_after)
        runtime.wall_timer(self, 1.0, self._diagnose)
        warm_up(flown(self.task, parameters.read(self, FlightSettings)))

    def close(self) -> None:
        """Land if in the air, and give the autopilot its parameters back."""
        if self._flight is not None and self._flight.in_flight:
            say("bridge: ends in flight; the autopilot is told to land")
            self._flight.land(self._vehicle_clock.now(), "the bridge ends")
            end = time.monotonic() + _PARTING
            landing = self._flight.profile.landing
            while time.monotonic() < end and self._flight.link.telemetry.mode != landing:
                time.sleep(0.02)
        self._put_away()

    # ------------------------------------------------------------ managed

    def configure(self) -> None:
        """Find the autopilot, check it, and set its parameters."""
        try:
            self._configure()
        except BaseException as error:
            self._put_away()
            self._check("result", f"failed: {error}")
            raise

    def activate(self) -> None:
        """Take off and fly episodes."""
        assert self._flight is not None
        if self._flight.phase is Phase.DOWN:
            self._check_again()
        self._flight.begin(self._vehicle_clock.now())

    def deactivate(self) -> None:
        """Land; that goes on after this has answered."""
        assert self._flight is not None
        self._flight.land(self._vehicle_clock.now(), "deactivated")

    def cleanup(self) -> None:
        """Let the autopilot go, once it is down."""
        if self._flight is not None and self._flight.in_flight:
            raise InputError("still in the air; allowed: clean up when it has landed")
        self._put_away()

    def _configure(self) -> None:
        settings = parameters.read(self, LinkSettings)
        flight = parameters.read(self, FlightSettings)
        self._checklist = {"result": "not yet"}
        key = read_key(Path(settings.signing_key)) if settings.signing_key else None
        log = Path(settings.log).expanduser() if settings.log else None
        telemetry = Telemetry(settings.system, settings.load_system)
        self._vehicle_clock = VehicleClock(flight.real_time_factor)
        book = None if key is None else open_book(key, cache_folder())
        self._link = AutopilotLink(open_url(settings.url), telemetry, key, log, book)
        self._preflight = Preflight(
            self._link, settings, flight, self._vehicle_clock, Memory(), self._found, runtime.ok,
            self._say,
        )  # fmt: skip
        profile = self._preflight.run()
        self._flight = Flight(
            self.task, self._link, profile, flight, parameters.read(self, Limits),
            self._timeouts,
            Outputs(self._show, self._say, self._changed), self._preflight.release.output,
        )  # fmt: skip
        self._flight.check()
        self._runner = Runner(self._flight, self._vehicle_clock, self._say)
        self._runner.start()
        self._check("result", "passed")
        self.get_logger().info(
            "preflight passed; it flies once it is activated: iolspi manage bridge activate"
        )

    def _check_again(self) -> None:
        """The preflight once more: whoever is on the ground may have been restarted there."""
        assert self._flight is not None
        assert self._link is not None
        assert self._preflight is not None
        if self._runner is not None:
            self._runner.stop()
        self._checklist = {"result": "not yet"}
        try:
            self._link.telemetry.forget()
            self._preflight.run()
            self._flight.check()
            self._check("result", "passed")
        except InputError as error:
            self._check("result", f"failed: {error}")
            raise
        finally:
            self._runner = Runner(self._flight, self._vehicle_clock, self._say)
            self._runner.start()

    def _put_away(self) -> None:
        """Stop the thread, restore the autopilot's parameters, close the link."""
        if self._runner is not None:
            self._runner.stop()
        if self._preflight is not None:
            for failed in self._preflight.restore():
                # Not logged: to be read at any log level.
                say(f"bridge: {failed}; it stays as it is; iolspi fly --restore gives it back")
        if self._link is not None:
            self._link.close()
        self._link = self._flight = self._runner = self._preflight = None

    # ------------------------------------------------------------ out

    def _show(self, observation: Observation) -> None:
        self._vehicle.show(observation)
        self._vehicle.publish()

    def _say(self, level: str, text: str) -> None:
        if level == "warning":  # rclpy wants a line of its own for each severity
            self.get_logger().warning(text)
        else:
            self.get_logger().info(text)

    def _found(self, item: ChecklistItem) -> None:
        self.get_logger().info(f"preflight: {item.name}: {item.found}")
        self._check(item.name, item.found)

    def _check(self, name: str, found: str) -> None:
        """Add to the checklist, and let everybody see it."""
        result = self._checklist.pop("result", "not yet")
        self._checklist |= {name: found} if name == "result" else {name: found, "result": result}
        self._report([self._preflight_status()])

    def _look_after(self) -> None:
        """What no message brings about: a stick that has fallen silent."""
        flight = self._flight
        if flight is None:
            return
        fresh = time.monotonic() - self._joy_time < self._timeouts.joy_timeout
        person = read_joystick(self._joystick, self._joy.buttons, self._joy.axes, fresh=fresh)
        flight.supervise(deadman=person.deadman, stick=person.stick)

    def _changed(self, change: AuthorityChange) -> None:
        key = (change.episode, change.step, *wire.split(round(change.time * 1e9)))
        row = self._authority_rows.message(*key, change.phase, change.authority)
        self._authority_out.publish(row)

    def _diagnose(self) -> None:
        if not self._checklist:
            return
        statuses = [self._preflight_status()]
        flight = self._flight
        if flight is not None:
            found, authority = flight.status(), flight.ruling.authority
            worried = authority in (Authority.HOLD, Authority.LAND, Authority.OTHER)
            words = f"{found['authority']}: {found['reason'] or found['phase']}"
            statuses.append(_status("bridge", worried, words, flight.profile.name, found))
        self._report(statuses)

    def _preflight_status(self) -> DiagnosticStatus:
        result = self._checklist["result"]
        return _status(PREFLIGHT, result != "passed", result, "", self._checklist)

    def _report(self, statuses: list[DiagnosticStatus]) -> None:
        message = DiagnosticArray(status=statuses)
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_out.publish(message)

    # ------------------------------------------------------------ in

    def _on_action(self, message: Any) -> None:
        answer = self._vehicle.read(message)
        if answer is None or self._flight is None:
            return
        number, step = wire.whole(answer.episode), wire.whole(answer.step)
        self._flight.act(number, step, answer.action, self._vehicle_clock.now(), answer.source)

    def _on_joy(self, message: Any) -> None:
        self._joy, self._joy_time = message, time.monotonic()

    def _on_reset(self, _: Any, response: Any) -> Any:
        if self._flight is None:
            response.success, response.message = False, "not configured"
            return response
        try:
            settings = parameters.read(self, FlightSettings)
            self.task = parameters.read(self, self._task_class)
        except InputError as error:
            response.success, response.message = False, str(error)
            return response
        self._flight.reset(self._vehicle_clock.now(), self.task, settings)
        response.success, response.message = True, f"seed {settings.seed}"
        return response

    def _on_fly(self, _: Any, response: Any) -> Any:
        """Take off again, once it is down: what `activate` does, for who is active already."""
        flight = self._flight
        if flight is None or not self.active:
            response.success, response.message = False, "not active; allowed: activate it first"
        elif flight.in_flight:
            response.success, response.message = False, f"in flight: {flight.phase.name.lower()}"
        else:
            try:
                self.activate()
                response.success, response.message = True, "checked; it takes off"
            except InputError as error:
                response.success, response.message = False, str(error)
        return response

    def _on_land(self, _: Any, response: Any) -> Any:
        if self._flight is None or not self._flight.in_flight:
            response.success, response.message = False, "not in flight"
            return response
        self._flight.land(self._vehicle_clock.now(), "a person has asked for it")
        response.success, response.message = True, "it lands"
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        if self._flight is None:
            response.success, response.message = False, "not configured"
            return response
        self._flight.supervise(paused=request.data)
        response.success, response.message = True, "holding" if request.data else "flying"
        return response


def _status(
    name: str, worried: bool, words: str, hardware: str, values: Mapping[str, Any]
) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=DiagnosticStatus.WARN if worried else DiagnosticStatus.OK,
        name=name,
        message=words,
        hardware_id=hardware,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )


def main() -> int:
    """Run the bridge."""
    return runtime.main(Bridge, "bridge")
