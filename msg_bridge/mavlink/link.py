"""The link to one autopilot: a transport, a codec, its telemetry, and what we may say to it."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink.codec import Codec
from msg_bridge.mavlink.profiles import AutopilotProfile
from msg_bridge.mavlink.signing import StampBook
from msg_bridge.mavlink.sources import Sources
from msg_bridge.mavlink.telemetry import Telemetry, parameter_raw
from msg_bridge.mavlink.transport import Transport

SYSTEM, COMPONENT = 255, dialect.MAV_COMP_ID_MISSIONPLANNER
"""Who we are: 255 is the ground station that ArduPilot listens to by default."""

RATES = {
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0,
    dialect.MAVLINK_MSG_ID_ATTITUDE: 20.0,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 20.0,
    dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 10.0,
    dialect.MAVLINK_MSG_ID_HEARTBEAT: 5.0,
}
"""What is asked for [Hz], beside what its estimator says. PX4 stays at one heartbeat a second."""
_ESTIMATOR_RATE = 5.0  # [Hz]

_BEAT = 1.0  # between our heartbeats [s]
_SYNC = 0.5  # between two measurements of the round trip [s]
_MOST = 1000  # reads at once
_STRANGE = 20_000.0  # of strangers is looked into, while those who matter are known [bytes/s]
_BURST = 8192.0  # [bytes]


FELT = {dialect.MAVLINK_MSG_ID_SCALED_IMU: 50.0, dialect.MAVLINK_MSG_ID_ATTITUDE: 50.0}
"""What is asked for besides where the accelerometer is listened to [Hz]."""


def rates(profile: AutopilotProfile, *, felt: bool = False) -> dict[int, float]:
    """Messages that an autopilot is asked for, and how often [Hz]."""
    return RATES | {profile.estimator: _ESTIMATOR_RATE} | (FELT if felt else {})


class AutopilotLink:
    """Speaks MAVLink with one system; thread-safe.

    Parameters
    ----------
    transport : Transport
    telemetry : Telemetry
    key : bytes, optional
        Sign, and take nothing unsigned.
    log : Path, optional
        A .tlog of all that is said.
    book : StampBook, optional
        Of the key's stamps.
    """

    def __init__(
        self,
        transport: Transport,
        telemetry: Telemetry,
        key: bytes | None = None,
        log: Path | None = None,
        book: StampBook | None = None,
    ) -> None:
        self._transport, self.telemetry = transport, telemetry
        # Unbuffered: what led to a kill is what one wants to read.
        self._file = None if log is None else log.open("wb", buffering=0)
        self.codec = Codec(SYSTEM, COMPONENT, key, self._file, book)
        self.sources = Sources()
        self.unread = 0
        """Datagrams of strangers that were not even looked into."""
        self._allowance, self._allowed = _BURST, 0.0
        self._lock = threading.Lock()
        self._beat = self._sync = -_BEAT
        self.sent = 0

    @property
    def target(self) -> tuple[int, int]:
        """System and component that commands are for."""
        return self.telemetry.system, self.telemetry.component

    def close(self) -> None:
        """Let the address go, close the log, and write down which stamps were seen."""
        self._transport.close()
        if self._file is not None:
            self._file.close()
        self.codec.close()

    def wait(self, seconds: float) -> None:
        """Return when something has come, or after so long [s]."""
        self._transport.wait(seconds)

    @property
    def trouble(self) -> str:
        """Why nothing can come or go now, for people; empty when it can."""
        return self._transport.trouble

    def poll(self, now: float, more: Callable[[], bool] = lambda: True) -> bool:
        """Take what has come, and say that we are here.

        Parameters
        ----------
        now : float
            Vehicle time [s].
        more : callable
            False when there is no time to take more.

        Returns
        -------
        bool
            Whether that was all.
        """
        done = False
        for _ in range(_MOST):
            data = self._transport.read()
            done = not data
            if done:
                break
            self._take(data, now)
            if not more():
                break
        self._greet(now)
        return done

    def _take(self, data: bytes, now: float) -> None:
        source, t = self._transport.source, self.telemetry
        if self._too_strange(source, len(data), now):
            self.unread += 1
            return
        with self._lock:
            messages = list(self.codec.read(data, whole=self._transport.datagrams))
        for message in messages:
            system = message.get_srcSystem()
            if system in (t.system, t.load_system):
                begins = system != t.system or _is_autopilot(message, t)
                if not self.sources.admit(system, source, now, begins=begins):
                    continue
            t.take(message, now)
        vehicle = self.sources.of(t.system)
        if vehicle is not None:
            self._transport.answer(vehicle)

    def _too_strange(self, source: str, size: int, now: float) -> bool:
        """Whether a stranger takes more time than there is for strangers."""
        if not self._transport.datagrams or self.sources.known(source):
            return False
        passed, self._allowed = now - self._allowed, now
        self._allowance = min(self._allowance + passed * _STRANGE, _BURST) - size
        if self.sources.of(self.telemetry.system) is None or self._allowance >= 0.0:
            return False
        self._allowance += size
        return True

    def _greet(self, now: float) -> None:
        """Say that we are here, and measure the way there and back."""
        if now - self._beat >= _BEAT:
            self._beat = now
            self.send(
                dialect.MAVLink_heartbeat_message(
                    dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0,
                    dialect.MAV_STATE_ACTIVE, 3,
                )
            )  # fmt: skip
        if now - self._sync >= _SYNC:
            self._sync = now
            self.send(dialect.MAVLink_timesync_message(0, int(now * 1e9)))

    def send(self, message: Any) -> bool:
        """Send a message; False when it could not be."""
        with self._lock:
            sent = self._transport.write(self.codec.pack(message))
        self.sent += sent
        return sent

    # ------------------------------------------------------------ what we may say

    def command(self, number: int, *values: float) -> bool:
        """Send a COMMAND_LONG; the answer is in `telemetry.acks`."""
        self.telemetry.acks.pop(number, None)
        parameters = [*values, *[0.0] * (7 - len(values))]
        if not all(map(math.isfinite, parameters)):
            raise ValueError(f"command {number} has {parameters}; allowed: finite numbers")
        return self.send(dialect.MAVLink_command_long_message(*self.target, number, 0, *parameters))

    def ask_rates(self, profile: AutopilotProfile, *, felt: bool = False) -> None:
        """Ask for the messages that we live on; with what is felt where that is listened to."""
        for message, rate in rates(profile, felt=felt).items():
            self.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / rate)

    def ask_version(self) -> None:
        """Ask which one it is; the answer is in `telemetry.uid`."""
        wanted = dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        self.command(dialect.MAV_CMD_REQUEST_MESSAGE, wanted)

    def ask_mode(self, profile: AutopilotProfile, custom_mode: int) -> None:
        """Ask for a mode; whether it was taken only a heartbeat tells."""
        self.command(dialect.MAV_CMD_DO_SET_MODE, 1.0, *profile.mode_halves(custom_mode))

    def arm(self, on: bool) -> None:
        """Ask for the motors to start or stop; never by force."""
        self.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, float(on))

    def take_off(self, height: float) -> None:
        """Ask to climb to a height [m]."""
        self.command(dialect.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height)

    def read_parameter(self, name: str) -> None:
        """Ask for a parameter; the answer is in `telemetry.parameters`."""
        self.send(
            dialect.MAVLink_param_request_read_message(*self.target, name.encode("ascii"), -1)
        )

    def set_parameter(self, profile: AutopilotProfile, name: str, value: float, kind: int) -> None:
        """Set a parameter; the answer is in `telemetry.parameters`."""
        self.send(
            dialect.MAVLink_param_set_message(
                *self.target, name.encode("ascii"), parameter_raw(profile, value, kind), kind
            )
        )


def _is_autopilot(message: Any, telemetry: Telemetry) -> bool:
    """Whether a message is an autopilot's own heartbeat: no camera's and no ground station's."""
    return bool(
        message.get_type() == "HEARTBEAT"
        and message.get_srcComponent() == telemetry.component
        and message.autopilot != dialect.MAV_AUTOPILOT_INVALID
    )
