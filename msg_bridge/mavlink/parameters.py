"""An autopilot's parameters: read, changed while the bridge flies, and given back."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.clock import Clock
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.memory import Identity, Memory, Remembered, same
from msg_bridge.mavlink.profiles import AutopilotProfile, ParameterChange
from msg_bridge.mavlink.telemetry import parameter_value

_AGAIN = 0.3  # between two requests of the same [s] of wall time
_ANSWER = 3.0  # for a parameter [s]


class Changed(NamedTuple):
    """A parameter that has another value now, or had it already."""

    name: str
    value: float
    before: float
    why: str


class ParameterClient:
    """Asks an autopilot, waiting for each answer.

    Parameters
    ----------
    link : AutopilotLink
    profile : AutopilotProfile
    clock : Clock
    listen : callable
        Lets a moment pass, and takes what has come.
    """

    def __init__(
        self,
        link: AutopilotLink,
        profile: AutopilotProfile,
        clock: Clock,
        listen: Callable[[], None],
    ) -> None:
        self._link, self.profile, self._clock, self._listen = link, profile, clock, listen

    def read(self, names: Sequence[str], patience: float = _ANSWER) -> dict[str, float]:
        """Those of some parameters that answer within a time [s] of wall time; all at once."""
        heard = self._link.telemetry.parameters
        for name in names:
            heard.pop(name, None)

        def ask() -> None:
            for name in names:
                if name not in heard:
                    self._link.read_parameter(name)

        self._until(lambda: all(name in heard for name in names), ask, patience)
        return {name: parameter_value(self.profile, *heard[name]) for name in names
                if name in heard}  # fmt: skip

    def first(self, names: Sequence[str]) -> tuple[str, float]:
        """The first of the names of one parameter that is answered, and its value.

        Raises
        ------
        InputError
            When none is.
        """
        heard = self._link.telemetry.parameters
        for name in names:
            heard.pop(name, None)

        def ask() -> None:
            for name in names:
                self._link.read_parameter(name)

        self._until(lambda: any(name in heard for name in names), ask, _ANSWER)
        for name in names:
            if name in heard:
                return name, parameter_value(self.profile, *heard[name])
        raise InputError(
            f"parameter {' or '.join(names)} of {self.profile.name} cannot be read; without it "
            "nothing flies"
        )

    def set(self, name: str, value: float) -> None:
        """Set a parameter, unless it has that value.

        Raises
        ------
        InputError
            When that cannot be seen to have happened.
        """
        _, present = self.first([name])
        if same(present, value):
            return
        heard = self._link.telemetry.parameters
        kind = heard.pop(name)[1]

        def done() -> bool:
            return name in heard and same(parameter_value(self.profile, *heard[name]), value)

        def ask() -> None:
            self._link.set_parameter(self.profile, name, value, kind)

        if not self._until(done, ask, _ANSWER):
            raise InputError(f"parameter {name} of {self.profile.name} cannot be set to {value:g}")

    def _until(self, ready: Callable[[], bool], ask: Callable[[], None], patience: float) -> bool:
        end, asked = self._clock.elapsed() + patience, -math.inf
        while not ready():
            now = self._clock.elapsed()
            if now >= end:
                return False
            if now - asked > _AGAIN:
                asked = now
                ask()
            self._listen()
        return True


class Loan:
    """Parameters that a vehicle has lent: changed, remembered, and given back.

    Parameters
    ----------
    client : ParameterClient
    memory : Memory
    vehicle : Identity
    url : str
        Where it is now, for people.
    """

    def __init__(
        self, client: ParameterClient, memory: Memory, vehicle: Identity, url: str
    ) -> None:
        self._client, self._memory, self._vehicle, self._url = client, memory, vehicle, url

    def take(self, changes: Sequence[ParameterChange], tell: Callable[[Changed], None]) -> None:
        """Set what has to be, after writing down what was.

        Raises
        ------
        InputError
            When a parameter cannot be read or set.
        """
        remembered = self._memory.of(self._vehicle, self._url)
        found: list[Changed] = []
        for change in changes:
            name, value = self._client.first(change.names)
            # Ours still: a bridge that was killed set it, and wrote down what was before.
            ours = same(value, remembered.changed.get(name, change.value))
            before = remembered.before.get(name, value) if ours else value
            found.append(Changed(name, change.value, before, change.why))
        remembered.before.update({one.name: one.before for one in found})
        remembered.changed.update({one.name: one.value for one in found})
        self._keep(remembered)
        for one in found:
            try:
                self._client.set(one.name, one.value)
            except InputError:
                # What it took instead is our doing, too, and to be given back.
                remembered.changed.update(self._client.read([one.name]))
                self._keep(remembered)
                raise
            tell(one)

    def _keep(self, remembered: Remembered) -> None:
        try:
            self._memory.keep(self._vehicle, self._url, remembered)
        except OSError as error:
            raise InputError(
                f"what the parameters were cannot be written down in {self._memory.folder}: "
                f"{error.strerror or error}; nothing is changed without that"
            ) from error

    def give_back(self, tell: Callable[[str], None] = lambda text: None) -> list[str]:
        """Set what is remembered, and forget it; what could not be given back.

        What has another value now than a bridge gave it was changed by somebody else since, and
        is left as it is.
        """
        remembered = self._memory.of(self._vehicle, self._url)
        failed: list[str] = []
        for name, before in remembered.before.items():
            if failed:
                failed.append(f"parameter {name} was {before:g}")
                continue
            try:
                _, value = self._client.first([name])
                ours = remembered.changed.get(name, value)
                if same(value, before):
                    tell(f"{name} is {value:g}, as it was")
                elif not same(value, ours):
                    tell(f"{name} is {value:g}, which no bridge has set: left (it was {before:g})")
                else:
                    self._client.set(name, before)
                    tell(f"{name} is {before:g} again, was {value:g}")
            except InputError as error:
                failed.append(f"{error} (it was {before:g})")
        if not failed:
            try:
                self._memory.forget(self._vehicle)
            except OSError as error:
                failed.append(f"all is given back, and still written down: {error}; delete that")
        return failed
