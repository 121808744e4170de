"""What a flight tells people: who commands and why, what the autopilot says, what does not come."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink.arbiter import Authority, Ruling
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.telemetry import Telemetry

Say = Callable[[str, str], None]
"""Tells a person: "info" or "warning", and the words."""

_PERIOD = 20.0  # between two words about what does not come about [s]
_WARNING = 4  # MAV_SEVERITY; less is worse
_CALM = (Authority.BRIDGE, Authority.ACTOR, Authority.NOBODY)


class AuthorityChange(NamedTuple):
    """Who commands from now on, in which phase; the key is that of the newest state."""

    episode: int
    step: int
    time: float
    phase: Phase
    authority: Authority


class Outputs(NamedTuple):
    """Who is told what; each is called while the flight is locked, and returns soon.

    Attributes
    ----------
    show : callable
        Takes each observation of the task.
    say : callable
        Takes words for people.
    change : callable
        Takes each change of who commands or of the phase.
    """

    show: Callable[[Observation], None]
    say: Say
    change: Callable[[AuthorityChange], None] = lambda change: None


class StatusReporter:
    """Puts a flight into words.

    Parameters
    ----------
    telemetry : Telemetry
    say : callable
    """

    def __init__(self, telemetry: Telemetry, say: Say) -> None:
        self._telemetry, self.say = telemetry, say
        self._since = 0.0
        self._trouble = ""
        self._relayed: tuple[float, int, str] | None = None

    def begin(self, now: float) -> None:
        """Something begins: have patience with it."""
        self._since = now

    def relay(self) -> None:
        """Tell what the autopilot has said since the last time."""
        fresh = itertools.takewhile(
            lambda heard: heard is not self._relayed, reversed(self._telemetry.texts)
        )
        for heard in reversed(list(fresh)):
            self._relayed, (_, severity, text) = heard, heard
            self.say("warning" if severity <= _WARNING else "info", f"autopilot: {text}")

    def line(self, link: AutopilotLink) -> None:
        """Tell when the line breaks or is whole again, and who speaks that should not."""
        if link.trouble != self._trouble:
            words = link.trouble or "the line to the autopilot is whole again"
            self._trouble = link.trouble
            self.say("warning" if link.trouble else "info", words)
        while link.sources.news:
            self.say("warning", link.sources.news.pop(0))

    def ruling(self, before: Ruling, ruling: Ruling) -> None:
        """Tell that somebody else commands, and why."""
        name = ruling.authority.name.lower()
        if ruling.authority in _CALM:
            if before.authority not in (*_CALM, Authority.NEUTRAL):
                self.say("info", f"{name} commands again")
        elif ruling.authority is not Authority.NEUTRAL:
            self.say("warning", f"{name}: {ruling.reason}")

    def delay(self, now: float, what: str) -> None:
        """Tell now and then what does not come about, and what the autopilot says to it."""
        if now - self._since > _PERIOD:
            self._since = now
            said = self._telemetry.texts_since(now - _PERIOD)
            self.say("warning", what + (f"; autopilot: {said[-1]}" if said else ""))
