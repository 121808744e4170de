"""What the thesis says in words, decided from data: by intervals, not by eye."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.statistics import Interval

OURS = "not in T"
"""Place of a claim that is ours."""


class Verdict(Enum):
    """Of a claim, or of a part of it."""

    REPRODUCED = "reproduced"
    PARTLY = "partly"
    """Some parts hold and others do not, or an interval leaves it open."""
    NOT = "not"


@dataclass(frozen=True)
class Finding:
    """One thing measured, and whether it is as the claim says.

    Attributes
    ----------
    what : str
        With its unit.
    measured : Interval
    expected : str
        What the claim wants of it, such as "> 0".
    verdict : Verdict
    """

    what: str
    measured: Interval
    expected: str
    verdict: Verdict

    def describe(self) -> str:
        """One line for a person."""
        mean, low, high = (_number(value, self.measured) for value in self.measured)
        return f"{self.what}: {mean} ({low} to {high}; wanted {self.expected})"


@dataclass(frozen=True)
class Claim:
    """A sentence of T, and how data decide it.

    Attributes
    ----------
    text : str
        T's statement, shortened.
    where : str
        Section or page, and figure; `OURS` for what T does not say.
    setting : str
        In a few words.
    decide : callable
        From the results of the study's cells to one finding for each part of the claim.
    why : str
        As far as measured, when it is not reproduced, or not in full; which parts those are is
        said anyway.
    """

    text: str
    where: str
    setting: str
    decide: Callable[[Data], list[Finding]]
    why: str = ""


def verdict(findings: list[Finding]) -> Verdict:
    """Of a whole claim: reproduced or not when all its parts are, else partly."""
    found = {finding.verdict for finding in findings}
    return found.pop() if len(found) == 1 else Verdict.PARTLY


def shortfall(findings: list[Finding]) -> str:
    """Which parts of a claim do not hold, and which are left open; empty when all hold."""
    said = []
    for kind, text in ((Verdict.NOT, "does not hold"), (Verdict.PARTLY, "left open")):
        parts = [finding.what for finding in findings if finding.verdict is kind]
        if parts:
            said.append(f"{text}: {'; '.join(parts)}")
    return ". ".join(said)


def above(what: str, measured: Interval, limit: float = 0.0) -> Finding:
    """Wanted larger than a limit: the whole interval of it."""
    holds = _decide(measured.low > limit, measured.high < limit)
    return Finding(what, measured, f"> {limit:g}", holds)


def below(what: str, measured: Interval, limit: float = 0.0) -> Finding:
    """Wanted smaller than a limit: the whole interval of it."""
    holds = _decide(measured.high < limit, measured.low > limit)
    return Finding(what, measured, f"< {limit:g}", holds)


def within(what: str, measured: Interval, low: float, high: float) -> Finding:
    """Wanted between two limits, such as a difference that is too small to matter."""
    inside = low <= measured.low and measured.high <= high
    outside = measured.high < low or measured.low > high
    return Finding(what, measured, f"{low:g} to {high:g}", _decide(inside, outside))


def _decide(holds: bool, fails: bool) -> Verdict:
    if holds:
        return Verdict.REPRODUCED
    return Verdict.NOT if fails else Verdict.PARTLY


def _number(value: float, beside: Interval) -> str:
    """As many digits as the interval's width makes sense of."""
    width = beside.high - beside.low
    if not np.isfinite(value):
        return f"{value}"
    digits = 2 if width <= 0 else int(np.clip(1 - np.floor(np.log10(width)), 0, 6))
    return f"{value:,.{digits}f}"
