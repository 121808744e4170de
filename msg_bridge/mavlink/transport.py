"""Bytes to one autopilot and back: UDP, TCP or a serial line, and nobody else."""

from __future__ import annotations

import contextlib
import select
import socket
from typing import Any, Protocol

from iolspi_ros.errors import InputError
from msg_bridge.mavlink import urls

_SIZE = 65_535  # of the largest UDP datagram [bytes]


class Transport(Protocol):
    """A way to one autopilot. Nothing blocks but `wait`; nothing raises when it is gone."""

    datagrams: bool
    """What is read at once are whole packets."""

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        ...

    def read(self) -> bytes:
        """What has come; empty when nothing has."""
        ...

    def write(self, data: bytes) -> bool:
        """Send; False when it cannot be sent now."""
        ...

    def keep(self) -> None:
        """The last thing read came from the autopilot: answer there."""
        ...

    def close(self) -> None:
        """Let the address go."""
        ...


class Udp:
    """A UDP socket that talks to one address.

    Calling, the address is the one given and the kernel drops datagrams from others. Listening,
    it is that of the first sender that turned out to be the autopilot (`keep`); a later one is
    taken only from the same host, which is where an autopilot that was restarted comes from.

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
        self._peer: tuple[str, int] | None = None
        self._sender: tuple[str, int] | None = None
        self._listening = listen
        try:
            if listen:
                self._socket.bind((host, port))
            else:
                self._socket.connect((host, port))
        except OSError as error:
            self._socket.close()
            raise InputError(f"url {host}:{port}: {error.strerror or error}") from error
        self._socket.setblocking(False)

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        select.select([self._socket], [], [], max(seconds, 0.0))

    def read(self) -> bytes:
        """One datagram; empty when there is none."""
        try:
            data, sender = self._socket.recvfrom(_SIZE)
        except OSError:  # nothing there, or nobody listens at the other end
            return b""
        if self._listening:
            if self._peer is not None and sender[0] != self._peer[0]:
                return b""
            self._sender = sender
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

    def keep(self) -> None:
        """Answer to the sender of the last datagram."""
        self._peer = self._sender

    def close(self) -> None:
        """Let the port go."""
        self._socket.close()


class Tcp:
    """A TCP connection that is made again when it breaks."""

    datagrams = False

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self._socket: socket.socket | None = None
        self._connected = False

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        if self._socket is None:
            self._connect()
        ends = [] if self._socket is None else [self._socket]
        readable, writable = (ends, []) if self._connected else ([], ends)
        select.select(readable, writable, [], max(seconds, 0.0))

    def read(self) -> bytes:
        """What has come."""
        if self._socket is None or not self._ready():
            return b""
        try:
            data = self._socket.recv(_SIZE)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.close()
        return data

    def write(self, data: bytes) -> bool:
        """Send; a packet that does not fit whole breaks the connection, to keep packets whole."""
        if self._socket is None or not self._ready():
            return False
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            return False
        except OSError:
            sent = -1
        if sent != len(data):
            self.close()
            return False
        return True

    def keep(self) -> None:
        """Nothing to choose: a connection has two ends."""

    def close(self) -> None:
        """Break the connection."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False

    def _connect(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):  # it goes on in the background
            self._socket.connect(self._address)

    def _ready(self) -> bool:
        if self._connected or self._socket is None:
            return self._connected
        _, writable, _ = select.select([], [self._socket], [], 0.0)
        if not writable:
            return False
        if self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.close()  # refused; the next `wait` tries again
            return False
        self._connected = True
        return True


class Serial:
    """A serial line."""

    datagrams = False

    def __init__(self, device: str, baud: int) -> None:
        import serial  # pyserial

        try:
            self._line: Any = serial.Serial(device, baud, timeout=0.0, write_timeout=0.0)
        except (serial.SerialException, ValueError) as error:
            raise InputError(f"url serial:{device}:{baud}: {error}") from error
        self._gone: Any = serial.SerialException

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        select.select([self._line], [], [], max(seconds, 0.0))

    def read(self) -> bytes:
        """What has come."""
        try:
            return bytes(self._line.read(_SIZE))
        except (self._gone, OSError):
            return b""

    def write(self, data: bytes) -> bool:
        """Send."""
        try:
            return bool(self._line.write(data) == len(data))
        except (self._gone, OSError):
            return False

    def keep(self) -> None:
        """Nothing to choose: a line has two ends."""

    def close(self) -> None:
        """Let the device go."""
        self._line.close()


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
