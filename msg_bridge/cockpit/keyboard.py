"""A terminal's keyboard as a stick. No ROS here.

A terminal says when a key is pressed and never when it is let go: while it is held the key comes
again and again, after a pause at first. So a key is taken to be held until it has not come again
for that long: one that is tapped stays for 0.7 s, one that was held for 0.15 s more.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from msg_bridge.cockpit.virtual_joystick import Deflection

FIRST, AGAIN = 0.7, 0.15
"""Seconds that a key holds when it comes for the first time, and when it comes again: terminals
wait up to 0.66 s before they repeat, and then do so 10 to 40 times a second."""
ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_OPPOSITE = {"up": "down", "down": "up", "left": "right", "right": "left"}
_KEY = re.compile(r"\x1b[\[O](?:1;\d)?(?P<arrow>[ABCD])|\x1b\[[0-9;]*[~A-Za-z]|(?P<key>[^\x1b])")
LET_GO, TAKEOVER = "0", " "
VERDICTS = {"k": "keep", "d": "discard", "u": "undo", "f": "finish"}


def keys(text: str) -> Iterator[str]:
    """The keys in what a terminal sent; what is none that is known is left out."""
    for found in _KEY.finditer(text):
        if found["arrow"]:
            yield ARROWS[found["arrow"]]
        elif found["key"]:
            yield found["key"].lower()


class Keyboard:
    """Where the stick is that some keys are.

    Parameters
    ----------
    n_actions : int
        The keys 1, 2, … are their buttons.
    """

    def __init__(self, n_actions: int) -> None:
        self._numbers = [str(n + 1) for n in range(min(n_actions, 9))]
        self._n_actions = n_actions
        self._until: dict[str, float] = {}
        self._came: dict[str, float] = {}
        self.takes_over = False

    def press(self, key: str, now: float) -> None:
        """A key came, at a time [s]."""
        if key == TAKEOVER:
            self.takes_over = not self.takes_over
        elif key == LET_GO:
            self._until.clear()
        elif key in _OPPOSITE or key in self._numbers:
            again = now - self._came.get(key, -FIRST) < FIRST
            self._came[key], self._until[key] = now, now + (AGAIN if again else FIRST)
            self._until.pop(_OPPOSITE.get(key, ""), None)

    def at(self, now: float) -> Deflection:
        """Where the stick is at a time [s], as the page's: see `joy` in docs/interfaces.md."""
        held = {key for key, until in self._until.items() if now < until}
        x = ("left" in held) - ("right" in held)
        y = ("up" in held) - ("down" in held)
        buttons = [int(str(n + 1) in held) for n in range(self._n_actions)]
        return Deflection((float(x), float(y)), (*buttons, int(self.takes_over)))
