"""What a flight tells people: who commands and why, what the autopilot says, what does not come."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from msg_bridge.mavlink.authority import Commander, Verdict
from msg_bridge.mavlink.envelope import Motion
from msg_bridge.mavlink.telemetry import Telemetry

if TYPE_CHECKING:
    from msg_bridge.mavlink.flight import Flight

Say = Callable[[str, str], None]
"""Tells a person: "info" or "warning", and the words."""

_COMPLAIN = 20.0  # between two words about what does not come about [s]
_WARNING = 4  # MAV_SEVERITY; less is worse
_CALM = (Commander.BRIDGE, Commander.ACTOR, Commander.NOBODY)


class Voice:
    """Puts a flight into words.

    Parameters
    ----------
    telemetry : Telemetry
    say : callable
    """

    def __init__(self, telemetry: Telemetry, say: Say) -> None:
        self._telemetry, self.say = telemetry, say
        self._heard = self._complained = 0.0

    def begin(self, now: float) -> None:
        """Something begins: have patience with it."""
        self._complained = now

    def pass_on(self, now: float) -> None:
        """Tell what the autopilot has said since the last time."""
        for when, severity, text in list(self._telemetry.texts):
            if when > self._heard:
                self.say("warning" if severity <= _WARNING else "info", f"autopilot: {text}")
        self._heard = now

    def verdict(self, before: Verdict, verdict: Verdict) -> None:
        """Tell that somebody else commands, and why."""
        name = verdict.commander.name.lower()
        if verdict.commander in _CALM:
            if before.commander not in (*_CALM, Commander.NEUTRAL):
                self.say("info", f"{name} commands again")
        elif verdict.commander is not Commander.NEUTRAL:
            self.say("warning", f"{name}: {verdict.reason}")

    def complain(self, now: float, what: str) -> None:
        """Tell now and then what does not come about, and what the autopilot says to it."""
        if now - self._complained > _COMPLAIN:
            self._complained = now
            said = self._telemetry.texts_since(now - _COMPLAIN)
            self.say("warning", what + (f"; autopilot: {said[-1]}" if said else ""))


def where(m: Motion) -> str:
    """Where a vehicle is, in words."""
    return f"now x = {m.x:.2f} m, speed {m.speed:.2f} m/s, swing {m.swing:.2f} rad"


def report(flight: Flight) -> dict[str, Any]:
    """How a flight stands, for /diagnostics."""
    t = flight.link.telemetry
    mode = flight.profile.mode_name(t.mode)
    return {
        "phase": flight.phase.name.lower(),
        "commander": flight.verdict.commander.name.lower(),
        "reason": flight.verdict.reason,
        "autopilot": f"{flight.profile.name}, {mode}, {'armed' if t.armed else 'disarmed'}",
        "load": "reported by its own system" if flight.sight.feed else "estimated",
        "round trip [s]": round(t.round_trip, 4),
        "episodes flown": flight.flown,
        "episodes abandoned": flight.abandoned,
        "envelope left": flight.violations,
        "envelope interventions": flight.interventions,
        "packets rejected": flight.link.codec.rejected,
        "other systems heard": dict(t.strangers),
    }
