"""What the parts of a joystick are, found out by moving them one after the other. No ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEADY = 10
"""Messages in which nothing moves, after which it is held where it is."""
QUIET = 0.05
"""How far it may move in those."""
FAR = 0.3
"""How far from its rest an end is at least."""


class Calibration:
    """Asks for one movement after the other, and sees which part of the device makes it.

    Parameters
    ----------
    actions : sequence of int
        Actions that are to have a button.
    takeover : bool
        Whether to ask for the button that takes over.

    Attributes
    ----------
    question : str
        What the person is to do now; empty when all is known.
    found : str
        What the last answer was, in words.
    """

    def __init__(self, actions: Sequence[int] = (), *, takeover: bool = False) -> None:
        self._buttons: dict[int, int] = {}  # by the button: its action, -1 for the takeover
        self._questions = deque(
            ["let go of everything", "move the stick to the end of the first action, and hold it",
             "move it to the end of the last action, and hold it",
             *(f"press the button of action {action}" for action in actions),
             *(["press the button that takes over"] if takeover else [])]
        )  # fmt: skip
        self._wanted = deque([*actions, *([-1] if takeover else [])])
        self._window: deque[NDArray[np.float64]] = deque(maxlen=STEADY)
        self._rest: NDArray[np.float64] = np.zeros(0)
        self._noise = 0.0
        self._down: set[int] = set()
        self._axis, self._ends = -1, [0.0, 0.0]
        self.found = ""

    @property
    def question(self) -> str:
        """What to do now."""
        return self._questions[0] if self._questions else ""

    def take(self, axes: Sequence[float], buttons: Sequence[int]) -> bool:
        """Take where the parts are; whether the question is answered by that."""
        where = np.array(axes, float)
        if not self._questions or not np.isfinite(where).all():
            return False
        if self._window and len(self._window[-1]) != len(where):
            self._window.clear()  # another device
        self._window.append(where)
        pressed = {number for number, down in enumerate(buttons) if down}
        answered = self._answer(where, pressed - self._down)
        self._down = pressed
        if answered:
            self._questions.popleft()
            self._window.clear()
        return answered

    def _answer(self, where: NDArray[np.float64], pressed: set[int]) -> bool:
        if len(self._questions) <= len(self._wanted):
            return self._name(pressed)
        track = np.array(self._window)
        steady = len(track) == STEADY and bool((np.ptp(track, axis=0) < QUIET).all())
        if not steady or not len(where):
            return False
        if not len(self._rest):
            self._rest = track.mean(axis=0)
            self._noise = float(np.ptp(track, axis=0).max())
            self.found = f"it rests; {len(where)} axes"
            return True
        return self._end(where)

    def _end(self, where: NDArray[np.float64]) -> bool:
        """Whether the stick is held at the end that was asked for."""
        if len(where) != len(self._rest):
            return False
        off = where - self._rest
        first = self._axis < 0
        axis = int(np.abs(off).argmax()) if first else self._axis
        there = abs(off[axis]) > FAR if first else abs(where[axis] - self._ends[0]) > FAR
        if not there:
            return False
        self._axis = axis
        self._ends[0 if first else 1] = float(np.clip(where[axis], -1.0, 1.0))
        self.found = f"axis {axis} is at {where[axis]:.2f}"
        return True

    def _name(self, pressed: set[int]) -> bool:
        """Whether a button was pressed that has no meaning yet."""
        fresh = pressed - set(self._buttons)
        if not fresh:
            return False
        self._buttons[min(fresh)] = self._wanted.popleft()
        self.found = f"button {min(fresh)}"
        return True

    def parameters(self) -> dict[str, Any]:
        """Parameters of the demonstrator, once all is known: of `JoystickSettings`, mostly."""
        first, last = self._ends
        low, high = min(first, last), max(first, last)
        center = min(max(float(self._rest[self._axis]), low), high)
        zone = max(0.1, 2.0 * self._noise / (high - low))
        found: dict[str, Any] = {
            "joy_axis": self._axis, "joy_inverted": first > last, "joy_low": [round(low, 3)],
            "joy_center": [round(center, 3)], "joy_high": [round(high, 3)],
            "joy_dead_zone": [round(zone, 3)],
        }  # fmt: skip
        actions = {button: action for button, action in self._buttons.items() if action >= 0}
        if actions:
            found["joy_buttons"] = [actions.get(n, -1) for n in range(max(actions) + 1)]
        for button, action in self._buttons.items():
            if action < 0:
                found["takeover_button"] = button
        return found
