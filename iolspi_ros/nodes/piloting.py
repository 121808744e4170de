"""A demonstration by a person, in phases; what was flown, and what is kept of it. No ROS here."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from iolspi_ros.core.samples import Sample
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.joystick import Joystick
from iolspi_ros.settings import Settings, setting
from iolspi_ros.wire import Phase


@dataclass(frozen=True)
class PilotingSettings(Settings):
    """How a person's demonstration begins, and who judges it."""

    countdown: float = setting(
        3.0, "joy: seconds of wall time from the first movement to the flight; 0.0 for none",
        low=0.0, high=60.0,
    )  # fmt: skip
    review: bool = setting(
        False, "joy: hold each episode back until ~/keep or ~/discard, and all until ~/finish"
    )
    foresight: bool = setting(
        True, "joy, review: learn from what is kept, in a process beside, and say what comes of it"
    )


@dataclass
class Flown:
    """An episode as it was flown.

    Attributes
    ----------
    episode : int
    records : list of (str, str, int, bytes)
        For the bag: topic, type, stamp [ns], message.
    samples : list of (Sample, bytes)
    marked : str
        Why it is not kept by itself; empty for no reason.
    """

    episode: int
    records: list[tuple[str, str, int, bytes]] = field(default_factory=list)
    samples: list[tuple[Sample, bytes]] = field(default_factory=list)
    marked: str = ""

    @property
    def last(self) -> tuple[int, int]:
        """Step and stamp [ns] of its last sample."""
        return (self.samples[-1][0].step, self.samples[-1][0].stamp) if self.samples else (0, 0)


class Piloting:
    """Which phase follows which; times are of the machine's steady clock.

    Parameters
    ----------
    settings : PilotingSettings
    n_episodes : int
        How many to fly; with review a person says when it is enough.
    stick : Joystick
    clock : callable

    Attributes
    ----------
    phase : Phase
    kept, discarded : int
    undecided : list of Flown
        Episodes that wait for a verdict; the next is about the last of them.
    judged : list of (Flown, bool)
        With a person's verdicts, the latest at the end.
    """

    def __init__(
        self, settings: PilotingSettings, n_episodes: int, stick: Joystick,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self._settings, self._n_episodes, self._stick = settings, n_episodes, stick
        self._clock = clock
        self.phase = Phase.NO_STICK
        self._until = 0.0
        self.kept = self.discarded = 0
        self.undecided: list[Flown] = []
        self.judged: list[tuple[Flown, bool]] = []

    @property
    def review(self) -> bool:
        """Whether a person judges each episode."""
        return self._settings.review

    @property
    def countdown(self) -> float:
        """Seconds until the flight may begin."""
        return max(self._until - self._clock(), 0.0) if self.phase is Phase.COUNTDOWN else 0.0

    @property
    def holds(self) -> bool:
        """Whether the vehicle is the person's."""
        return self.phase in (Phase.COUNTDOWN, Phase.FLYING, Phase.REVIEW, Phase.PAUSED)

    @property
    def ready(self) -> bool:
        """Whether it may begin with the next episode that does."""
        return self.phase is Phase.COUNTDOWN and self.countdown == 0.0

    def look(self) -> None:
        """Go on where the stick says so."""
        if self._stick.silent:
            if self.phase is Phase.FLYING:
                self.phase = Phase.PAUSED
            elif self.phase in (Phase.WAITING, Phase.COUNTDOWN):
                self.phase = Phase.NO_STICK
            return
        if self.phase is Phase.NO_STICK:
            self._stick.settle()
            self.phase = Phase.WAITING
        elif self.phase is Phase.WAITING and self._stick.moved:
            self._count_down()

    def _count_down(self) -> None:
        self.phase, self._until = Phase.COUNTDOWN, self._clock() + self._settings.countdown

    def _wait(self) -> None:
        """For the stick to move, once more."""
        self.phase = Phase.NO_STICK
        self.look()

    def begin(self) -> None:
        """An episode begins, and the person flies it."""
        self.phase = Phase.FLYING

    def interrupt(self) -> None:
        """Nothing is flown any more for now; what was begun is lost."""
        if self.phase not in (Phase.ENDED, Phase.REVIEW):
            self.phase = Phase.NO_STICK

    def landed(self, flown: Flown, *, whole: bool = True) -> bool | None:
        """An episode is over; whether it is kept, None for not decided yet.

        One that the vehicle broke off is not `whole`: it does not count where nobody judges.
        """
        if self._settings.review:
            self.undecided.append(flown)
            self.phase = Phase.REVIEW
            return None
        kept = not flown.marked
        self._count(kept, int(whole))
        if self.kept >= self._n_episodes:
            self.phase = Phase.ENDED
        elif self.phase is Phase.PAUSED:
            self._wait()
        return kept

    def _count(self, kept: bool, change: int) -> None:
        self.kept += change * kept
        self.discarded += change * (not kept)

    # ------------------------------------------------------------ verdicts

    def judge(self, kept: bool) -> Flown:
        """Keep the last episode that is not decided, or discard it.

        Raises
        ------
        InputError
            When there is none.
        """
        self._check_review()
        if not self.undecided:
            raise InputError("no episode waits for a verdict; allowed: after one has been flown")
        flown = self.undecided.pop()
        self.judged.append((flown, kept))
        self._count(kept, 1)
        if self.phase is Phase.REVIEW and not self.undecided:
            self._count_down()
        return flown

    def undo(self) -> tuple[Flown, bool]:
        """Take the last verdict back: its episode waits for another.

        Returns
        -------
        flown : Flown
        kept : bool
            What the verdict was.

        Raises
        ------
        InputError
            When there was none.
        """
        self._check_review()
        if not self.judged:
            raise InputError("there was no verdict yet; allowed: after ~/keep or ~/discard")
        flown, kept = self.judged.pop()
        self._count(kept, -1)
        self.undecided.append(flown)
        if self.phase not in (Phase.FLYING, Phase.PAUSED):
            self.phase = Phase.REVIEW
        return flown, kept

    def finish(self) -> list[Flown]:
        """End with what was kept, in the order in which it was flown.

        Raises
        ------
        InputError
            When nothing was kept.
        """
        self._check_review()
        kept = sorted((flown for flown, kept in self.judged if kept), key=lambda f: f.episode)
        if not kept:
            raise InputError("no episode is kept; allowed: ~/finish after ~/keep")
        self.phase = Phase.ENDED
        return kept

    def _check_review(self) -> None:
        if not self._settings.review:
            raise InputError("parameter review is false; allowed: review:=true for verdicts")
        if self.phase is Phase.ENDED:
            raise InputError("the demonstration has ended; allowed: before ~/finish")
