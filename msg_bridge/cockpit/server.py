"""Serves the page and its socket, in a thread of its own beside the node's."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Callable
from typing import Any

import uvicorn
from fastapi import FastAPI

from iolspi_ros.errors import InputError
from msg_bridge.cockpit.guard import Guard
from msg_bridge.cockpit.session import Session

LONGEST = 65_536
"""Bytes of a message on any socket at most."""


class Server:
    """Serves a session on one port.

    Parameters
    ----------
    session : Session
    make_app : callable
        Makes what is served, the page's own parts among it.
    host, port : str, int
        Port 0 is a free one.
    token : str
        That browsers must bring; empty for none.

    Raises
    ------
    InputError
        When the address cannot be served on.
    """

    def __init__(
        self, session: Session, make_app: Callable[[Session], FastAPI], host: str, port: int,
        token: str,
    ) -> None:  # fmt: skip
        self._socket = _bound(host, port)
        self._token = token
        number = self._socket.getsockname()[1]
        name = f"[{host}]" if ":" in host else host
        self.address = f"http://{name}:{number}/"
        self._session = session
        app: Any = Guard(make_app(session), token, host)
        self._server = uvicorn.Server(uvicorn.Config(
            app, log_level="warning", access_log=False, ws="websockets-sansio",
            ws_max_size=LONGEST, ws_per_message_deflate=False, timeout_graceful_shutdown=1,
            lifespan="on",
        ))  # fmt: skip
        self._thread = threading.Thread(target=self._run, name="cockpit", daemon=True)

    @property
    def invitation(self) -> str:
        """The address to open, token and all."""
        return f"{self.address}?token={self._token}" if self._token else self.address

    def start(self) -> None:
        """Begin to serve."""
        self._thread.start()

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        repeating = asyncio.create_task(self._session.repeat())
        try:
            await self._server.serve(sockets=[self._socket])
        finally:
            repeating.cancel()
            self._session.release()

    def stop(self) -> None:
        """Serve no more; whoever flies lets go."""
        self._session.close()
        self._server.should_exit = True
        if self._thread.is_alive():
            self._thread.join(3.0)
        self._socket.close()


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(100)  # else a second one could still bind here
    except OSError as error:
        listener.close()
        raise InputError(
            f"the cockpit cannot be served on host {host!r}, port {port}: {error.strerror}; "
            "allowed: an address of this machine and a port that is free (0 finds one)"
        ) from None
    return listener
