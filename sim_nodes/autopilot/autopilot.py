"""An autopilot with its vehicle, without sockets and without a clock of the machine.

Bytes come in by `receive`, time passes by `advance`, bytes go out of each link's `out`: with the
same seed and the same bytes at the same times it does the same, bit by bit.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_nodes.autopilot import telemetry
from sim_nodes.autopilot.ardupilot import ArduPilot
from sim_nodes.autopilot.body import Body
from sim_nodes.autopilot.commander import Commander
from sim_nodes.autopilot.commands import Inbox
from sim_nodes.autopilot.connection import Channel, Connection
from sim_nodes.autopilot.firmware import Firmware
from sim_nodes.autopilot.parameters import Parameters
from sim_nodes.autopilot.px4 import Px4
from sim_nodes.autopilot.release import Release
from sim_nodes.quadrotor.airframe import UTILITY, Payload

Array = NDArray[np.float64]

TICK = 0.005
"""Time in which it decides once [s]."""

LOAD_SYSTEM, LOAD_COMPONENT = 2, 35
"""Who the load is on the wire: as ArduPilot's simulated payload."""

_WANDER_UP = 0.5
"""Share of the horizontal that an estimate strays vertically; measured on PX4."""

_COMMANDERS: dict[str, type[Commander]] = {"px4": Px4, "ardupilot": ArduPilot}


