"""What an autopilot is for the parts that speak for it."""

from __future__ import annotations

from typing import Any, Protocol

from sim_nodes.autopilot.body import Body
from sim_nodes.autopilot.commander import Commander
from sim_nodes.autopilot.connection import Connection
from sim_nodes.autopilot.firmware import Firmware
from sim_nodes.autopilot.parameters import Parameters
from sim_nodes.autopilot.release import Release


class State(Protocol):
    """What can be told of it: `telemetry` makes messages of this."""

    firmware: Firmware
    body: Body
    commander: Commander
    release: Release
    parameters: Parameters

    @property
    def microseconds(self) -> int:
        """Its clock since boot."""
        ...

    @property
    def milliseconds(self) -> int:
        """The same."""
        ...

    @property
    def unix_microseconds(self) -> int:
        """Its clock since 1970."""
        ...


class Onboard(State, Protocol):
    """What it can be told to do: `commands` does it."""

    @property
    def now(self) -> float:
        """Time since boot [s]."""
        ...

    @property
    def system(self) -> int:
        """Its number on the wire."""
        ...

    def say(self, severity: int, text: str) -> None:
        """Tell people."""
        ...

    def send(self, message: Any, link: Connection | None = None) -> None:
        """Send to one peer, or to all."""
        ...

    def change(self, name: str, value: float) -> None:
        """Set a parameter, and do what it stands for."""
        ...

    def sign(self, key: bytes) -> None:
        """Sign from now on."""
        ...

    def boot(self) -> None:
        """Switch it off and on."""
        ...
