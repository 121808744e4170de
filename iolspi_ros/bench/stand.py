"""A link to one autopilot that is flown to be measured: setpoints go out, all that it says is kept.

It is the bridge's own link, and all times are the vehicle's: the same measures the embedded
autopilot in memory and a real one on a socket.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.errors import InputError
from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.clock import Clock
from msg_bridge.mavlink.convert import Track, local_position, tilt
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.setpoints import PositionSetpoint, Setpoint, packet
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import Transport

Array = NDArray[np.float64]
HEIGHT = 5.0
"""At which it flies, unless told otherwise [m]."""
_RATE = 50.0  # of setpoints and measurements [Hz]
_TRACK = Track()


@dataclass
class Ears(Telemetry):
    """Telemetry that forgets nothing: (time, message) of all that the vehicle said."""

    heard: list[tuple[float, Any]] = field(default_factory=list)

    def take(self, message: Any, now: float) -> bool:
        """Take a message, and keep it."""
        if message.get_srcSystem() == self.system:
            self.heard.append((now, message))
        return super().take(message, now)


@dataclass(frozen=True)
class Motion:
    """What was heard of a vehicle's motion; times [s] count from the first setpoint.

    Attributes
    ----------
    time : ndarray of shape (n,)
    position, velocity : ndarray of shape (n, 3)
        ENU [m], [m/s].
    tilt_time, tilt : ndarray of shape (m,)
        [s], [rad].
    """

    time: Array
    position: Array
    velocity: Array
    tilt_time: Array
    tilt: Array

    def speed(self, since: float, until: float) -> float:
        """Mean speed eastwards between two times [m/s]."""
        return float(self.velocity[(self.time >= since) & (self.time <= until), 0].mean())


class Stand:
    """One autopilot on its link.

    Parameters
    ----------
    transport : Transport
    clock : Clock
        The vehicle's.
    system : int
    patience : float
        Until a vehicle that was just switched on can be armed [s].
    log : Path, optional
        A .tlog of all that is said.
    """

    def __init__(
        self,
        transport: Transport,
        clock: Clock,
        system: int = 1,
        patience: float = 90.0,
        log: Path | None = None,
    ) -> None:
        self.clock, self.patience = clock, patience
        self.ears = Ears(system, 0)
        self.link = AutopilotLink(transport, self.ears, log=log)
        self.profile = profiles.PAPARAZZI

    @property
    def controlled(self) -> bool:
        """Whether it shows the mode in which it obeys setpoints."""
        return self.ears.mode == self.profile.controlled

    # ------------------------------------------------------------ time

    def listen(self, seconds: float) -> None:
        """Wait for something to come, for so long at most [s]."""
        self.link.wait(self.clock.wall(seconds))
        self.link.poll(self.clock.now())

    def listen_for(self, seconds: float) -> None:
        """Listen for so long [s]."""
        end = self.clock.now() + seconds
        while self.clock.now() < end:
            self.listen(0.005)

    def until(
        self,
        ready: Callable[[], bool],
        patience: float,
        what: str,
        setpoint: Callable[[float], Setpoint | None] | None = None,
        ask: Callable[[], object] | None = None,
    ) -> float:
        """Time until something is so [s], streaming setpoints and asking once a second.

        Raises
        ------
        InputError
            When it never is.
        """
        start = due = asked = self.clock.now()
        while not ready():
            now = self.clock.now()
            if now - start > patience:
                texts = "; ".join(text for _, _, text in list(self.ears.texts)[-3:])
                raise InputError(f"no {what} within {patience:g} s; it said: {texts or 'nothing'}")
            if ask is not None and now >= asked:
                asked = now + 1.0
                ask()
            if setpoint is not None and now >= due:
                due = max(due + 1.0 / _RATE, now)
                wanted = setpoint(now - start)
                if wanted is not None:
                    self.send(wanted)
            self.listen(0.005)
        return self.clock.now() - start

    def send(self, wanted: Setpoint) -> None:
        """Send a setpoint."""
        self.link.send(packet(wanted, self.profile, _TRACK, self.link.target, self.clock.now()))

    def fly(self, seconds: float, setpoint: Callable[[float], Setpoint | None] | None) -> Motion:
        """Stream setpoints for some time; None is a silence."""
        start, first = self.clock.now(), len(self.ears.heard)
        self.until(lambda: self.clock.now() - start >= seconds, seconds + 60.0, "end", setpoint)
        return self.motion(start, first)

    def motion(self, start: float, first: int) -> Motion:
        """What was heard since message number `first`, on the vehicle's own stamps."""
        places, angles = [], []
        for now, message in self.ears.heard[first:]:
            kind = message.get_type()
            if kind == "LOCAL_POSITION_NED":
                places.append(
                    (now, message.time_boot_ms * 1e-3, *np.ravel(local_position(message)))
                )
            elif kind == "ATTITUDE":
                angles.append((now, message.time_boot_ms * 1e-3, tilt(message)))
        if not places or not angles:
            raise InputError("no LOCAL_POSITION_NED or ATTITUDE came while it flew")
        place, angle = np.array(places), np.array(angles)
        # Stamps are exact, arrival is not: the least delay of all tells how both clocks stand.
        skew = np.min(place[:, 0] - place[:, 1]) - start
        return Motion(
            place[:, 1] + skew, place[:, 2:5], place[:, 5:8], angle[:, 1] + skew, angle[:, 2]
        )

    def of(self, kind: str, first: int = 0) -> Iterator[tuple[float, Any]]:
        """Time and message of all of a kind since message number `first`."""
        return (pair for pair in self.ears.heard[first:] if pair[1].get_type() == kind)

    # ------------------------------------------------------------ to fly

    def stay(self, height: float = HEIGHT) -> Callable[[float], Setpoint]:
        """Hold the place above the take-off point."""
        return lambda _: PositionSetpoint(0.0, 0.0, height)

    def back(self, height: float = HEIGHT) -> None:
        """Fly back and come to rest, as far as the estimate allows."""

        def there() -> bool:
            t = self.ears
            away = float(np.linalg.norm(t.position - (0.0, 0.0, height)))
            return away < 0.6 and float(np.linalg.norm(t.velocity)) < 0.5

        self.until(there, 60.0, "return to the start", self.stay(height))
        self.fly(2.0, self.stay(height))

    def interval(self, message: int, rate: float) -> None:
        """Ask for a message [Hz]."""
        self.link.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, message, 1e6 / rate)
