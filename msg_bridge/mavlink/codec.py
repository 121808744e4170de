"""MAVLink 2 packets: made, signed, checked and kept in a .tlog."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.signing import StampBook, Stream

KEY_SIZE = 32  # of a signing key [bytes] (MAVLink 2, packet signing)
_MICRO = 1_000_000


class _Parser(dialect.MAVLink):  # type: ignore[misc]
    """pymavlink's parser, with stamps from a book that outlives it."""

    book = StampBook()
    stale = 0

    def check_signature(self, packet: bytearray, system: int, component: int) -> bool:
        """Whether a packet is signed with our key and newer than those before it."""
        stream = Stream(packet[-13], system, component)
        stamp = int.from_bytes(packet[-12:-6], "little")
        if not self.book.fresh(stream, stamp):
            self.stale += 1
            return False
        # The library keeps the stamp of any packet, also of a forged one: it begins anew each time.
        self.signing.stream_timestamps.clear()
        self.signing.timestamp = 0
        if not super().check_signature(packet, system, component):
            return False
        self.book.take(stream, stamp)
        return True


class Codec:
    """Turns messages into packets and what has come into messages.

    Parameters
    ----------
    system, component : int
        Who we are.
    key : bytes, optional
        Of 32 bytes: sign what goes out, and drop what comes unsigned or wrongly signed.
    log : BinaryIO, optional
        A .tlog: each packet behind its time, eight bytes of microseconds since 1970, big-endian.
    book : StampBook, optional
        Of the key's stamps, for all links that have it; one of its own by default.
    """

    def __init__(
        self,
        system: int,
        component: int,
        key: bytes | None = None,
        log: BinaryIO | None = None,
        book: StampBook | None = None,
    ) -> None:
        self._parser = _Parser(None, srcSystem=system, srcComponent=component)
        self._parser.robust_parsing = True
        self._log = log
        self._book = self._parser.book = StampBook() if book is None else book
        self._us = Stream(0, system, component)
        if key is not None:
            signing = self._parser.signing
            signing.secret_key, signing.sign_outgoing = key, True
        self.received = 0
        self.rejected = 0
        """Broken, unsigned or wrongly signed packets, and bytes that are none."""

    @property
    def stale(self) -> int:
        """Packets that were played back, or came very late."""
        return self._parser.stale

    def close(self) -> None:
        """Write down which stamps were seen."""
        self._book.save()

    def pack(self, message: Any) -> bytes:
        """Packet of a message."""
        if self._parser.signing.sign_outgoing:
            self._parser.signing.timestamp = self._book.next(self._us)
        data = bytes(message.pack(self._parser))
        self._parser.seq = (self._parser.seq + 1) % 256
        self._keep(data)
        return data

    def read(self, data: bytes, *, whole: bool = False) -> Iterator[Any]:
        """Messages that bytes complete; what is no good packet is counted and dropped.

        Parameters
        ----------
        data : bytes
        whole : bool
            They are whole packets: what is left of those before is forgotten, so that a broken
            one cannot swallow the next.
        """
        if whole and self._parser.buf_len():
            self._parser.buf, self._parser.buf_index = bytearray(), 0
            self._parser.expected_length = dialect.HEADER_LEN_V1 + 2
            self.rejected += 1
        for message in self._parser.parse_buffer(data) or ():
            kind = message.get_type()
            if kind == "BAD_DATA":
                self.rejected += 1
            elif not kind.startswith("UNKNOWN"):
                self.received += 1
                self._keep(bytes(message.get_msgbuf()))
                yield message

    def _keep(self, packet: bytes) -> None:
        if self._log is not None:
            self._log.write(struct.pack(">Q", int(time.time() * _MICRO)) + packet)


def read_key(path: Path) -> bytes:
    """Signing key in a file: 64 hexadecimal digits, or 32 bytes as they are.

    Raises
    ------
    InputError
        When the file holds neither.
    """
    try:
        content = path.expanduser().read_bytes()
    except OSError as error:
        raise InputError(f"signing key {path}: {error.strerror}") from error
    if len(content) == KEY_SIZE:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != KEY_SIZE:
        raise InputError(
            f"signing key {path} holds {len(content)} bytes that are no key; allowed: "
            f"{2 * KEY_SIZE} hexadecimal digits or {KEY_SIZE} bytes"
        )
    return key
