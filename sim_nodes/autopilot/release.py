"""Letting the load go: gripper, servo and actuator, each as its autopilot answers them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim_nodes.autopilot.body import Body
from sim_nodes.autopilot.commander import INFO, Result
from sim_nodes.autopilot.parameters import Parameters

_GRIPPER_FUNCTION = 28
_GRIPPER_CHANNEL = 9
_NEAR = 100  # of a width of pulse that moves it [µs]; chosen
_MOVES_AFTER = 0.03  # a pulse has changed [s]; measured: within 0.05 s
_SAID_AFTER = 0.56  # measured [s]

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
    rng : numpy.random.Generator
        Draws how long the answer takes where it was seen to vary.
    """

    def __init__(
        self,
        parameters: Parameters,
        body: Body,
        say: Callable[[int, str], None],
        later: Later,
        rng: np.random.Generator,
    ) -> None:
        self._parameters, self._body, self._say = parameters, body, say
        self._later, self._rng = later, rng
        self.servos = [0] * 12
        """Widths of pulse of channels 5 to 16 [µs]."""
        self._enabled = bool(parameters["GRIP_ENABLE"]) if "GRIP_ENABLE" in parameters else True
        if "GRIP_GRAB" in parameters and self._enabled:
            self._pulse(_GRIPPER_CHANNEL, int(parameters["GRIP_GRAB"]))

    def _set(self, opens: bool) -> None:
        if self._parameters["SIM_GRIP_FAIL"] != 2:
            (self._body.release if opens else self._body.hang)()

    def _pulse(self, channel: int, width: int) -> None:
        self.servos[channel - 5] = width

    def gripper_of_ardupilot(self, action: int) -> Result:
        """DO_GRIPPER: enabled and not yet booted with it, it says yes and does nothing."""
        wanted = {0: "GRIP_RELEASE", 1: "GRIP_GRAB"}.get(action)
        refuses = self._parameters["SIM_GRIP_FAIL"] == 1
        if wanted is None or refuses or not self._parameters["GRIP_ENABLE"]:
            return Result.FAILED
        if not self._enabled or self._parameters["SERVO9_FUNCTION"] != _GRIPPER_FUNCTION:
            return Result.ACCEPTED

        def move() -> None:
            self._pulse(_GRIPPER_CHANNEL, int(self._parameters[wanted]))
            self._set(action == 0)

        done = "released" if action == 0 else "grabbed"
        self._later(_MOVES_AFTER, move)
        self._later(_SAID_AFTER, lambda: self._say(INFO, f"Gripper load {done}"))
        return Result.ACCEPTED

    def servo_of_ardupilot(self, channel: int, width: float) -> Result:
        """DO_SET_SERVO: any width on a channel that no motor is on."""
        if not 5 <= channel <= 16 or self._parameters["SIM_GRIP_FAIL"] == 1:
            return Result.FAILED
        if 0 <= width <= 65535:
            self._pulse(channel, int(width))
        if channel == _GRIPPER_CHANNEL:
            opens = abs(width - self._parameters["GRIP_RELEASE"]) <= _NEAR
            if opens or abs(width - self._parameters["GRIP_GRAB"]) <= _NEAR:
                self._later(_MOVES_AFTER, lambda: self._set(opens))
        return Result.ACCEPTED

    def gripper_of_px4(self, action: int, answer: Callable[[Result], None]) -> Result:
        """DO_GRIPPER: in progress at once, done after more than a second, moved or not."""
        if action not in (0, 1):
            return Result.DENIED
        if self._parameters["SIM_GRIP_FAIL"] == 1:
            return Result.FAILED
        self._later(_MOVES_AFTER, lambda: self._set(action == 0))
        took = float(self._rng.uniform(1.0, 1.5))  # measured
        self._later(took, lambda: answer(Result.ACCEPTED))
        return Result.IN_PROGRESS

    def actuator_of_px4(self, value: float) -> Result:
        """DO_SET_ACTUATOR, the first of its first set: open from 0.5 on, shut up to -0.5."""
        if self._parameters["SIM_GRIP_FAIL"] == 1:
            return Result.FAILED
        if abs(value) >= 0.5:
            self._later(_MOVES_AFTER, lambda: self._set(value > 0.0))
        return Result.ACCEPTED
