"""What the autopilot and the load have said, with when: plain data, no decisions."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink import convert
from msg_bridge.mavlink.profiles import AutopilotProfile

Array = NDArray[np.float64]

NEVER = -math.inf

# EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS agree in these bits.
_ATTITUDE, _VELOCITY, _RELATIVE, _ABSOLUTE = 1, 2, 8, 16
_JUMP = 1.0  # of the autopilot's clock against ours [s] that is more than a slow link
_AGAIN = 0.3  # of each other [s] two differences of the clocks are the same
_FAILSAFE = (dialect.MAV_STATE_CRITICAL, dialect.MAV_STATE_EMERGENCY)
_FOLLOW = 0.02  # share of the clocks' difference that is taken over with each position
_INTEGERS = tuple(range(dialect.MAV_PARAM_TYPE_UINT8, dialect.MAV_PARAM_TYPE_INT64 + 1))


@dataclass
class Telemetry:
    """State of one autopilot as far as it was heard.

    Times are those of the caller's clock, in s; positions and velocities are ENU in the
    autopilot's local frame.

    Attributes
    ----------
    system, load_system : int
        Whose messages count; all others are only noted in `strangers`.
    uid, version : str
        Of AUTOPILOT_VERSION: its unique number, empty for none, None as long as it was not said.
    axes : ndarray of shape (3, 3)
        Ahead, to the left, and where the rotors' axis points to, a row each.
    force_boot : float
        Of its clock, when its accelerometer was last heard of [s].
    outputs : tuple of int
        Widths of pulse of its outputs from the first on [µs], as heard at `outputs_time`.
    jump_time, jump : float, str
        When its clock was last not what it was, and how.
    behind : bool
        We ourselves stood still, and have not read since all that was waiting: what comes is old.
    lost_time : float
        Since when the autopilot has said that it does not know where it is; infinite if it does.
    """

    system: int
    load_system: int
    component: int = dialect.MAV_COMP_ID_AUTOPILOT1
    autopilot: int | None = None
    mode: int = -1
    armed: bool = False
    failsafe: bool = False
    heard_time: float = NEVER
    position: Array = field(default_factory=lambda: np.full(3, np.nan))
    velocity: Array = field(default_factory=lambda: np.full(3, np.nan))
    acceleration: Array = field(default_factory=lambda: np.zeros(3))
    position_time: float = NEVER
    axes: Array = field(default_factory=lambda: np.eye(3))
    force_boot: float = math.nan
    flags: int | None = None
    lost_time: float = math.inf
    round_trips: deque[float] = field(default_factory=lambda: deque(maxlen=3))
    load_offset: Array = field(default_factory=lambda: np.full(3, np.nan))
    load_time: float = NEVER
    jump_time: float = NEVER
    jump: str = ""
    behind: bool = False
    restarts: int = 0
    boot: float = math.nan
    texts: deque[tuple[float, int, str]] = field(default_factory=lambda: deque(maxlen=50))
    acks: dict[int, tuple[float, int]] = field(default_factory=dict)
    parameters: dict[str, tuple[float, int]] = field(default_factory=dict)
    uid: str | None = None
    version: str = ""
    outputs: tuple[int, ...] = ()
    outputs_time: float = NEVER
    strangers: dict[int, int] = field(default_factory=dict)
    on_position: Callable[[Array, float], None] | None = None
    on_load: Callable[[], None] | None = None
    on_force: Callable[[Array, float, float], None] | None = None
    _globe: Any = None
    _globe_time: float = NEVER
    _skew: float = math.nan
    _skew_before: float = math.nan

    @property
    def up(self) -> Array:
        """Where the rotors' axis points to, ENU."""
        up: Array = self.axes[2]
        return up

    @property
    def ready(self) -> bool:
        """Whether the autopilot knows where it is; False as long as it has not said so."""
        if self.flags is None:
            return False
        needed = _ATTITUDE | _VELOCITY
        return bool(self.flags & needed == needed and self.flags & (_RELATIVE | _ABSOLUTE))

    @property
    def round_trip(self) -> float:
        """To the autopilot and back, the median of the last three [s]; zero when none came back."""
        return sorted(self.round_trips)[len(self.round_trips) // 2] if self.round_trips else 0.0

    def take(self, message: Any, now: float) -> bool:
        """Take a message; False when it comes from nobody who matters here."""
        system = message.get_srcSystem()
        if system == self.system:
            if message.get_srcComponent() != self.component:
                return False  # a camera, a gimbal or a companion on board
            self.heard_time = now
            handle = _OF_VEHICLE.get(message.get_type())
        elif system == self.load_system:
            handle = _OF_LOAD.get(message.get_type())
        else:
            self.strangers[system] = self.strangers.get(system, 0) + 1
            return False
        if handle is not None:
            handle(self, message, now)
        return True

    def forget(self) -> None:
        """Take nothing for granted that was heard: the autopilot may have been restarted."""
        self.autopilot, self.flags, self.lost_time = None, None, math.inf
        self.mode, self.armed = -1, False
        self.position_time = self.load_time = self.jump_time = NEVER
        self.boot = self.force_boot = self._skew = self._skew_before = math.nan
        self.round_trips.clear()
        self.acks.clear()
        self.parameters.clear()

    def texts_since(self, time: float) -> list[str]:
        """What the autopilot has told people since a time."""
        return [text for when, _, text in self.texts if when >= time]

    # ------------------------------------------------------------ of the vehicle

    def _heartbeat(self, message: Any, now: float) -> None:
        self.autopilot = message.autopilot
        self.mode = message.custom_mode
        self.armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
        self.failsafe = message.system_status in _FAILSAFE

    def _local(self, message: Any, now: float) -> None:
        position, velocity = convert.local_position(message)
        if not (np.isfinite(position).all() and np.isfinite(velocity).all()):
            return
        boot, before = message.time_boot_ms * 1e-3, self.boot
        if -1.0 < boot - before <= 0.0:
            return  # the same once more, or one that was overtaken: no news
        self._watch_clock(boot, now)
        passed = boot - before
        if 0.0 < passed < 1.0:
            change = velocity - self.velocity
            # The mean of the last few: single differences are mostly noise.
            share = min(passed / 0.1, 1.0)
            self.acceleration += share * (change / passed - self.acceleration)
            if self.on_position is not None:
                self.on_position(change, passed)
        self.position, self.velocity, self.position_time = position, velocity, now

    def _watch_clock(self, boot: float, now: float) -> None:
        """Compare the autopilot's clock with ours, and notice when it jumps."""
        skew, passed, ours = boot - now, boot - self.boot, now - self.position_time
        self.boot = boot
        change = skew - self._skew
        if math.isnan(change):
            self._skew = skew
        elif self.behind:
            return  # it came late because we did
        elif abs(change) > _JUMP:
            self.jump_time = now
            self.restarts += passed < 0.0 and boot < 60.0
            if change > 0.0 and abs(skew - self._skew_before) < _AGAIN:
                self.jump = f"what the autopilot says came {change:.1f} s late"
            elif change < 0.0 <= passed and ours > _JUMP:
                self.jump = f"the autopilot's clock stood still for {-change:.1f} s"
            else:
                self.jump = f"the autopilot's clock has jumped by {change:+.1f} s"
            self._skew_before, self._skew = self._skew, skew
        else:
            self._skew += _FOLLOW * change

    def _attitude(self, message: Any, now: float) -> None:
        if all(map(math.isfinite, (message.roll, message.pitch, message.yaw))):
            self.axes = convert.axes(message)

    def _imu(self, message: Any, now: float) -> None:
        """What pulls at it, ENU, and for how long, as far as that was heard without a gap."""
        boot, before = message.time_boot_ms * 1e-3, self.force_boot
        if -1.0 < boot - before <= 0.0:
            return  # the same once more, or one that was overtaken: no news
        self.force_boot = boot
        if self.on_force is not None:
            self.on_force(convert.felt(message) @ self.axes, boot - before, now)

    def _global(self, message: Any, now: float) -> None:
        self._globe, self._globe_time = message, now

    def _estimator(self, message: Any, now: float) -> None:
        self.flags = int(message.flags)
        if self.ready:
            self.lost_time = math.inf
        else:
            self.lost_time = min(self.lost_time, now)

    def _timesync(self, message: Any, now: float) -> None:
        passed = now - message.ts1 * 1e-9
        if message.tc1 and 0.0 <= passed < 60.0:  # else it is a question, or no answer to us
            self.round_trips.append(passed)

    def _text(self, message: Any, now: float) -> None:
        text = message.text
        if isinstance(text, bytes):
            text = text.decode("utf-8", "replace")
        self.texts.append((now, int(message.severity), text.rstrip("\0")))

    def _ack(self, message: Any, now: float) -> None:
        self.acks[int(message.command)] = (now, int(message.result))

    def _parameter(self, message: Any, now: float) -> None:
        name = message.param_id
        if isinstance(name, bytes):
            name = name.decode("ascii", "replace")
        self.parameters[name.rstrip("\0")] = (message.param_value, int(message.param_type))

    def _version(self, message: Any, now: float) -> None:
        unique = bytes(message.uid2).rstrip(b"\0") or message.uid.to_bytes(8, "big").lstrip(b"\0")
        self.uid = unique.hex()
        parts = message.flight_sw_version.to_bytes(4, "big")
        self.version = ".".join(map(str, parts[:3])) if any(parts) else ""

    def _servos(self, message: Any, now: float) -> None:
        if message.port == 0:
            self.outputs_time = now
            self.outputs = tuple(getattr(message, f"servo{k}_raw") for k in range(1, 17))

    # ------------------------------------------------------------ of the load

    def _load_global(self, message: Any, now: float) -> None:
        """Both are on the globe; the vehicle's is carried on to the time of the load's."""
        if self._globe is None or now - self._globe_time > 1.0:
            return
        moved = self.velocity * (now - self._globe_time)
        self._load_at(convert.global_offset(message, self._globe) - moved, now)

    def _load_local(self, message: Any, now: float) -> None:
        moved = self.velocity * (now - self.position_time)
        self._load_at(convert.local_position(message)[0] - self.position - moved, now)

    def _load_at(self, offset: Array, now: float) -> None:
        if not np.isfinite(offset).all():
            return
        self.load_offset, self.load_time = offset, now
        if self.on_load is not None:
            self.on_load()


_OF_VEHICLE: dict[str, Callable[[Telemetry, Any, float], None]] = {
    "HEARTBEAT": Telemetry._heartbeat,
    "LOCAL_POSITION_NED": Telemetry._local,
    "GLOBAL_POSITION_INT": Telemetry._global,
    "ATTITUDE": Telemetry._attitude,
    "SCALED_IMU": Telemetry._imu,
    "EKF_STATUS_REPORT": Telemetry._estimator,
    "ESTIMATOR_STATUS": Telemetry._estimator,
    "TIMESYNC": Telemetry._timesync,
    "STATUSTEXT": Telemetry._text,
    "COMMAND_ACK": Telemetry._ack,
    "PARAM_VALUE": Telemetry._parameter,
    "AUTOPILOT_VERSION": Telemetry._version,
    "SERVO_OUTPUT_RAW": Telemetry._servos,
}
_OF_LOAD: dict[str, Callable[[Telemetry, Any, float], None]] = {
    "GLOBAL_POSITION_INT": Telemetry._load_global,
    "LOCAL_POSITION_NED": Telemetry._load_local,
}


def parameter_value(profile: AutopilotProfile, raw: float, kind: int) -> float:
    """Value of a parameter as it travels in PARAM_VALUE."""
    if profile.integer_bytes and kind in _INTEGERS:
        return float(struct.unpack("<i", struct.pack("<f", raw))[0])
    return raw


def parameter_raw(profile: AutopilotProfile, value: float, kind: int) -> float:
    """What travels in PARAM_SET for a value; the inverse of `parameter_value`."""
    if profile.integer_bytes and kind in _INTEGERS:
        return float(struct.unpack("<f", struct.pack("<i", int(value)))[0])
    return value
