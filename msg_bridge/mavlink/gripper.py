"""Letting the load go: by gripper, servo or actuator, with the acknowledgement watched."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.profiles import AutopilotProfile
from msg_bridge.mavlink.settings import FlightSettings

_COMMANDS = {
    "gripper": dialect.MAV_CMD_DO_GRIPPER,
    "servo": dialect.MAV_CMD_DO_SET_SERVO,
    "actuator": dialect.MAV_CMD_DO_SET_ACTUATOR,
}
_GOOD = (dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_IN_PROGRESS)
_CANCELLED = 6  # MAV_RESULT, of which this dialect does not know
_AGAIN = 0.1  # between two requests while none is answered [s]
MOVED = 50
"""By so much the pulse of an output that moves something changes at least [µs]."""
_PATIENCE = 1.0  # without an answer [s]


class Gripper:
    """Opens and shuts what holds the load, asking until it is answered.

    Parameters
    ----------
    link : AutopilotLink
    profile : AutopilotProfile
    settings : FlightSettings
    """

    def __init__(
        self, link: AutopilotLink, profile: AutopilotProfile, settings: FlightSettings
    ) -> None:
        self._link, self._settings = link, settings
        self._how = profile.release if settings.release == "auto" else settings.release
        self._command = _COMMANDS[self._how]
        self._begun = self._asked = 0.0
        self._asks = 0
        self._open = False

    @property
    def how(self) -> str:
        """By what: gripper, servo or actuator."""
        return self._how

    def turn(self, *, open_it: bool, now: float) -> None:
        """Ask for it to be opened or shut."""
        self._open, self._begun, self._asks = open_it, now, 0
        self._ask(now)

    def tick(self, now: float) -> None:
        """Ask again while nobody has answered."""
        if self.result() is None and now - self._asked >= _AGAIN:
            self._ask(now)

    def result(self) -> int | None:
        """MAV_RESULT of the answer; None as long as there is none.

        That something was cancelled is said of what was asked for before. Who is asked once more
        for what it is doing already rejects that: then it is doing it.
        """
        answer = self._link.telemetry.acks.get(self._command)
        if answer is None or answer[1] == _CANCELLED:
            return None
        if answer[1] == dialect.MAV_RESULT_TEMPORARILY_REJECTED and self._asks > 1:
            return int(dialect.MAV_RESULT_IN_PROGRESS)
        return answer[1]

    def refusal(self, now: float) -> str:
        """Why it did not happen, as far as the answer says; empty as long as it may have."""
        result = self.result()
        if result is None:
            silent = now - self._begun > _PATIENCE
            return f"the {self._how} did not answer for {_PATIENCE:g} s" if silent else ""
        if result in _GOOD:
            return ""
        name = dialect.enums["MAV_RESULT"][result].name if result in _results() else str(result)
        said = self._link.telemetry.texts_since(self._begun)
        return f"the {self._how} was refused: {name}" + (f" ({said[-1]})" if said else "")

    def _ask(self, now: float) -> None:
        s = self._settings
        self._asked, self._asks = now, self._asks + 1
        if self._how == "gripper":
            action = dialect.GRIPPER_ACTION_RELEASE if self._open else dialect.GRIPPER_ACTION_GRAB
            self._link.command(self._command, 1, action)
        elif self._how == "servo":
            self._link.command(self._command, s.servo, s.servo_open if self._open else s.servo_shut)
        else:
            values = [0.0] * 6
            values[s.actuator - 1] = s.actuator_open if self._open else s.actuator_shut
            self._link.command(self._command, *values)


def _results() -> dict[int, object]:
    found: dict[int, object] = dialect.enums["MAV_RESULT"]
    return found
