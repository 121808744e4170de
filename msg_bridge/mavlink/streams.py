"""Ways to an autopilot that may break and are opened again: TCP connections and serial lines."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable
from typing import Any

from iolspi_ros.errors import InputError

_SIZE = 4096  # read at once [bytes]
_FIRST, _LONGEST = 0.1, 5.0  # wait before it is opened again, doubled each time up to [s]
_CONNECTING = 5.0  # a connection that takes longer is begun anew [s]
_UNANSWERED = 5000  # what nobody acknowledges for so long breaks a connection [ms]


class BackOff:
    """When something that failed may be tried again: later each time, up to a limit."""

    def __init__(self) -> None:
        self._pause, self._due = _FIRST, 0.0

    def failed(self) -> None:
        """It failed just now."""
        self._due = time.monotonic() + self._pause
        self._pause = min(2.0 * self._pause, _LONGEST)

    def worked(self) -> None:
        """It works: the next failure is the first again."""
        self._pause = _FIRST

    @property
    def left(self) -> float:
        """Until it may be tried [s]; zero when it may."""
        return max(self._due - time.monotonic(), 0.0)


class Tcp:
    """A TCP connection that is made again when it breaks.

    Parameters
    ----------
    host : str
    port : int
    """

    datagrams = False

    def __init__(self, host: str, port: int) -> None:
        self.source = f"{host}:{port}"
        try:
            self._address = socket.getaddrinfo(host, port, socket.AF_INET)[0][4]
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(f"url tcp:{self.source}: {why}") from error
        self.trouble = f"nobody has answered yet at tcp:{self.source}"
        self._socket: socket.socket | None = None
        self._connected = False
        self._begun = 0.0
        self._back_off = BackOff()

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        seconds = max(seconds, 0.0)
        if self._socket is None and not self._back_off.left:
            self._connect()
        if self._socket is None:
            time.sleep(min(seconds, self._back_off.left))
            return
        ends = [self._socket]
        readable, writable = (ends, []) if self._connected else ([], ends)
        select.select(readable, writable, [], seconds)
        self._ready()

    def read(self) -> bytes:
        """What has come."""
        if not self._ready() or self._socket is None:
            return b""
        try:
            data = self._socket.recv(_SIZE)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._lost("has broken")
        return data

    def write(self, data: bytes) -> bool:
        """Send; a packet that does not fit whole breaks the connection, to keep packets whole."""
        if not self._ready() or self._socket is None:
            return False
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            return False
        except OSError:
            sent = -1
        if sent != len(data):
            self._lost("has broken")
            return False
        return True

    def answer(self, source: str) -> None:
        """Nothing to choose: a connection has two ends."""

    def close(self) -> None:
        """Break the connection."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self._connected = None, False

    def _lost(self, how: str) -> None:
        self.close()
        self._back_off.failed()
        self.trouble = f"the connection to tcp:{self.source} {how}; it is tried again"

    def _connect(self) -> None:
        self._begun = time.monotonic()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with contextlib.suppress(OSError, AttributeError):  # Linux: a peer that vanished
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNANSWERED)
        self._socket.setblocking(False)
        with contextlib.suppress(BlockingIOError):  # it goes on in the background
            try:
                self._socket.connect(self._address)
            except BlockingIOError:
                raise
            except OSError:  # no such host, or refused at once
                self._lost("is refused")

    def _ready(self) -> bool:
        if self._connected or self._socket is None:
            return self._connected
        _, writable, _ = select.select([], [self._socket], [], 0.0)
        if not writable:
            if time.monotonic() - self._begun > _CONNECTING:
                self._lost("is not answered")
            return False
        if self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self._lost("is refused")
            return False
        self._connected, self.trouble = True, ""
        self._back_off.worked()
        return True


class Serial:
    """A serial line that is opened again when it was pulled.

    Parameters
    ----------
    device : str
    baud : int

    Raises
    ------
    InputError
        When it cannot be opened at first.
    """

    datagrams = False

    def __init__(self, device: str, baud: int) -> None:
        import serial  # pyserial

        make: Any = serial.Serial
        self._make: Callable[[], Any] = lambda: make(device, baud, timeout=0.0, write_timeout=0.0)
        self._gone = (serial.SerialException, OSError, ValueError, TypeError)
        self._line: Any = None
        self._back_off = BackOff()
        self.source, self.trouble = device, ""
        try:
            self._line = self._make()
        except (serial.SerialException, ValueError) as error:
            raise InputError(f"url serial:{device}:{baud}: {error}") from error

    def wait(self, seconds: float) -> None:
        """Return when something can be read, or after so long [s]."""
        seconds = max(seconds, 0.0)
        if self._line is None and not self._back_off.left:
            self._open()
        if self._line is None:
            time.sleep(min(seconds, self._back_off.left))
            return
        try:
            select.select([self._line], [], [], seconds)
        except self._gone:
            self._lost()

    def read(self) -> bytes:
        """What has come."""
        if self._line is None:
            return b""
        try:
            # A line that was pulled can be read, and raises when it is.
            data = bytes(self._line.read(_SIZE))
        except self._gone:
            self._lost()
            return b""
        if data:
            self._back_off.worked()
        return data

    def write(self, data: bytes) -> bool:
        """Send."""
        if self._line is None:
            return False
        try:
            return bool(self._line.write(data) == len(data))
        except Exception as error:
            if type(error).__name__ != "SerialTimeoutException":  # its buffer is full, no more
                self._lost()
            return False

    def answer(self, source: str) -> None:
        """Nothing to choose: a line has two ends."""

    def close(self) -> None:
        """Let the device go."""
        if self._line is not None:
            with contextlib.suppress(*self._gone):
                self._line.close()
        self._line = None

    def _open(self) -> None:
        try:
            self._line = self._make()
            self.trouble = ""
        except self._gone:
            self._back_off.failed()

    def _lost(self) -> None:
        self.close()
        self._back_off.failed()
        self.trouble = f"the serial line {self.source} is gone; it is opened again when it is back"
