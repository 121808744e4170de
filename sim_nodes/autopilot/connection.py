"""One MAVLink connection: bytes in and out, signed, late and lost as the settings say."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

_YEAR_2015 = 1420070400
"""Signatures count tens of microseconds from there [s after the epoch]."""


class Channel:
    """What a link does to datagrams, the same for all links."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self.delay, self.loss, self.cut_until = 0.0, 0.0, -1.0

    def takes(self, now: float) -> bool:
        """Whether a datagram is lost."""
        lost = self.loss > 0.0 and self._rng.random() < self.loss
        return now < self.cut_until or bool(lost)


class Connection:
    """A connection to one peer; no socket: bytes come in and go out by calls.

    Parameters
    ----------
    channel : Channel
    number : int
        Of the link, in its signatures.
    rates : dict of str to float
        Messages sent without being asked [Hz].
    """

    def __init__(self, channel: Channel, number: int, rates: dict[str, float]) -> None:
        self._channel = channel
        self.set_rates(rates)
        self._queue: list[tuple[float, int, bool, bytes]] = []
        self._count = 0
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._senders: dict[tuple[int, int], Any] = {}
        self.out: list[bytes] = []
        self._number = number

    def sign(self, key: bytes | None, unix_time: float) -> None:
        """Sign what goes out, and take nothing that is not signed with the same key."""
        stamp = int((unix_time - _YEAR_2015) * 1e5)
        for end in (self._parser, *self._senders.values()):
            self._sign(end, key, stamp)

    def _sign(self, end: Any, key: bytes | None, stamp: int) -> None:
        signing = end.signing
        signing.secret_key, signing.timestamp = key, max(stamp, signing.timestamp)
        signing.sign_outgoing, signing.link_id = key is not None, self._number

    # ------------------------------------------------------------ out

    def set_rates(self, rates: Mapping[str, float]) -> None:
        """Send these messages without being asked from now on [Hz], and nothing else."""
        self.rates = dict(rates)
        self._due: dict[str, float] = {}
        self._next = -math.inf

    def set_rate(self, name: str, rate: float) -> None:
        """Send a message at a rate from now on [Hz]; 0 for no more."""
        self.rates[name] = rate
        self._due.pop(name, None)
        self._next = -math.inf

    def due(self, now: float) -> list[str]:
        """Messages whose time has come."""
        if now < self._next - 1e-9:
            return []
        found = []
        self._next = math.inf
        for name, rate in self.rates.items():
            if rate <= 0.0:
                continue
            due = self._due.get(name, now)
            if now >= due - 1e-9:
                found.append(name)
                # From when it was due, so that the rate holds; not to catch up after a change.
                due = max(due + 1.0 / rate, now)
                self._due[name] = due
            self._next = min(self._next, due)
        return found

    def send(self, message: Any, system: int, component: int, now: float) -> None:
        """Pack a message of one of our systems and send it."""
        sender = self._senders.get((system, component))
        if sender is None:
            sender = mavlink.MAVLink(None, system, component)
            signing = self._parser.signing
            self._sign(sender, signing.secret_key, signing.timestamp)
            self._senders[system, component] = sender
        data = bytes(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
        if self._channel.takes(now):
            return
        if self._channel.delay > 0.0:
            self._later(now, True, data)
        else:
            self.out.append(data)

    # ------------------------------------------------------------ in

    def receive(self, data: bytes, now: float) -> Iterator[Any]:
        """Messages in a datagram, unless it is lost or comes later."""
        if self._channel.takes(now):
            return
        if self._channel.delay > 0.0:
            self._later(now, False, data)
        else:
            yield from self._parse(data)

    def arrived(self, now: float) -> Iterator[Any]:
        """Messages whose delay is over; what goes out late is put into `out`."""
        while self._queue and self._queue[0][0] <= now:
            _, _, outgoing, data = heapq.heappop(self._queue)
            if outgoing:
                self.out.append(data)
            else:
                yield from self._parse(data)

    def _later(self, now: float, outgoing: bool, data: bytes) -> None:
        self._count += 1
        entry = (now + self._channel.delay, self._count, outgoing, data)
        heapq.heappush(self._queue, entry)

    def _parse(self, data: bytes) -> Iterator[Any]:
        # Each datagram by itself: half a message in one must not swallow the next.
        self._parser.buf, self._parser.buf_index = bytearray(), 0
        self._parser.expected_length = mavlink.HEADER_LEN_V1 + 2
        for message in self._parser.parse_buffer(data) or ():
            if message.get_msgId() >= 0:
                yield message
