"""Whether the load will really fall: what the parameters say, and a release tried on the ground.

An acknowledgement proves nothing: ArduCopter gives one for a gripper that has no type, and PX4 for
one that is on no output. What an output does is seen in SERVO_OUTPUT_RAW.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.clock import Clock
from msg_bridge.mavlink.gripper import MOVED, Gripper
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.parameters import ParameterClient
from msg_bridge.mavlink.settings import FlightSettings

_LOOK = 1.5  # for an output to be heard of, and to move [s] of wall time
_ANSWER = 3.0  # for an acknowledgement [s] of wall time


class ReleaseProof(NamedTuple):
    """What is known before the flight.

    Attributes
    ----------
    text : str
        For people.
    output : int or None
        Which output to watch in flight, from 1; None where none is known.
    """

    text: str
    output: int | None = None


class ReleaseCheck:
    """Looks at what lets the load go.

    Parameters
    ----------
    client : ParameterClient
    link : AutopilotLink
    settings : FlightSettings
    clock : Clock
    listen : callable
        Lets a moment pass, and takes what has come.
    """

    def __init__(
        self,
        client: ParameterClient,
        link: AutopilotLink,
        settings: FlightSettings,
        clock: Clock,
        listen: Callable[[], None],
    ) -> None:
        self._client, self._link, self._clock, self._listen = client, link, clock, listen
        self._settings, self._profile = settings, client.profile
        self._gripper = Gripper(link, client.profile, settings)

    def run(self) -> ReleaseProof:
        """Look, and try it once where it may be tried.

        Raises
        ------
        InputError
            When nothing would fall, with what to do about it.
        """
        output = self._output()
        how = self._gripper.how + (f" on output {output}" if output else "")
        if self._link.telemetry.armed:
            return ReleaseProof(f"unproven: {how} is not tried while armed", output)
        if not self._settings.test_release:
            return ReleaseProof(f"unproven: {how} is not tried, as you wish", output)
        self._look(lambda: bool(self._link.telemetry.outputs), _LOOK)
        there = self._turn(open_it=True, output=output)
        back = self._turn(open_it=False, output=output)
        if there is not None and back is not None:
            words = f"{how} went from {there[0]} to {there[1]} µs and back; hang the load again"
            return ReleaseProof(words, output)
        return ReleaseProof(self._still(how, output), output)

    def _output(self) -> int | None:
        """Which output it is on, by the autopilot's parameters."""
        how, setup = self._gripper.how, self._profile.gripper
        if how == "servo":
            return self._settings.servo
        if how == "actuator":
            return None
        needed = [name for name, _ in setup.needs]
        found = self._client.read([*needed, *setup.outputs])
        wrong = [f"{name} to {good[0]:g}" for name, good in setup.needs
                 if found.get(name) not in good]  # fmt: skip
        outputs = [
            n for n, name in enumerate(setup.outputs, 1) if found.get(name) == setup.function
        ]
        if setup.moves_disarmed and not outputs:
            wrong.append(f"{setup.usual} (or that of another free output) to {setup.function:g}")
        if wrong:
            raise InputError(
                f"the gripper of {self._profile.name} would move nothing: set {', '.join(wrong)}, "
                "and restart the autopilot; or release otherwise (release: servo, actuator)"
            )
        return outputs[0] if outputs else None

    def _turn(self, *, open_it: bool, output: int | None) -> tuple[int, int] | None:
        """Open or shut it; widths of pulse before and after, None for nothing seen to move."""
        telemetry, gripper, name = self._link.telemetry, self._gripper, self._profile.name
        before, begin = telemetry.outputs, self._clock.now()
        gripper.turn(open_it=open_it, now=begin)

        def answered() -> bool:
            gripper.tick(self._clock.now())
            return gripper.result() is not None

        if not self._look(answered, _ANSWER):
            needed = " and ".join(f"{name} {good[0]:g}" for name, good in self._setup_needs())
            cure = f": with {needed} it wants to be restarted" if needed else ""
            raise InputError(f"the {gripper.how} of {name} does not answer{cure}")
        if why := gripper.refusal(self._clock.now()):
            raise InputError(f"{why}; nothing would fall")
        if output is None or len(before) < output:
            return None

        def moved() -> bool:
            return abs(telemetry.outputs[output - 1] - before[output - 1]) >= MOVED

        if not self._look(moved, _LOOK):
            return None
        return before[output - 1], telemetry.outputs[output - 1]

    def _setup_needs(self) -> tuple[tuple[str, tuple[float, ...]], ...]:
        return self._profile.gripper.needs if self._gripper.how == "gripper" else ()

    def _still(self, how: str, output: int | None) -> str:
        """What to say of something that says yes and is not seen to move.

        Raises
        ------
        InputError
            Where it would have been seen.
        """
        setup, gripper = self._profile.gripper, self._gripper.how == "gripper"
        seen = output is not None and len(self._link.telemetry.outputs) >= output
        if seen and (setup.moves_disarmed or not gripper):
            raise InputError(
                f"the {how} of {self._profile.name} says yes and does not move; restart the "
                "autopilot, if its parameters were set since it was"
            )
        if seen:
            return f"unproven yet: {how} says yes, and moves when armed; it is watched in flight"
        hint = f" (such as {setup.usual} {setup.function:g})" if gripper and setup.usual else ""
        return f"unproven: {how} says yes, and is on no output that could be seen to move{hint}"

    def _look(self, ready: Callable[[], bool], patience: float) -> bool:
        end = self._clock.elapsed() + patience
        while not ready():
            if self._clock.elapsed() >= end:
                return False
            self._listen()
        return True
