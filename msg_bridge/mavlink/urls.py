"""Addresses of autopilots: our own form, and those that mavros, MAVSDK and MAVProxy use."""

from __future__ import annotations

import contextlib
import re
import socket
from typing import NamedTuple

from iolspi_ros.errors import InputError

ALLOWED = (
    "udpin:127.0.0.1:14540 (listen), udpout:127.0.0.1:14540 (call), tcp:127.0.0.1:5760 or "
    "serial:/dev/ttyACM0:57600"
)
_KINDS = {
    "udpin": "udpin", "udp": "udpin", "udpout": "udpout", "tcp": "tcp", "tcpout": "tcp",
    "serial": "serial",
}  # fmt: skip
_LISTENING_TCP = ("tcpin", "tcp-l")
_ANY = ("", "*")
_HERE = ("127.0.0.1", "localhost")
_NUMBER = re.compile("[0-9]{1,9}")
_HOST = re.compile(r"[^\s/\0]*")
_BAUD = 57600  # of mavros, where none is given


class Address(NamedTuple):
    """Where an autopilot is: `udpin`, `udpout`, `tcp` or `serial`; host and port, or line."""

    kind: str
    place: str
    number: int

    def __str__(self) -> str:
        return f"{self.kind}:{self.place}:{self.number}"


def parse(url: str) -> Address:
    """What a URL means.

    Understood are, besides our own, `udpin://127.0.0.1:14540` and the like (MAVSDK),
    `udp://@HOST:PORT`, `udp://:14540@127.0.0.1:14557`, `serial:///dev/ttyACM0:57600` (mavros) and
    `/dev/ttyACM0,57600` (MAVProxy).

    Raises
    ------
    InputError
        When it means nothing, or listens to everybody; it names the URL that is meant.
    """
    kind, separator, rest = url.partition(":")
    if url.startswith("/"):
        kind, rest = "serial", url
    elif not separator:
        raise _refused(url)
    rest = rest.removeprefix("//")
    rest, _, options = rest.partition("?")
    if options:
        raise _refused(url, f"{url.partition('?')[0].rstrip('/')}, and the parameter `system`")
    if kind in _LISTENING_TCP:
        raise _refused(url, f"tcp:{rest}, which calls; let the autopilot wait there")
    if kind not in _KINDS:
        raise _refused(url)
    if kind == "serial":
        return _serial(url, rest)
    rest = rest.rstrip("/")
    if "@" in rest:
        return _with_remote(url, rest)
    place, port = _split(url, rest)
    return _checked(url, Address(_KINDS[kind], place, port))


def _serial(url: str, rest: str) -> Address:
    device, _, baud = re.sub(r",(\d+)$", r":\1", rest).partition(":")
    if not device.startswith("/") or "\0" in device:
        raise _refused(url)
    if baud and not _NUMBER.fullmatch(baud):
        raise _refused(url, f"serial:{device}:{_BAUD}")
    return Address("serial", device, int(baud or _BAUD))


def _with_remote(url: str, rest: str) -> Address:
    """In mavros: BIND:PORT@HOST:PORT; what is bound to hears whoever is at the other end."""
    bound, _, remote = rest.partition("@")
    if not bound:
        return _checked(url, Address("udpout", *_split(url, remote)))
    place, port = _split(url, bound)
    host = _split(url, remote)[0] if ":" in remote else remote
    if _any(place):
        place = "127.0.0.1" if host in _HERE else place
    return _checked(url, Address("udpin", place, port))


def _split(url: str, place: str) -> tuple[str, int]:
    host, _, port = place.rpartition(":")
    if not _NUMBER.fullmatch(port) or not _HOST.fullmatch(host):
        raise _refused(url)
    return host, int(port)


def _any(host: str) -> bool:
    """Whether a host stands for all of this machine's addresses, however that is written."""
    with contextlib.suppress(OSError):
        return host in _ANY or not any(socket.inet_aton(host))
    return False


def _checked(url: str, address: Address) -> Address:
    if not 0 < address.number < 65_536:
        raise _refused(url, "a port from 1 to 65535")
    if _any(address.place):
        here = address._replace(place="127.0.0.1")
        if address.kind != "udpin":
            raise _refused(url, str(here))
        raise _refused(
            url,
            f"{here} for an autopilot on this machine, or the one address of this machine that "
            "it sends to, so that it is known who may call",
        )
    return address


def _refused(url: str, allowed: str = ALLOWED) -> InputError:
    return InputError(f"url is {url!r}; allowed: {allowed}")
