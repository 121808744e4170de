"""Browsers on the socket: what they say is checked and counted, what is new is sent to them."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from fastapi import WebSocket, WebSocketDisconnect

from iolspi_ros.errors import InputError
from msg_bridge.cockpit import words
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.virtual_joystick import Deflection, Stick

STICK_PERIOD = 1 / 60
"""Seconds between two messages on `joy` while somebody has the stick."""
FRAME_PERIOD = 1 / 50
"""Seconds between two looks at what is new for a browser."""
STALLED = 20.0
"""Seconds for which a browser may take nothing of what is sent to it, before it counts as gone."""
MOST_BROWSERS = 32
MOST_WORDS, FLOOD = 250, 2500
"""Messages of a browser in a second: more are dropped; with so many it is shut out."""


GONE = (WebSocketDisconnect, RuntimeError, KeyError, TimeoutError, asyncio.CancelledError)
"""How a talk ends; a KeyError is of a browser that sent bytes, which nobody does."""


class Cockpit(Protocol):
    """What a session needs of the node; all of it may be called from another thread."""

    n_actions: int

    def joy(self, at: Deflection) -> None:
        """Publish where the stick is."""
        ...

    def call(self, service: str) -> None:
        """Call a service of the demonstrator."""
        ...

    def tune(self, what: str, value: float) -> None:
        """Set one of `words.TUNED`."""
        ...


class Session:
    """Everybody who looks at one cockpit. It lives on the server's event loop alone.

    Parameters
    ----------
    cockpit : Cockpit
    board : Board
    clock : callable
        Seconds.

    Attributes
    ----------
    dropped : int
        Messages that were malformed or too many.
    """

    def __init__(
        self, cockpit: Cockpit, board: Board, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._cockpit, self._board, self._clock = cockpit, board, clock
        self.stick = Stick()
        self.dropped = 0
        self._browsers: dict[int, WebSocket] = {}
        self._newest = 0
        self._closed = False

    # ------------------------------------------------------------ the stick

    async def repeat(self) -> None:
        """Do `tick` 60 times a second."""
        due = self._clock()
        while not self._closed:
            self.tick()
            due = max(due + STICK_PERIOD, self._clock())
            await asyncio.sleep(due - self._clock())

    def tick(self) -> None:
        """Publish where the stick is; for a page that is silent neutral once, and then nothing."""
        now, was_quiet = self._clock(), self.stick.quiet
        if self.stick.lost(now):
            self.release()
        elif self.stick.holder is not None and not (self.stick.silent(now) and was_quiet):
            self._publish()

    def _publish(self) -> None:
        self._cockpit.joy(self.stick.at if self.stick.at.buttons else self._neutral)

    def release(self) -> None:
        """Take the stick from whoever has it."""
        if self.stick.holder is not None:
            self._leave(self.stick.holder)

    def close(self) -> None:
        """End `repeat` and every socket."""
        self._closed = True

    def _leave(self, browser: int) -> None:
        """Let a browser go; neutral comes once more if it had the stick, and then nothing."""
        quiet = self.stick.quiet
        if self.stick.leave(browser, self._clock()) and not quiet:
            self._cockpit.joy(self._neutral)
        self._tell()

    @property
    def _neutral(self) -> Deflection:
        return Deflection(buttons=(0,) * (self._cockpit.n_actions + 1))

    def _tell(self) -> None:
        """Show who has the stick."""
        self._board.put("stick", {
            "holder": self.stick.holder, "asking": self.stick.asking,
            "browsers": len(self._browsers),
        })  # fmt: skip

    # ------------------------------------------------------------ browsers

    async def serve(self, socket: WebSocket) -> None:
        """Talk to one browser until it is gone."""
        if len(self._browsers) >= MOST_BROWSERS:
            await socket.close(1013, "too many browsers")
            return
        await socket.accept()
        self._newest += 1
        browser = self._newest
        self._browsers[browser] = socket
        self._tell()
        ways = self._send(browser, socket), self._listen(browser, socket)
        talk = [asyncio.create_task(way) for way in ways]
        try:
            await asyncio.wait(talk, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in talk:
                task.cancel()
            del self._browsers[browser]
            self._leave(browser)
        ended = await asyncio.gather(*talk, return_exceptions=True)
        with suppress(RuntimeError, WebSocketDisconnect, TimeoutError):
            async with asyncio.timeout(1.0):  # it may take nothing any more
                await socket.close(1001)
        for error in ended:
            if isinstance(error, BaseException) and not isinstance(error, GONE):
                raise error

    async def _send(self, browser: int, socket: WebSocket) -> None:
        """Send what is new; a slow browser gets the newest when it is ready for it."""
        await socket.send_text(json.dumps({"part": "you", "is": browser}))
        version = 0
        while not self._closed:
            version, parts = self._board.since(version)
            for part in parts:
                async with asyncio.timeout(STALLED):
                    await socket.send_text(part)
            await asyncio.sleep(FRAME_PERIOD)

    async def _listen(self, browser: int, socket: WebSocket) -> None:
        second, count = 0.0, 0
        while not self._closed:
            text = await socket.receive_text()
            now = self._clock()
            if now - second >= 1.0:
                second, count = now, 0
            count += 1
            if count > FLOOD:
                return
            try:
                if count > MOST_WORDS:
                    raise InputError("too many messages")
                self.hear(browser, words.read(text, self._cockpit.n_actions + 1))
            except InputError:
                self.dropped += 1

    def hear(self, browser: int, said: words.Said) -> None:
        """Do what a browser says; only who has the stick is listened to.

        Raises
        ------
        InputError
            When it does not.
        """
        now = self._clock()
        if isinstance(said, words.Ask):
            self.stick.ask(browser, now)
            self._tell()
        elif browser != self.stick.holder:
            raise InputError("it has not the stick")
        elif isinstance(said, words.Move):
            before, quiet = self.stick.at, self.stick.quiet
            self.stick.move(browser, said.at, now)
            if quiet or said.at != before:  # at once; it is repeated in its time
                self._publish()
        elif isinstance(said, words.Give):
            self._leave(browser)
        elif isinstance(said, words.Call):
            self._cockpit.call(said.service)
        else:
            self._cockpit.tune(said.what, said.value)

    def condition(self) -> dict[str, Any]:
        """How many look on, for /diagnostics."""
        return {
            "browsers": len(self._browsers), "who has the stick": self.stick.holder or "nobody",
            "socket messages dropped": self.dropped,
        }  # fmt: skip
