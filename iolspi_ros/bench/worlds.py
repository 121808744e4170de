"""Where the bridge flies the embedded autopilot: in memory, or on sockets.

On a stepped clock and in memory (`Stepped`) a flight takes a small part of its own time, and the
same seed gives the same flight. On the machine's clock and sockets (`RealTime`) it is the whole.
"""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Callable
from typing import Protocol

from msg_bridge.mavlink.clock import Clock, VehicleClock
from msg_bridge.mavlink.runner import Runner
from msg_bridge.mavlink.transport import Transport, open_url
from sim_nodes.autopilot.autopilot import TICK, Autopilot
from sim_nodes.autopilot.connection import Connection
from sim_nodes.autopilot.firmware import find_firmware
from sim_nodes.autopilot.server import Sitl

FACTOR = 4.0
"""Vehicle seconds per second, in real time."""
READY_AFTER = 2.0
"""From boot until the autopilot can be armed [s]."""


class FlightWorld(Protocol):
    """Where a flight happens: an autopilot, ways to it, and time."""

    @property
    def autopilot(self) -> Autopilot:
        """The embedded one."""
        ...

    @property
    def clock(self) -> Clock:
        """The bridge's."""
        ...

    def lock(self) -> contextlib.AbstractContextManager[object]:
        """Hold the autopilot still, to look at it."""
        ...

    def connect(self) -> Transport:
        """One more way to the autopilot; the first is the bridge's."""
        ...

    def open(self) -> None:
        """Let time begin."""
        ...

    def run(self, runner: Runner | None, answer: Callable[[], bool]) -> None:
        """Fly with this from now on, calling `answer` while it gives True; None for nothing."""
        ...

    def wait(self) -> None:
        """Let a little time pass."""
        ...

    def close(self) -> None:
        """Let everything go."""
        ...


class Stepped:
    """Time passes when somebody waits; nothing but the seed decides what happens.

    Parameters
    ----------
    like : str
        px4 or ardupilot.
    values : dict of str to float
        Parameters that the autopilot boots with; `SIM_SPEEDUP` is against the bridge's clock.
    seed : int
    key : bytes, optional
        Of the autopilot's signatures.
    ready_after : float, optional
        From boot until it can be armed [s]; None for as long as the real one.
    """

    def __init__(
        self,
        like: str,
        values: dict[str, float],
        seed: int = 0,
        key: bytes | None = None,
        *,
        ready_after: float | None = READY_AFTER,
    ) -> None:
        firmware = find_firmware(like)
        if ready_after is not None:
            firmware = dataclasses.replace(firmware, ready_after=ready_after)
        epoch = {} if key is None else {"epoch": time.time()}  # whose stamps are compared
        self.autopilot = Autopilot(firmware, values, seed, key=key, **epoch)
        self.clock = SteppedClock()
        self._owed = 0.0
        self._runner: Runner | None = None
        self._answer: Callable[[], bool] = lambda: False

    def lock(self) -> contextlib.AbstractContextManager[object]:
        """Nothing happens beside."""
        return contextlib.nullcontext()

    def connect(self) -> Transport:
        """One more way to the autopilot."""
        return MemoryTransport(self, self.autopilot.connect())

    def open(self) -> None:
        """Nothing to begin."""

    def run(self, runner: Runner | None, answer: Callable[[], bool]) -> None:
        """Step with this from now on."""
        self._runner, self._answer = runner, answer

    def wait(self) -> None:
        """One step of the runner, or of time alone."""
        if self._runner is None:
            self.advance()
        else:
            self._runner.step()
        while self._answer():
            pass

    def advance(self) -> None:
        """Let the least time pass."""
        self.clock.ticks += 1
        self._owed += float(self.autopilot.parameters["SIM_SPEEDUP"])
        ticks = int(self._owed)
        self.autopilot.advance(ticks * TICK)
        self._owed -= ticks

    def close(self) -> None:
        """Nothing to let go."""


class SteppedClock:
    """A clock that goes by ticks; vehicle and machine have the same time."""

    def __init__(self) -> None:
        self.ticks = 0

    def now(self) -> float:
        """Since the clock was made [s]."""
        return self.ticks * TICK

    def elapsed(self) -> float:
        """Since the clock was made [s]."""
        return self.now()

    def wall(self, seconds: float) -> float:
        """The same."""
        return seconds


class MemoryTransport:
    """Datagrams to an autopilot in the same process; waiting lets time pass."""

    datagrams = True
    source, trouble = "memory", ""

    def __init__(self, world: Stepped, connection: Connection) -> None:
        self._world, self._connection = world, connection

    def wait(self, seconds: float) -> None:
        """Let time pass until something has come, or for so long [s]."""
        clock = self._world.clock
        end = clock.now() + seconds
        while clock.now() < end - 1e-9 and not self._connection.out:
            self._world.advance()

    def read(self) -> bytes:
        """What has come."""
        return self._connection.out.pop(0) if self._connection.out else b""

    def write(self, data: bytes) -> bool:
        """Send."""
        self._world.autopilot.receive(self._connection, data)
        return True

    def answer(self, source: str) -> None:
        """Nothing to choose."""

    def close(self) -> None:
        """Nothing to let go."""


class RealTime:
    """Sockets, threads and the machine's clock.

    Parameters
    ----------
    like, values, seed, key
        See `Stepped`.
    factor : float
        Vehicle seconds per second.
    """

    def __init__(
        self,
        like: str,
        values: dict[str, float],
        seed: int = 0,
        key: bytes | None = None,
        *,
        factor: float = FACTOR,
    ) -> None:
        ports = ["udpin:127.0.0.1:0", "udpin:127.0.0.1:0"]
        speed = {"SIM_SPEEDUP": factor}
        self._sitl = Sitl(like, ports, values | speed, seed, key, ready_after=READY_AFTER)
        self.autopilot = self._sitl.autopilot
        self.clock = VehicleClock(factor)
        self._addresses = list(self._sitl.addresses)
        self._stack = contextlib.ExitStack()

    def lock(self) -> contextlib.AbstractContextManager[object]:
        """Hold the autopilot's thread."""
        return self._sitl.lock

    def connect(self) -> Transport:
        """A socket; there are two."""
        host, port = self._addresses.pop(0)
        return open_url(f"udpout:{host}:{port}")

    def open(self) -> None:
        """Start the autopilot's thread."""
        self._stack.enter_context(self._sitl)

    def run(self, runner: Runner | None, answer: Callable[[], bool]) -> None:
        """Start a thread that flies, and one that answers."""
        if runner is None:
            return
        ending = threading.Event()

        def act() -> None:
            while not ending.is_set():
                if not answer():
                    time.sleep(0.001)

        actor = threading.Thread(target=act, daemon=True)
        self._stack.callback(actor.join)
        self._stack.callback(ending.set)
        self._stack.callback(runner.stop)
        actor.start()
        runner.start()

    def wait(self) -> None:
        """Sleep a little."""
        time.sleep(0.002)

    def close(self) -> None:
        """End all threads."""
        self._stack.close()
