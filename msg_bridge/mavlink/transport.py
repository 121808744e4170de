"""Bytes to one autopilot and back: UDP, TCP or a serial line, and nobody else."""

from __future__ import annotations

import select
import socket
from typing import Protocol

from iolspi_ros.errors import InputError
from msg_bridge.mavlink import urls
from msg_bridge.mavlink.streams import Serial, Tcp

_LARGEST = 4096  # datagram that is looked into [bytes]: autopilots send at most 1,500
_BUFFER = 1 << 20  # of what has come and is not read yet [bytes], as far as the system lets us
_GLANCE = 64  # datagrams dropped before whoever reads may do something else


class Transport(Protocol):
    """A way to one autopilot. Nothing blocks but `wait`; nothing raises when it is gone.

    Attributes
    ----------
    datagrams : bool
        What is read at once are whole packets.
    source : str
        Where the last thing read came from.
    trouble : str
        Why nothing can come or go now, for people; empty when it can.
    """

    datagrams: bool
    source: str
    trouble: str

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        ...

    def read(self) -> bytes:
        """What has come; empty when nothing has."""
        ...

    def write(self, data: bytes) -> bool:
        """Send; False when it cannot be sent now."""
        ...

    def answer(self, source: str) -> None:
        """Send there from now on, where there is a choice."""
        ...

    def close(self) -> None:
        """Let the address go."""
        ...


class Udp:
    """A UDP socket that sends to one address.

    Calling, that is the one given, and the kernel drops datagrams from others. Listening, it is
    the one chosen with `answer`, and nothing is sent before; datagrams from other hosts are
    then dropped.

    Parameters
    ----------
    host : str
    port : int
    listen : bool
        Wait at the address rather than call it.
    """

    datagrams = True

    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._peer: tuple[str, int] | None = None
        self._listening = listen
        self.source, self.trouble = f"{host}:{port}", ""
        self.dropped = 0
        """Datagrams from other hosts, and those that are too large to be packets."""
        try:
            if listen:
                self._socket.bind((host, port))
            else:
                self._socket.connect((host, port))
        except (OSError, UnicodeError) as error:
            self._socket.close()
            why = getattr(error, "strerror", None) or error
            raise InputError(f"url {host}:{port}: {why}") from error
        self._socket.setblocking(False)

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        select.select([self._socket], [], [], max(seconds, 0.0))

    def read(self) -> bytes:
        """One datagram; empty when there is none."""
        while True:
            try:
                data, sender = self._socket.recvfrom(_LARGEST + 1)
            except OSError:  # nothing there, or nobody listens at the other end
                return b""
            foreign = self._listening and self._peer is not None and sender[0] != self._peer[0]
            if foreign or not 0 < len(data) <= _LARGEST:
                self.dropped += 1
                if self.dropped % _GLANCE == 0:
                    return b""  # who floods us keeps nobody from sending
                continue
            if self._listening:
                self.source = f"{sender[0]}:{sender[1]}"
            return data

    def write(self, data: bytes) -> bool:
        """Send a datagram, when it is known where to."""
        try:
            if not self._listening:
                self._socket.send(data)
            elif self._peer is not None:
                self._socket.sendto(data, self._peer)
            else:
                return False
        except OSError:
            return False
        return True

    def answer(self, source: str) -> None:
        """Send there from now on."""
        host, _, port = source.rpartition(":")
        self._peer = (host, int(port))

    def close(self) -> None:
        """Let the port go."""
        self._socket.close()


def open_url(url: str) -> Transport:
    """The transport that a URL means.

    Raises
    ------
    InputError
        When it means none, or the address cannot be had.
    """
    kind, place, number = urls.parse(url)
    if kind == "serial":
        return Serial(place, number)
    if kind == "tcp":
        return Tcp(place, number)
    return Udp(place, number, listen=kind == "udpin")
