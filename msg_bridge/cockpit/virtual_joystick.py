"""Who has the stick, and where it is: one browser flies, the others watch and may ask."""

from __future__ import annotations

from dataclasses import dataclass, field

SILENCE, LOST = 0.2, 3.0
"""Seconds without a word of the browser that has the stick, after which it lets go: of the
deflection, as if it was centred and nobody had it; of the stick itself."""


@dataclass(frozen=True)
class Deflection:
    """Where a stick is.

    Attributes
    ----------
    axes : (float, float)
        To the left and upwards, each -1 to 1, as joystick drivers have it.
    buttons : tuple of int
        One for each action, 1 while it is held, and last that of the takeover.
    """

    axes: tuple[float, float] = (0.0, 0.0)
    buttons: tuple[int, ...] = ()


@dataclass
class Stick:
    """The one stick of a cockpit.

    Attributes
    ----------
    holder : int, optional
        The browser that has it.
    asking : list of int
        Browsers that want it, in order.
    at : Deflection
    heard : float
        When the holder last said where it is [s].
    quiet : bool
        Whether it has let go for want of words.
    """

    holder: int | None = None
    asking: list[int] = field(default_factory=list)
    at: Deflection = Deflection()
    heard: float = 0.0
    quiet: bool = False

    def ask(self, browser: int, now: float) -> None:
        """Give the stick to a browser if nobody has it; else it stands in line."""
        if browser != self.holder and browser not in self.asking:
            self.asking.append(browser)
        if self.holder is None:
            self._hand_on(now)

    def leave(self, browser: int, now: float) -> bool:
        """Let a browser put it down, or be gone: whoever asked first has it then.

        Returns
        -------
        bool
            Whether it had it.
        """
        if browser in self.asking:
            self.asking.remove(browser)
        if browser != self.holder:
            return False
        self._hand_on(now)
        return True

    def move(self, browser: int, at: Deflection, now: float) -> bool:
        """Take where a browser says that its stick is; whether it had it."""
        if browser != self.holder:
            return False
        self.at, self.heard, self.quiet = at, now, False
        return True

    def silent(self, now: float) -> bool:
        """Whether nothing was heard for too long: it is centred then, until there is a word."""
        if self.holder is None or now - self.heard <= SILENCE:
            return False
        self.at, self.quiet = Deflection(), True
        return True

    def lost(self, now: float) -> bool:
        """Whether nothing was heard for so long that somebody else may have it."""
        return self.holder is not None and now - self.heard > LOST

    def _hand_on(self, now: float) -> None:
        self.holder = self.asking.pop(0) if self.asking else None
        self.at, self.heard, self.quiet = Deflection(), now, False
