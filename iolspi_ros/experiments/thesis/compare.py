"""The comparisons that claims about learning curves are made of.

Each function returns a claim's `decide`. Times are those of a 600 s run. What is measured is a
difference of two means over a stretch of time, realisation by realisation, unless it says
otherwise; `what` is "discounted", "score", "upright" or "whole" (see `pendulum.learn`).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from iolspi_ros.experiments.cells import Data
from iolspi_ros.experiments.statistics import Interval, difference, interval
from iolspi_ros.experiments.thesis import claims
from iolspi_ros.experiments.thesis.claims import Finding
from iolspi_ros.experiments.thesis.curves import over

Span = tuple[float, float]
Decide = Callable[[Data], list[Finding]]

WHOLE: Span = (0.0, 600.0)
END: Span = (500.0, 600.0)
_NAMES = {
    "discounted": "discounted return",
    "score": "learning score",
    "upright": "share of the last 0.5 s upright",
    "whole": "share of episodes that end upright",
}


def every(*parts: Decide) -> Decide:
    """All the findings of some comparisons."""
    return lambda data: [finding for part in parts for finding in part(data)]


def higher(first: str, others: str | tuple[str, ...], what: str, span: Span = WHOLE) -> Decide:
    """The first is above each of the others."""

    def decide(data: Data) -> list[Finding]:
        return [
            claims.above(f"{first} minus {other}, {_of(what, span)}", gain)
            for other in _several(others)
            for gain in [difference(over(data, first, what, *span), over(data, other, what, *span))]
        ]

    return decide


def lower(first: str, others: str | tuple[str, ...], what: str, span: Span = WHOLE) -> Decide:
    """The first is below each of the others."""
    return every(*(higher(other, first, what, span) for other in _several(others)))


def similar(
    first: str,
    others: str | tuple[str, ...],
    what: str,
    span: Span = END,
    margin: float = 0.02,
) -> Decide:
    """The first differs from each of the others by less than a share of the other's mean."""

    def decide(data: Data) -> list[Finding]:
        return [
            claims.within(*_relative(data, first, other, what, span), -100.0 * margin,
                          100.0 * margin)
            for other in _several(others)
        ]  # fmt: skip

    return decide


def reaches(first: str, other: str, what: str, span: Span = END, margin: float = 0.03) -> Decide:
    """The first comes up to the other, but for a share of the other's mean, or beyond it."""
    return lambda data: [claims.above(*_relative(data, first, other, what, span), -100.0 * margin)]


def rises(
    labels: str | tuple[str, ...], what: str, before: Span, after: Span, by: float = 0.0
) -> Decide:
    """Each is higher in the second stretch than in the first, by more than so much."""

    def decide(data: Data) -> list[Finding]:
        found = []
        for label in _several(labels):
            change = difference(over(data, label, what, *after), over(data, label, what, *before))
            name = f"{label}: {_of(what, after)} minus {_span(before)}"
            found.append(claims.above(name, change, by))
        return found

    return decide


def falls(labels: str | tuple[str, ...], what: str, before: Span, after: Span) -> Decide:
    """Each is lower in the second stretch than in the first."""
    return every(*(rises(label, what, after, before) for label in _several(labels)))


def steady(label: str, what: str, before: Span, after: Span, margin: float) -> Decide:
    """It changes by less than a share of its mean from the first stretch to the second."""

    def decide(data: Data) -> list[Finding]:
        first = over(data, label, what, *before)
        change = difference(over(data, label, what, *after), first)
        relative = Interval(*(100.0 * c / abs(first.mean()) for c in change))
        name = f"{label}: {_of(what, after)} minus {_span(before)} [%]"
        return [claims.within(name, relative, -100.0 * margin, 100.0 * margin)]

    return decide


def near_best(label: str, what: str, span: Span, ratio: float) -> Decide:
    """Its cost is at most so many times the near-optimal one."""

    def decide(data: Data) -> list[Finding]:
        best = over(data, "near-optimal", what, *span)[0]
        name = f"{label}: cost over near-optimal, {_of(what, span)}"
        return [claims.below(name, interval(over(data, label, what, *span) / best), ratio)]

    return decide


def at_least(label: str, what: str, limit: float, span: Span = END) -> Decide:
    """Its mean is above a limit."""

    def decide(data: Data) -> list[Finding]:
        level = interval(over(data, label, what, *span))
        return [claims.above(f"{label}: {_of(what, span)}", level, limit)]

    return decide


def at_most(label: str, what: str, limit: float, span: Span = END) -> Decide:
    """Its mean is below a limit."""

    def decide(data: Data) -> list[Finding]:
        level = interval(over(data, label, what, *span))
        return [claims.below(f"{label}: {_of(what, span)}", level, limit)]

    return decide


def sooner(first: str, second: str, begin: float, seconds: float) -> Decide:
    """The first reaches the second's final score at least so much earlier than the end.

    Measured in each realisation: from `begin` on, when the mean score of 20 episodes of the first
    reaches the mean score of the second's last 60 s; 600 s when it never does.
    """

    def decide(data: Data) -> list[Finding]:
        last = over(data, second, "score", 540.0, 600.0)
        score = np.asarray(data[first]["score"])
        n, window = score.shape[1], max(2, round(20 * score.shape[1] / 400))
        sums = np.cumsum(score, axis=1)
        smooth = (sums[:, window:] - sums[:, :-window]) / window
        time = 600.0 * np.arange(window + 1, n + 1) / n
        reached = (smooth >= last[: len(score), None]) & (time > begin)
        first_time = np.where(reached.any(axis=1), time[reached.argmax(axis=1)], 600.0)
        name = f"{first} reaches the last score of {second} before 600 s by [s]"
        return [claims.above(name, interval(600.0 - first_time), seconds)]

    return decide


def _relative(data: Data, first: str, other: str, what: str, span: Span) -> tuple[str, Interval]:
    """What the first is above the other, in per cent of the other's mean, and its name."""
    against = over(data, other, what, *span)
    gap = difference(over(data, first, what, *span), against)
    relative = Interval(*(100.0 * g / abs(against.mean()) for g in gap))
    return f"{first} minus {other}, {_of(what, span)} [%]", relative


def _several(labels: str | tuple[str, ...]) -> tuple[str, ...]:
    return (labels,) if isinstance(labels, str) else labels


def _of(what: str, span: Span) -> str:
    return f"{_NAMES[what]} {_span(span)}"


def _span(span: Span) -> str:
    begin, end = span
    return f"at {begin:g} s" if begin == end else f"{begin:g} to {end:g} s"
