"""What a browser may say over the socket, checked: anybody can open one."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import Any

from iolspi_ros.errors import InputError
from msg_bridge.cockpit.virtual_joystick import Deflection

LONGEST = 2000
"""Characters of a message at most."""
SERVICES = ("keep", "discard", "undo", "finish")
TUNED = {"speed": (0.1, 1.0), "corruption": (0.0, 1.0)}
"""What a browser may set, and from where to where: vehicle seconds per second; the probability
that an action of a demonstration is replaced by a random one."""


@dataclass(frozen=True)
class Move:
    """Where the stick is."""

    at: Deflection


@dataclass(frozen=True)
class Ask:
    """For the stick."""


@dataclass(frozen=True)
class Give:
    """The stick to whoever asked, or put it down."""


@dataclass(frozen=True)
class Call:
    """One of the demonstrator's services."""

    service: str


@dataclass(frozen=True)
class Tune:
    """One of `TUNED`."""

    what: str
    value: float


Said = Move | Ask | Give | Call | Tune


def read(text: str, n_buttons: int) -> Said:
    """What a message says.

    Parameters
    ----------
    text : str
        JSON with `say` and what belongs to it.
    n_buttons : int
        How many there are, that of the takeover among them.

    Raises
    ------
    InputError
        When it is none of these.
    """
    if len(text) > LONGEST:
        raise InputError(f"message has {len(text)} characters; allowed: {LONGEST}")
    try:
        said = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("message is no JSON") from None
    if not isinstance(said, dict):
        raise InputError("message is no JSON object")
    what = said.get("say")
    if what == "move":
        return Move(_deflection(said, n_buttons))
    if what in ("ask", "give"):
        return Ask() if what == "ask" else Give()
    if what == "call" and str(said.get("service")) in SERVICES:
        return Call(said["service"])
    if what == "tune" and str(said.get("what")) in TUNED:
        value, (low, high) = _number(said.get("value")), TUNED[said["what"]]
        if low <= value <= high:
            return Tune(said["what"], value)
    raise InputError("message says nothing that is understood")


def _deflection(said: dict[str, Any], n_buttons: int) -> Deflection:
    axes, buttons = said.get("axes"), said.get("buttons")
    if not isinstance(axes, list) or len(axes) != 2 or not isinstance(buttons, list):
        raise InputError("axes or buttons are missing; allowed: two axes and a list of buttons")
    x, y = (max(-1.0, min(1.0, _number(value))) for value in axes)
    if len(buttons) != n_buttons or any(button not in (0, 1) for button in buttons):
        raise InputError(f"buttons are not {n_buttons} times 0 or 1")
    return Deflection((x, y), tuple(int(button) for button in buttons))


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError("a number is missing")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise InputError("a number is not finite")
    return number