class Autopilot:
    """One vehicle on the ground, just switched on.

    Parameters
    ----------
    firmware : Firmware
        Whom it imitates.
    parameters : mapping of str to float, optional
        Values other than the firmware's.
    seed : int
        Of noise, gusts, losses and delays.
    epoch : float
        Time since 1970 [s] at boot, for SYSTEM_TIME and signatures.
    key : bytes, optional
        Of signatures, 32 of them: all is signed then, and nothing else taken.
    """

    def __init__(
        self,
        firmware: Firmware,
        parameters: Mapping[str, float] | None = None,
        seed: int = 0,
        epoch: float = 1_767_225_600.0,
        key: bytes | None = None,
    ) -> None:
        self.firmware = firmware
        self.parameters = Parameters(firmware, parameters or {})
        self._seed, self._epoch, self._key = seed, epoch, key
        self._channel = Channel(np.random.default_rng([seed, 1]))
        self.links: list[Connection] = []
        self._ticks_ever = 0
        self.boots = 0
        self.boot()

    def boot(self) -> None:
        """Switch it off and on: on the ground where it began, with its parameters kept."""
        value = self.parameters
        value["SIM_CLOCK_JUMP"] = value["SIM_CUT"] = 0.0
        self._channel.cut_until = -1.0
        drag = float(value["SIM_DRAG"])
        frame = UTILITY._replace(drag_across=drag, drag_along=drag)
        payload = Payload(
            float(value["SIM_LOAD_MASS"]), float(value["SIM_LOAD_LEN"]), self.firmware.load_drag
        )
        rng = np.random.default_rng([self._seed, 0, self.boots])
        self.boots += 1
        self._ticks, self._jump = 0, 0.0
        self._actions: list[tuple[float, int, Callable[[], None]]] = []
        self._planned = 0
        self.body = Body(frame, payload, rng)
        self.commander = _COMMANDERS[self.firmware.name](
            self.firmware, self.parameters, self.body, self.say
        )
        self.release = Release(self.parameters, self.body, self.say, self.later)
        self._inbox = Inbox(self)
        self._load_due = 0.0
        for link in self.links:
            link.set_rates(self.firmware.rates)

    # ------------------------------------------------------------ its clock

    @property
    def now(self) -> float:
        """Time since boot [s]."""
        return self._ticks * TICK

    @property
    def microseconds(self) -> int:
        """Its clock since boot, as it tells it."""
        return max(0, round((self.now + self._jump) * 1e6))

    @property
    def milliseconds(self) -> int:
        """Its clock since boot, as it tells it."""
        return self.microseconds // 1000 % 2**32

    @property
    def unix_microseconds(self) -> int:
        """Its clock since 1970, as it tells it."""
        return round((self._epoch + self._ticks_ever * TICK + self._jump) * 1e6)

    @property
    def system(self) -> int:
        """Its number on the wire."""
        name = "MAV_SYS_ID" if "MAV_SYS_ID" in self.parameters else "MAV_SYSID"
        return int(self.parameters[name])

    # ------------------------------------------------------------ in

    def connect(self) -> Connection:
        """One more peer to talk with."""
        link = Connection(self._channel, len(self.links), self.firmware.rates)
        if self._key is not None:
            link.sign(self._key, self.unix_microseconds * 1e-6)
        self.links.append(link)
        return link

    def receive(self, link: Connection, data: bytes) -> None:
        """Take a datagram."""
        self._update_channel()
        for message in link.receive(data, self.now):
            self._inbox.take(message, link)

    def change(self, name: str, value: float) -> None:
        """Set a parameter, and do what it stands for."""
        self.parameters[name] = value
        if name == "SIM_CUT":
            self._channel.cut_until = self.now + value
        elif name == "SIM_CLOCK_JUMP":
            self._jump += value

    def sign(self, key: bytes) -> None:
        """Sign from now on, or no more with a key of zeros."""
        self._key = key if any(key) else None
        for link in self.links:
            link.sign(self._key, self.unix_microseconds * 1e-6)

    # ------------------------------------------------------------ out

    def send(self, message: Any, link: Connection | None = None) -> None:
        """Send to one peer, or to all."""
        for peer in self.links if link is None else [link]:
            peer.send(message, self.system, 1, self.now)

    def say(self, severity: int, text: str) -> None:
        """STATUSTEXT, cut to the length that one message holds."""
        self.send(mavlink.MAVLink_statustext_message(severity, text.encode()[:50]))

    def later(self, delay: float, action: Callable[[], None]) -> None:
        """Do something after a time [s]."""
        self._planned += 1
        heapq.heappush(self._actions, (self.now + delay, self._planned, action))

    # ------------------------------------------------------------ time passes

    def advance(self, duration: float) -> None:
        """Live for some time [s], whole ticks."""
        for _ in range(round(duration / TICK)):
            if self.commander.aborted:
                return
            self._tick()

    def _tick(self) -> None:
        self._ticks += 1
        self._ticks_ever += 1
        now = self.now
        self._update_channel()
        for link in self.links:
            for message in link.arrived(now):
                self._inbox.take(message, link)
        while self._actions and self._actions[0][0] <= now:
            heapq.heappop(self._actions)[2]()
        self.commander.tick(now)
        self.body.believe(self._deviation(), self.commander.drift, TICK)
        target, motors, level = self.commander.steer()
        self.body.move(target, self.commander.gains(), motors, level, self._wind(), TICK)
        for link in self.links:
            self._tell(link)
        self._tell_of_load()

    def _deviation(self) -> Array:
        """Of the estimate's position and velocity: its own, in flight, and what a test adds."""
        added = float(self.parameters["SIM_NOISE"]) * np.array([[1.0], [0.5]])
        wander = float(self.parameters["SIM_WANDER"]) * self.commander.airborne
        own = wander * np.outer(self.firmware.wander, (1.0, 1.0, _WANDER_UP))
        return np.hypot(own, added)

    def _wind(self) -> Any:
        speed = float(self.parameters["SIM_WIND_SPD"])
        comes = math.radians(float(self.parameters["SIM_WIND_DIR"]))
        gusts = float(self.parameters["SIM_WIND_TURB"])
        return np.array([-speed * math.cos(comes), -speed * math.sin(comes), 0.0, gusts])

    def _update_channel(self) -> None:
        self._channel.delay = float(self.parameters["SIM_DELAY"])
        self._channel.loss = float(self.parameters["SIM_LOSS"])

    def _tell(self, link: Connection) -> None:
        for name in link.due(self.now):
            message = telemetry.BUILDERS[name](self)
            if message is not None:
                link.send(message, self.system, 1, self.now)

    def _tell_of_load(self) -> None:
        rate = float(self.parameters["SIM_LOAD_RATE"])
        if rate <= 0.0 or self.now < self._load_due - 1e-9:
            return
        first = int(self._load_due) != int(self._load_due + 1.0 / rate)
        self._load_due = max(self._load_due + 1.0 / rate, self.now)
        messages = [telemetry.global_position(self.milliseconds, *self.body.load, 65535)]
        if first:
            messages.append(mavlink.MAVLink_heartbeat_message(7, 8, 0, 0, 0, 3))
        for link in self.links:
            for message in messages:
                link.send(message, LOAD_SYSTEM, LOAD_COMPONENT, self.now)
