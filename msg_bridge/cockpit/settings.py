"""Where the cockpit is served, and to whom."""

from __future__ import annotations

import os
from dataclasses import dataclass

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting

TOKEN = "IOLSPI_COCKPIT_TOKEN"
"""Environment variable with the token: parameters and command lines can be read by others."""
LEAST_TOKEN = 16
LOOPBACK = ("127.0.0.1", "::1", "localhost")


@dataclass(frozen=True)
class CockpitSettings(Settings):
    """Where the page is."""

    host: str = setting(
        "127.0.0.1", f"address to serve on; any but this machine's own needs a token in {TOKEN}"
    )
    port: int = setting(0, "port to serve on; 0 for a free one", low=0, high=65535)


def token_for(settings: CockpitSettings) -> str:
    """The token that browsers must bring; empty where none is needed.

    Raises
    ------
    InputError
        When the page is for other machines, and there is no token or one that can be guessed.
    """
    token = os.environ.get(TOKEN, "")
    allowed = f"allowed: at least {LEAST_TOKEN} characters, such as of `openssl rand -hex 16`"
    if not token and settings.host not in LOOPBACK:
        raise InputError(
            f"host is {settings.host!r}, so other machines may fly, and environment variable "
            f"{TOKEN} is missing; {allowed}"
        )
    if token and (len(token) < LEAST_TOKEN or not token.isascii() or not token.isalnum()):
        raise InputError(f"environment variable {TOKEN} is no token; {allowed}, letters and digits")
    return token
