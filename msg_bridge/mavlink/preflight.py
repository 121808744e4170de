"""Before anything flies: who is there, what its parameters are, and whether it knows where it is.

Whatever the bridge changes in an autopilot is written down, and taken back at the end; what a
bridge that was killed could not take back, the next one does.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from iolspi_ros.core.checkpoint import atomic_file
from iolspi_ros.errors import InputError
from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.clock import Clock
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.profiles import AutopilotProfile, ParameterChange
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.telemetry import parameter_value

_AGAIN = 0.3  # between two requests of the same [s] of wall time
_ANSWER = 3.0  # for a parameter [s]
_CLOSE = 1e-5  # relative difference that a float of 32 bits may make
_RUN = 2.0  # over which the autopilot's clock is measured [s]
_TRIES = 3
_WRONG = 0.25  # relative error of its speed that is no chance


class ChecklistItem(NamedTuple):
    """One line of the checklist."""

    name: str
    found: str


class Preflight:
    """Checks an autopilot, and sets its parameters.

    Parameters
    ----------
    link : AutopilotLink
    settings : LinkSettings
    flight : FlightSettings
    clock : Clock
    kept : Path
        File that remembers the parameters as they were.
    tell : callable
        Takes each line of the checklist as it is found.
    going_on : callable
        False when it should stop waiting.
    """

    def __init__(
        self,
        link: AutopilotLink,
        settings: LinkSettings,
        flight: FlightSettings,
        clock: Clock,
        kept: Path,
        tell: Callable[[ChecklistItem], None],
        going_on: Callable[[], bool] = lambda: True,
    ) -> None:
        self._link, self._settings, self._flight = link, settings, flight
        self._clock, self._kept, self._tell, self._going_on = clock, kept, tell, going_on

    def run(self) -> AutopilotProfile:
        """Go through the list.

        Raises
        ------
        InputError
            At the first line that does not hold: nothing flies then.
        """
        profile = self._who()
        self._change(profile)
        self._wait(
            lambda: self._link.telemetry.ready,
            "position estimate: the autopilot does not know where it is",
            self._link.ask_rates,
        )
        self._tell(ChecklistItem("position estimate", "good"))
        self._check_clock()
        self._check_load()
        return profile

    def restore(self, profile: AutopilotProfile) -> list[str]:
        """Give the autopilot its parameters back; what could not be given back."""
        self._going_on = lambda: True  # also when it is a signal that ends the bridge
        before = self._remembered()
        failed = []
        for name, value in before.items():
            try:
                self._set(profile, name, value)
            except InputError as error:
                failed.append(str(error))
        if not failed and self._kept.exists():
            self._kept.unlink()
        return failed

    # ------------------------------------------------------------ who is there

    def _who(self) -> AutopilotProfile:
        t, s = self._link.telemetry, self._settings
        self._wait(lambda: t.autopilot is not None, "heartbeat", lambda: None)
        profile = profiles.of_autopilot(t.autopilot or 0)
        if s.autopilot not in ("auto", profile.name):
            raise InputError(
                f"{s.url} is {profile.name}, not {s.autopilot}; allowed: --autopilot "
                f"{profile.name}, or another url"
            )
        self._tell(ChecklistItem("autopilot", f"{profile.name}, system {t.system}, at {s.url}"))
        if profile.flies_not:
            raise InputError(f"{profile.name} cannot be flown over MAVLink: {profile.flies_not}")
        signed = "all packets" if s.signing_key else "no: whoever reaches the port is obeyed"
        self._tell(ChecklistItem("signed", signed))
        return profile

    def _wait(self, ready: Callable[[], bool], what: str, ask: Callable[[], None]) -> None:
        """Wait for something, asking for it once a second."""
        end = self._clock.elapsed() + self._settings.patience
        asked = -math.inf
        while not ready():
            now = self._clock.elapsed()
            if now > end:
                raise InputError(f"no {what} within {self._settings.patience:g} s{self._why()}")
            if now - asked > 1.0:
                asked = now
                ask()
            self._listen()

    def _why(self) -> str:
        """What was heard instead."""
        t, codec = self._link.telemetry, self._link.codec
        words = []
        if t.strangers:
            systems = ", ".join(map(str, sorted(t.strangers)))
            words.append(f"heard system {systems}, not {t.system}: set `system`")
        if codec.rejected:
            words.append(f"{codec.rejected} packets were broken, unsigned or wrongly signed")
        if t.texts:
            words.append(f"the autopilot says: {t.texts[-1][2]}")
        if not words and not codec.received:
            words.append(f"nothing comes at {self._settings.url}; is an autopilot started there?")
        return "; " + "; ".join(words) if words else ""

    def _listen(self) -> None:
        if not self._going_on():
            raise InputError("interrupted")
        self._link.wait(0.02)
        self._link.poll(self._clock.now())

    # ------------------------------------------------------------ parameters

    def _change(self, profile: AutopilotProfile) -> None:
        """Set what has to be, after writing down what was."""
        remembered, before = self._remembered(), {}
        for change in profile.changes:
            value, _ = self._read(profile, change.name)
            # Ours still: a bridge that was killed set it, and wrote down what was before.
            ours = _same(value, change.value)
            before[change.name] = remembered.get(change.name, value) if ours else value
        with atomic_file(self._kept) as file:
            file.write(json.dumps(before, indent=1).encode() + b"\n")
        for change in profile.changes:
            self._set(profile, change.name, change.value)
            self._tell(self._changed(change, before[change.name]))

    def _changed(self, change: ParameterChange, before: float) -> ChecklistItem:
        was = "" if _same(before, change.value) else f", was {before:g}"
        return ChecklistItem(change.name, f"{change.value:g}{was}: {change.why}")

    def _remembered(self) -> dict[str, float]:
        try:
            content = json.loads(self._kept.read_text(encoding="utf-8"))
            return {str(name): float(value) for name, value in content.items()}
        except (OSError, ValueError, AttributeError, TypeError):
            return {}

    def _read(self, profile: AutopilotProfile, name: str) -> tuple[float, int]:
        """Value and type of a parameter."""
        found = self._answer(name, lambda: self._link.read_parameter(name))
        if found is None:
            raise InputError(
                f"parameter {name} of {profile.name} cannot be read; without it nothing flies"
            )
        return parameter_value(profile, *found), found[1]

    def _set(self, profile: AutopilotProfile, name: str, value: float) -> None:
        present, kind = self._read(profile, name)
        if _same(present, value):
            return
        found = self._answer(name, lambda: self._link.set_parameter(profile, name, value, kind))
        if found is None or not _same(parameter_value(profile, *found), value):
            raise InputError(f"parameter {name} of {profile.name} cannot be set to {value:g}")

    def _answer(self, name: str, ask: Callable[[], None]) -> tuple[float, int] | None:
        self._link.telemetry.parameters.pop(name, None)
        end = self._clock.elapsed() + _ANSWER
        asked = -math.inf
        while (now := self._clock.elapsed()) < end:
            if name in self._link.telemetry.parameters:
                return self._link.telemetry.parameters[name]
            if now - asked > _AGAIN:
                asked = now
                ask()
            self._listen()
        return None

    # ------------------------------------------------------------ clock and load

    def _check_clock(self) -> None:
        """Whether the autopilot's clock goes as fast as we think.

        Measured again when it does not: a busy machine may stall a simulator for a moment.
        """
        factor = self._flight.real_time_factor
        self._link.ask_rates()
        for _ in range(_TRIES):
            pace = self._pace()
            if abs(pace / factor - 1.0) < _WRONG:
                self._tell(ChecklistItem("clock", f"{pace:.2f} times ours"))
                return
        raise InputError(
            f"the autopilot's clock goes {pace:.2f} times as fast as ours, but "
            f"real_time_factor is {factor:g}; allowed: the same; 1.0 for all that really flies"
        )

    def _pace(self) -> float:
        t = self._link.telemetry
        start, boot = self._clock.elapsed(), t.boot
        while self._clock.elapsed() - start < _RUN:
            self._listen()
        return (t.boot - boot) / (self._clock.elapsed() - start)

    def _check_load(self) -> None:
        """Whether the load reports its position, if it is to."""
        if self._flight.load_source == "estimate":
            self._tell(
                ChecklistItem("load", "estimated from the vehicle's acceleration, seen by nobody")
            )
            return
        t = self._link.telemetry
        self._wait(
            lambda: self._clock.now() - t.load_time < 2.0,
            f"position of the load (system {t.load_system}); load_source: estimate flies without",
            lambda: None,
        )
        self._tell(ChecklistItem("load", f"reported by system {t.load_system}"))


def _same(a: float, b: float) -> bool:
    return abs(a - b) <= _CLOSE * max(abs(a), abs(b))
