"""The embedded autopilot on real sockets and on the machine's clock."""

from __future__ import annotations

import dataclasses
import selectors
import socket
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

from iolspi_ros.errors import InputError
from sim_nodes.autopilot.autopilot import TICK, Autopilot
from sim_nodes.autopilot.connection import Connection
from sim_nodes.autopilot.firmware import find_firmware

_BEHIND = 0.25  # wall time that is caught up with; more is left out [s]
_LOOK = 0.002  # shortest sleep [s]
_BATCH = 64  # datagrams taken before time goes on


class Port:
    """A UDP socket for one link.

    Parameters
    ----------
    url : str
        `udpout:HOST:PORT` sends there from the beginning; `udpin:HOST:PORT` waits there (0 for any
        free port) and answers whoever spoke last.

    Raises
    ------
    InputError
        When the URL is none of these, or the port is taken.
    """

    def __init__(self, url: str) -> None:
        kind, _, rest = url.partition(":")
        host, _, number = rest.rpartition(":")
        allowed = "allowed: udpout:HOST:PORT or udpin:HOST:PORT"
        if kind not in ("udpout", "udpin") or not host or not number.isdecimal():
            raise InputError(f"--url is {url!r}; {allowed}")
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._peer: tuple[str, int] | None = None
        self._listens = kind == "udpin"
        try:
            if self._listens:
                self.socket.bind((host, int(number)))
            else:
                self._peer = (socket.gethostbyname(host), int(number))
                self.socket.connect(self._peer)
        except (OSError, OverflowError) as error:
            self.socket.close()
            raise InputError(f"--url {url}: {error}; {allowed}") from error
        self.address = self.socket.getsockname()
        """Host and port of this end."""

    def receive(self) -> bytes | None:
        """A datagram, None where none waits."""
        try:
            data, sender = self.socket.recvfrom(65536)
        except BlockingIOError:
            return None
        except ConnectionRefusedError:
            return b""  # nobody listens at the other end yet
        if self._listens:
            self._peer = sender
        return data

    def send(self, data: bytes) -> None:
        """Send a datagram, if there is somebody; what does not go is lost, as on any link."""
        if self._peer is None:
            return
        try:
            if self._listens:
                self.socket.sendto(data, self._peer)
            else:
                self.socket.send(data)
        except OSError:
            pass


class Sitl:
    """An embedded autopilot that runs in a thread of its own; a context manager.

    Its clock goes `SIM_SPEEDUP` times as fast as the machine's (0 stands still), and slower where
    the machine cannot. `lock` is held while it works: take it to look at `autopilot`, whose
    `body.truth` is the truth.

    Parameters
    ----------
    like : str
        px4 or ardupilot.
    urls : sequence of str
        See `Port`; `addresses` says where each really is.
    parameters : mapping of str to float, optional
        Values other than the firmware's, from boot on.
    seed : int
    key : bytes, optional
        Of MAVLink signatures, 32 of them.
    ready_after : float, optional
        Time after boot until it can be armed [s], instead of the firmware's.
    """

    def __init__(
        self,
        like: str,
        urls: Sequence[str],
        parameters: Mapping[str, float] | None = None,
        seed: int = 0,
        key: bytes | None = None,
        ready_after: float | None = None,
    ) -> None:
        firmware = find_firmware(like)
        if ready_after is not None:
            firmware = dataclasses.replace(firmware, ready_after=ready_after)
        Autopilot(firmware).advance(TICK)  # compiles, so that no clock waits for it
        self.autopilot = Autopilot(firmware, parameters, seed, time.time(), key)
        self.lock = threading.Lock()
        self._ports: list[Port] = []
        self._links: list[Connection] = []
        try:
            for url in urls:
                self._ports.append(Port(url))
                self._links.append(self.autopilot.connect())
        except InputError:
            self._close()
            raise
        self.addresses = [port.address for port in self._ports]
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self.run, name=f"sitl-{like}", daemon=True)

    def __enter__(self) -> Sitl:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.stop()
        self._thread.join()

    def stop(self) -> None:
        """Let `run` return."""
        self._ending.set()

    def run(self, show: Callable[[Autopilot], None] | None = None) -> None:
        """Live until `stop`, or until the autopilot aborts.

        Parameters
        ----------
        show : callable, optional
            Called about once a second with the autopilot.
        """
        with selectors.DefaultSelector() as selector:
            for port, link in zip(self._ports, self._links, strict=True):
                selector.register(port.socket, selectors.EVENT_READ, (port, link))
            try:
                self._live(selector, show)
            finally:
                self._close()

    def _live(
        self, selector: selectors.BaseSelector, show: Callable[[Autopilot], None] | None
    ) -> None:
        last = shown = time.monotonic()
        owed = 0.0
        while not self._ending.is_set() and not self.autopilot.commander.aborted:
            speed = float(self.autopilot.parameters["SIM_SPEEDUP"])
            pause = _LOOK if speed <= 0.0 else max(_LOOK, (TICK - owed) / speed)
            ready = selector.select(min(pause, 0.05))
            now = time.monotonic()
            owed += min(now - last, _BEHIND) * speed
            last = now
            with self.lock:
                for key, _ in ready:
                    self._read(*key.data)
                ticks = int(owed / TICK)
                self.autopilot.advance(ticks * TICK)
                owed -= ticks * TICK
                self._write()
            if show and now - shown > 1.0:
                shown = now
                show(self.autopilot)

    def _read(self, port: Port, link: Connection) -> None:
        for _ in range(_BATCH):
            data = port.receive()
            if data is None:
                return
            if data:
                self.autopilot.receive(link, data)

    def _write(self) -> None:
        for port, link in zip(self._ports, self._links, strict=True):
            for data in link.out:
                port.send(data)
            link.out.clear()

    def _close(self) -> None:
        for port in self._ports:
            port.socket.close()


def read_key(path: Path) -> bytes:
    """The key of MAVLink signatures in a file: 32 bytes, or their 64 hexadecimal digits.

    Raises
    ------
    InputError
        When the file holds something else.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(f"--signing {path}: {error.strerror}; allowed: a file") from error
    if len(content) == 32:
        return content
    try:
        key = bytes.fromhex(content.decode("ascii").strip())
    except ValueError:
        key = b""
    if len(key) != 32:
        raise InputError(
            f"--signing {path} holds no key; allowed: 32 bytes, or 64 hexadecimal digits"
        )
    return key
