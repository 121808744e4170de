"""Messages of a known shape as bytes: CDR, little-endian, as every DDS speaks it (OMG DDSI-RTPS).

rclpy turns a message into bytes field by field, which costs a control loop more than the vehicle
does. Here the bytes that never change are made once.
"""

from __future__ import annotations

import array
import struct
from collections.abc import Sequence
from typing import Literal

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_START = len(_LITTLE_ENDIAN)
_ORDER: Literal["little"] = "little"


class _Template:
    """Bytes of a message, and which of them are the same in every message of this shape.

    What fills the gaps before aligned values is nobody's: some leave there what was in memory.
    """

    def __init__(self) -> None:
        self.data = bytearray(_LITTLE_ENDIAN)
        self._fixed = bytearray(b"\xff" * _START)

    def _put(self, data: bytes, size: int, *, fixed: bool = True) -> int:
        """Append values aligned to their size; the place of the first."""
        gap = -(len(self.data) - _START) % size
        self.data += bytes(gap) + data
        self._fixed += bytes(gap) + (b"\xff" if fixed else b"\x00") * len(data)
        return len(self.data) - len(data)

    def whole(self, *values: int, fixed: bool = True) -> None:
        """Unsigned integers of 32 bits."""
        self._put(struct.pack(f"<{len(values)}I", *values), 4, fixed=fixed)

    def text(self, value: str) -> None:
        """A string."""
        encoded = value.encode() + b"\0"
        self.whole(len(encoded))
        self._put(encoded, 1)

    def doubles(self, count: int) -> int:
        """A sequence of so many doubles that may be anything; the place of the first."""
        self.whole(count)
        return self._put(bytes(8 * count), 8, fixed=False) if count else len(self.data)

    def close(self) -> None:
        """Nothing more is appended."""
        self._mask = int.from_bytes(self._fixed, _ORDER)
        self._same = int.from_bytes(self.data, _ORDER) & self._mask

    def fits(self, data: bytes) -> bool:
        """Whether a message has this shape."""
        n = len(self.data)
        return len(data) >= n and int.from_bytes(data[:n], _ORDER) & self._mask == self._same


class RowBytes:
    """A std_msgs/Float64MultiArray with one dimension.

    Parameters
    ----------
    label : str
    count : int
    """

    def __init__(self, label: str, count: int) -> None:
        self._template = template = _Template()
        template.whole(1)
        template.text(label)
        template.whole(count, count, 0)
        self._place, self._size = template.doubles(count), 8 * count
        template.close()
        self._head = bytes(template.data[: self._place])

    def pack(self, values: array.array[float]) -> bytes:
        """Bytes of a message."""
        return self._head + values.tobytes()

    def unpack(self, data: bytes) -> array.array[float] | None:
        """The values; None when it is of another shape."""
        if not self._template.fits(data):
            return None
        values = array.array("d")
        values.frombytes(data[self._place : self._place + self._size])
        return values


class JointStateBytes:
    """A sensor_msgs/JointState without frame and efforts.

    Parameters
    ----------
    joints : sequence of str
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._template = template = _Template()
        template.whole(0, 0, fixed=False)
        template.text("")
        template.whole(len(joints))
        for joint in joints:
            template.text(joint)
        n = len(joints)
        self._position, self._velocity = template.doubles(n), template.doubles(n)
        template.doubles(0)
        template.close()
        self._doubles = struct.Struct(f"<{n}d")

    def pack(
        self, sec: int, nanosec: int, position: Sequence[float], velocity: Sequence[float]
    ) -> bytes:
        """Bytes of a message."""
        data = self._template.data
        struct.pack_into("<iI", data, _START, sec, nanosec)
        self._doubles.pack_into(data, self._position, *position)
        self._doubles.pack_into(data, self._velocity, *velocity)
        return bytes(data)

    def unpack(self, data: bytes) -> tuple[int, int, tuple[float, ...], tuple[float, ...]] | None:
        """Stamp, positions and velocities; None when it is of another shape."""
        if not self._template.fits(data):
            return None
        sec, nanosec = struct.unpack_from("<iI", data, _START)
        position = self._doubles.unpack_from(data, self._position)
        return sec, nanosec, position, self._doubles.unpack_from(data, self._velocity)
