"""Letting the load go: gripper, servo and actuator, each as its autopilot answers them."""

from __future__ import annotations

from collections.abc import Callable

from sim_nodes.autopilot.body import Body
from sim_nodes.autopilot.commander import INFO, Result
from sim_nodes.autopilot.figures import FIGURES
from sim_nodes.autopilot.parameters import Parameters

_GRIPPER_FUNCTION = {"ardupilot": 28, "px4": 430}
_GRIPPER_CHANNEL = {"ardupilot": 9, "px4": 5}
_SERVO_GRIPPER = 1  # of GRIP_TYPE
_NEAR = 100  # of a width of pulse that moves it [µs]; chosen
_MOVES_AFTER = 0.03  # a pulse has changed [s]; measured: within 0.05 s
_SAID_AFTER = FIGURES["ardupilot"]["gripper speaks"].value

Later = Callable[[float, Callable[[], None]], None]


class Release:
    """What holds the load.

    To let go is 0 (RELEASE) of the gripper's actions; 1 (GRAB) hangs a new load on the cable, as a
    ground crew would, so that the next episode can begin.

    Parameters
    ----------
    parameters, body
    say : callable
        Takes a severity and a text.
    later : callable
        Takes a time from now [s] and what to do then.
    """

    def __init__(
        self,
        parameters: Parameters,
        body: Body,
        say: Callable[[int, str], None],
        later: Later,
    ) -> None:
        self._parameters, self._body, self._say = parameters, body, say
        self._later = later
        self.servos = [0] * 12
        """Widths of pulse of channels 5 to 16 [µs]."""
        self._grabs: bool | None = True
        self._doing: tuple[int, Callable[[Result], None]] | None = None
        self._works = self._worked_at_boot()
        if "GRIP_NEUTRAL" in parameters and self._works:
            self._pulse(_GRIPPER_CHANNEL["ardupilot"], int(parameters["GRIP_NEUTRAL"]))

    def _worked_at_boot(self) -> bool:
        """Whether there is a gripper: what was set since the boot does not count."""
        value = self._parameters
        if "PD_GRIPPER_EN" in value:
            return bool(value["PD_GRIPPER_EN"])
        return bool(
            value["GRIP_ENABLE"]
            and value["GRIP_TYPE"] == _SERVO_GRIPPER
            and value["SERVO9_FUNCTION"] == _GRIPPER_FUNCTION["ardupilot"]
        )

    def _set(self, opens: bool) -> None:
        if self._parameters["SIM_GRIP_FAIL"] != 2:
            (self._body.release if opens else self._body.hang)()

    def _pulse(self, channel: int, width: int) -> None:
        self.servos[channel - 5] = width

    def gripper_of_ardupilot(self, action: int) -> Result:
        """DO_GRIPPER: with no gripper of a type that it booted with it says yes, and does nothing.

        Measured: without `GRIP_TYPE`, and without a restart, it was just so.
        """
        wanted = {0: "GRIP_RELEASE", 1: "GRIP_GRAB"}.get(action)
        refuses = self._parameters["SIM_GRIP_FAIL"] == 1
        if wanted is None or refuses or not self._parameters["GRIP_ENABLE"]:
            return Result.FAILED
        if not self._works:
            return Result.ACCEPTED

        def move() -> None:
            self._pulse(_GRIPPER_CHANNEL["ardupilot"], int(self._parameters[wanted]))
            self._set(action == 0)

        done = "released" if action == 0 else "grabbed"
        self._say(INFO, f"Gripper load {'releasing' if action == 0 else 'grabbing'}")
        self._later(_MOVES_AFTER, move)
        self._later(_SAID_AFTER, lambda: self._say(INFO, f"Gripper load {done}"))
        return Result.ACCEPTED

    def servo_of_ardupilot(self, channel: int, width: float) -> Result:
        """DO_SET_SERVO: any width on a channel that no motor is on."""
        if not 5 <= channel <= 16 or self._parameters["SIM_GRIP_FAIL"] == 1:
            return Result.FAILED
        if 0 <= width <= 65535:
            self._pulse(channel, int(width))
        if channel == _GRIPPER_CHANNEL["ardupilot"]:
            opens = abs(width - self._parameters["GRIP_RELEASE"]) <= _NEAR
            if opens or abs(width - self._parameters["GRIP_GRAB"]) <= _NEAR:
                self._later(_MOVES_AFTER, lambda: self._set(opens))
        return Result.ACCEPTED

    def gripper_of_px4(
        self, action: int, answer: Callable[[Result], None], armed: bool
    ) -> Result | None:
        """DO_GRIPPER: nothing that it did not boot with answers; else by what it is doing.

        In progress at once, and done after `PD_GRIPPER_TO`, moved or not: measured. What is asked
        for meanwhile is answered as in its source (`payload_deliverer.cpp`): the same is rejected,
        the opposite cancels it. An output with the gripper's function moves while it is armed.
        """
        if not self._works:
            return None
        if action not in (0, 1):
            return Result.DENIED
        if self._parameters["SIM_GRIP_FAIL"] == 1:
            return Result.FAILED
        grabs = bool(action)
        if self._doing is not None:
            if self._doing[0] == action:
                return Result.TEMPORARILY_REJECTED
            self._doing[1](Result.CANCELLED)
        elif self._grabs == grabs:
            return Result.ACCEPTED
        doing = (action, answer)
        self._doing, self._grabs = doing, None

        def done() -> None:
            if self._doing is doing:
                self._doing, self._grabs = None, grabs
                answer(Result.ACCEPTED)

        self._later(_MOVES_AFTER, lambda: self._turn(grabs, armed))
        self._later(float(self._parameters["PD_GRIPPER_TO"]), done)
        return Result.IN_PROGRESS

    def _turn(self, grabs: bool, armed: bool) -> None:
        if self._parameters["PWM_MAIN_FUNC5"] == _GRIPPER_FUNCTION["px4"] and armed:
            self._pulse(_GRIPPER_CHANNEL["px4"], 2000 if grabs else 1000)
        self._set(not grabs)

    def actuator_of_px4(self, value: float) -> Result:
        """DO_SET_ACTUATOR, the first of its first set: open from 0.5 on, shut up to -0.5."""
        if self._parameters["SIM_GRIP_FAIL"] == 1:
            return Result.FAILED
        if abs(value) >= 0.5:
            self._later(_MOVES_AFTER, lambda: self._set(value > 0.0))
        return Result.ACCEPTED
