"""Lets in only browsers that bring the token, and only pages of our own on the sockets."""

from __future__ import annotations

import hmac
import time
from collections import deque
from collections.abc import Callable, Iterable
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

COOKIE = "iolspi_cockpit"
FILES = ("/cockpit/", "/painter/", "/_nicegui")
"""What paths begin with that cost nothing. Each other one makes a page, which is kept for a minute
(0.7 MB) for a browser that may open its sockets."""
MOST_PAGES, MINUTE = 120, 60.0
"""Pages at most in so many seconds."""
_REFUSED = (
    b"This cockpit needs a token, and yours is missing or wrong. Open the whole address that the "
    b"cockpit printed when it started; it ends with ?token=...\n"
)
_ELSEWHERE = (
    b"This cockpit is for this machine only: open it by the address that it printed when it "
    b"started.\n"
)
_CROWDED = b"This page was loaded too often in the last minute. Load it again after that.\n"


class Guard:
    """An ASGI application before another one.

    Parameters
    ----------
    app : ASGI application
    token : str
        Empty for none.
    host : str
        Where it is served. Without a token only requests that call the server by a name of this
        machine pass, so that no page of somebody else reaches it through a name of their own.
    clock : callable
        Seconds.
    """

    def __init__(
        self, app: Any, token: str, host: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._app, self._token = app, token.encode()
        self._names = () if token else ("localhost", "127.0.0.1", "::1", host)
        self._clock, self._pages = clock, deque[float](maxlen=MOST_PAGES)

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {name: value.decode("latin-1") for name, value in scope["headers"]}
        if self._names and _hostname(headers.get(b"host", "")) not in self._names:
            await _refuse(scope, send, _ELSEWHERE)
        elif self._token and not any(
            hmac.compare_digest(given.encode(), self._token) for given in _tokens(scope, headers)
        ):
            await _refuse(scope, send, _REFUSED)
        elif scope["type"] == "websocket" and not _own_page(headers):
            await _refuse(scope, send, _ELSEWHERE)
        elif scope["type"] == "http" and self._crowded(scope["path"]):
            await _refuse(scope, send, _CROWDED, 503)
        else:
            await self._app(scope, receive, self._remembering(scope, send))

    def _crowded(self, path: str) -> bool:
        """Whether this is one page too many."""
        if path.startswith(FILES):
            return False
        now = self._clock()
        if len(self._pages) == MOST_PAGES and now - self._pages[0] < MINUTE:
            return True
        self._pages.append(now)
        return False

    def _remembering(self, scope: Any, send: Any) -> Any:
        """Give a browser that brought the token a cookie with it: its sockets bring that."""
        if not self._token or scope["type"] != "http":
            return send
        cookie = b"%s=%s; HttpOnly; SameSite=Strict; Path=/" % (COOKIE.encode(), self._token)

        async def sending(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message.get("headers", []), (b"set-cookie", cookie)]
            await send(message)

        return sending


def _tokens(scope: Any, headers: dict[bytes, str]) -> Iterable[str]:
    query = scope.get("query_string", b"").decode("latin-1")
    yield from parse_qs(query).get("token", [])
    try:
        morsel = SimpleCookie(headers.get(b"cookie", "")).get(COOKIE)
    except CookieError:
        return
    if morsel is not None:
        yield morsel.value


def _own_page(headers: dict[bytes, str]) -> bool:
    """Whether a socket was opened by a page of this server, or by no browser."""
    origin = headers.get(b"origin")
    return origin is None or urlsplit(origin).netloc == headers.get(b"host", "")


def _hostname(host: str) -> str | None:
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None


async def _refuse(scope: Any, send: Any, text: bytes, status: int = 403) -> None:
    if scope["type"] == "websocket":
        await send({"type": "websocket.close", "code": 1008})
        return
    kind = [(b"content-type", b"text/plain; charset=utf-8")]
    await send({"type": "http.response.start", "status": status, "headers": kind})
    await send({"type": "http.response.body", "body": text})
