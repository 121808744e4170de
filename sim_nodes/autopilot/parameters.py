"""The autopilot's parameters, and how they travel."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping

from iolspi_ros.errors import InputError
from sim_nodes.autopilot.firmware import LIMITS, SIMULATION, Firmware, Value

INT32, REAL32 = 6, 9
"""MAV_PARAM_TYPE."""


class Parameters:
    """Named numbers; their types never change.

    Parameters
    ----------
    firmware : Firmware
    changed : mapping of str to float
        Values other than the firmware's, from the command line.
    """

    def __init__(self, firmware: Firmware, changed: Mapping[str, float]) -> None:
        self._bytewise = firmware.bytewise
        self._values: dict[str, Value] = dict(sorted((firmware.parameters | SIMULATION).items()))
        self.names = list(self._values)
        for name, value in changed.items():
            if name not in self._values:
                raise InputError(
                    f"parameter {name} is not one of {firmware.name}'s; allowed: "
                    + ", ".join(self.names)
                )
            if not self.allows(name, value):
                low, high = LIMITS.get(name, ("any", "finite number"))
                raise InputError(f"parameter {name} is {value}; allowed: {low} to {high}")
            self[name] = value

    def __getitem__(self, name: str) -> Value:
        return self._values[name]

    def __setitem__(self, name: str, value: float) -> None:
        kind = type(self._values[name])
        self._values[name] = kind(value)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __len__(self) -> int:
        return len(self._values)

    def allows(self, name: str, value: float) -> bool:
        """Whether a parameter may have a value."""
        low, high = LIMITS.get(name, (-math.inf, math.inf))
        return math.isfinite(value) and low <= value <= high

    def encode(self, name: str) -> tuple[float, int]:
        """The number and the type that PARAM_VALUE carries."""
        value = self._values[name]
        if isinstance(value, int):
            if self._bytewise:
                return struct.unpack("<f", struct.pack("<i", value))[0], INT32
            return float(value), INT32
        return value, REAL32

    def decode(self, name: str, number: float, kind: int) -> float | None:
        """The value that a PARAM_SET carries; None where it cannot be taken."""
        if self._bytewise:
            if kind != self.encode(name)[1]:
                return None  # PX4 refuses another type
            if kind == INT32:
                number = float(struct.unpack("<i", struct.pack("<f", number))[0])
        return number if self.allows(name, number) else None
