"""Before anything flies: who is there, what its parameters are, and whether it knows where it is.

Whatever the bridge changes in an autopilot is remembered by the vehicle, and given back after every
end: of a flight, of a preflight that failed, of a bridge that was killed, then by the next one.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from iolspi_ros.errors import InputError
from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.clock import Clock
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.memory import Identity, Memory, same
from msg_bridge.mavlink.parameters import Changed, Loan, ParameterClient
from msg_bridge.mavlink.profiles import AutopilotProfile
from msg_bridge.mavlink.release_check import ReleaseCheck, ReleaseProof
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.status import Say

_AGAIN = 1.0  # between two requests of the same [s] of wall time
_NEWS = 10.0  # between two words about what is waited for [s] of wall time
_FIRST = 3.0  # before the first of them [s] of wall time
_VERSION = 2.0  # for the autopilot to say which one it is [s] of wall time
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
    memory : Memory
        Of the parameters as they were.
    tell : callable
        Takes each line of the checklist as it is found.
    going_on : callable
        False when it should stop waiting.
    say : callable
        Takes words about what does not come.

    Attributes
    ----------
    release : ReleaseProof
        What is known of the release, after `run`.
    """

    def __init__(
        self,
        link: AutopilotLink,
        settings: LinkSettings,
        flight: FlightSettings,
        clock: Clock,
        memory: Memory,
        tell: Callable[[ChecklistItem], None],
        going_on: Callable[[], bool] = lambda: True,
        say: Say = lambda level, text: None,
    ) -> None:
        self._link, self._settings, self._flight = link, settings, flight
        self._clock, self._memory, self._tell = clock, memory, tell
        self._going_on, self._say = going_on, say
        self._loan: Loan | None = None
        self.release = ReleaseProof("")

    def run(self) -> AutopilotProfile:
        """Go through the list.

        Raises
        ------
        InputError
            At the first line that does not hold: nothing flies then.
        """
        profile, client = self.find()
        assert self._loan is not None
        self._loan.take(profile.changes, lambda changed: self._tell(_line(changed)))
        self._wait(
            lambda: self._link.telemetry.ready,
            "position estimate",
            lambda: self._ask_rates(profile),
        )
        self._tell(ChecklistItem("position estimate", "good"))
        if math.isnan(pace := self._pace_of(profile)):
            raise InputError(f"the autopilot tells no position, whatever it is asked{self._why()}")
        self._check_clock(pace)
        check = ReleaseCheck(client, self._link, self._flight, self._clock, self._listen)
        self.release = check.run()
        self._tell(ChecklistItem("release", self.release.text))
        self._check_load()
        return profile

    def find(self) -> tuple[AutopilotProfile, ParameterClient]:
        """Only look who is there; nothing is sent but heartbeats and requests.

        Raises
        ------
        InputError
            When it is nobody, or not who is expected.
        """
        profile = self._who()
        vehicle = self._identity(profile)
        client = ParameterClient(self._link, profile, self._clock, self._listen)
        self._loan = Loan(client, self._memory, vehicle, self._settings.url)
        return profile, client

    def look(self) -> None:
        """Only look who is there, and how fast their time passes, if they tell it already.

        Raises
        ------
        InputError
            When it is nobody, not who is expected, or as fast as nobody expects.
        """
        profile, _ = self.find()
        self._check_clock(self._pace_of(profile))

    @property
    def armed(self) -> bool:
        """Whether the vehicle flies, or may at any moment."""
        return self._link.telemetry.armed

    def restore(self, tell: Callable[[str], None] = lambda text: None) -> list[str]:
        """Give the autopilot its parameters back; what could not be given back."""
        self._going_on = lambda: True  # also when it is a signal that ends the bridge
        return [] if self._loan is None else self._loan.give_back(tell)

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

    def _identity(self, profile: AutopilotProfile) -> Identity:
        t, end = self._link.telemetry, self._clock.elapsed() + _VERSION
        asked = -math.inf
        while t.uid is None and (now := self._clock.elapsed()) < end:
            if now - asked > _AGAIN / 3.0:
                asked = now
                self._link.ask_version()
            self._listen()
        vehicle = Identity(profile.name, t.system, t.uid or "")
        number = f"number {t.uid}" if t.uid else "no number of its own"
        self._tell(ChecklistItem("identity", f"version {t.version or 'unknown'}, {number}"))
        return vehicle

    def _wait(
        self, ready: Callable[[], bool], what: str, ask: Callable[[], None], hint: str = ""
    ) -> None:
        """Wait for something, asking for it once a second, and saying so now and then."""
        begin = self._clock.elapsed()
        asked, said = -math.inf, begin - _NEWS + _FIRST
        while not ready():
            now = self._clock.elapsed()
            if now > begin + self._settings.patience:
                raise InputError(
                    f"no {what} within {self._settings.patience:g} s{self._why()}{hint}"
                )
            if now - asked > _AGAIN:
                asked = now
                ask()
            if now - said > _NEWS:
                said = now
                self._say("warning", f"waiting: no {what} yet{self._why()}{hint}")
            self._listen()

    def _why(self) -> str:
        """What was heard instead."""
        t, codec = self._link.telemetry, self._link.codec
        words = []
        if t.strangers:
            systems = ", ".join(map(str, sorted(t.strangers)))
            words.append(
                f"heard system {systems}, not {t.system}: set `system` (iolspi fly --bridge "
                f"system={min(t.strangers)})"
            )
        if codec.rejected and t.autopilot is None:
            words.append(f"{codec.rejected} packets were broken, unsigned or wrongly signed")
        if t.texts:
            words.append(f"the autopilot says: {t.texts[-1][2]}")
        if not words and not codec.received:
            words.append(f"nothing comes at {self._settings.url}; is an autopilot started there?")
        return "; " + "; ".join(words) if words else ""

    def _ask_rates(self, profile: AutopilotProfile) -> None:
        self._link.ask_rates(profile, felt=self._flight.load_share > 0.0)

    def _listen(self) -> None:
        if not self._going_on():
            raise InputError("interrupted")
        self._link.wait(0.02)
        self._link.poll(self._clock.now())

    # ------------------------------------------------------------ clock and load

    def _pace_of(self, profile: AutopilotProfile) -> float:
        """How fast the autopilot's clock goes; NaN when it tells no time.

        Measured again when that is not expected: a busy machine may stall a simulator for a moment.
        """
        self._ask_rates(profile)
        for _ in range(_TRIES):
            pace = self._pace()
            if abs(pace / self._flight.real_time_factor - 1.0) < _WRONG:
                break
        return pace

    def _check_clock(self, pace: float) -> None:
        """Whether the autopilot's clock goes as fast as we think, if it is known how fast."""
        factor = self._flight.real_time_factor
        if abs(pace / factor - 1.0) >= _WRONG:
            raise InputError(
                f"the autopilot's clock goes {pace:.2f} times as fast as ours, but {factor:g} is "
                f"expected; allowed: for a simulator iolspi fly --speed-up {max(round(pace), 1)} "
                "(real_time_factor of the bridge); for all that really flies 1.0"
            )
        told = "not told yet" if math.isnan(pace) else f"{pace:.2f} times ours"
        self._tell(ChecklistItem("clock", told))

    def _pace(self) -> float:
        t = self._link.telemetry
        start, boot = self._clock.elapsed(), t.boot
        while self._clock.elapsed() - start < _RUN:
            self._listen()
        return (t.boot - boot) / (self._clock.elapsed() - start)

    def _check_load(self) -> None:
        """Whether the load reports its position, if it is to."""
        if self._flight.load_source == "estimate":
            self._tell(ChecklistItem("load", self._estimated()))
            return
        t = self._link.telemetry
        begun = self._clock.now()
        self._wait(
            lambda: t.load_time > begun,
            f"position of the load from system {t.load_system}",
            lambda: None,
            "; it flies without one by iolspi fly --load estimate (load_source of the bridge)",
        )
        self._tell(ChecklistItem("load", f"reported by system {t.load_system}"))

    def _estimated(self) -> str:
        """By what the load is estimated, waiting a little for an accelerometer."""
        nobody = "estimated from the vehicle's acceleration, seen by nobody"
        if not self._flight.load_share:
            return nobody
        t, begun = self._link.telemetry, self._clock.elapsed()
        while math.isnan(t.force_boot) and self._clock.elapsed() - begun < _RUN:
            self._listen()
        if math.isnan(t.force_boot):
            return f"{nobody}: no SCALED_IMU comes, and load_share is not used"
        return "estimated, and felt by the accelerometer"


def _line(changed: Changed) -> ChecklistItem:
    was = "" if same(changed.before, changed.value) else f", was {changed.before:g}"
    return ChecklistItem(changed.name, f"{changed.value:g}{was}: {changed.why}")
