"""The numbers that stand first, and how they go together where they seem not to."""

from __future__ import annotations

from typing import Any

from iolspi_ros.task import TaskDescription

APART = 5.0
"""Times that one shortfall must be the other's before somebody wonders."""
SMALL = 0.05
"""A shortfall that nobody wonders about."""


def how_good(summary: dict[str, Any]) -> tuple[str, str]:
    """The last policy's number, and what it is: rewards may be costs, or none at all."""
    ratio, best = summary["ratio_to_near_optimal"], summary["near_optimal_return"]
    if ratio is None:
        beside = "" if best is None else ", the near-optimal one is 0"
        return f"{summary['discounted_return']:.3g}", f"discounted return{beside}"
    return f"{ratio:.3f}", f"times the near-optimal {'cost' if best < 0 else 'return'}"


def note(task: TaskDescription, summary: dict[str, Any]) -> str:
    """Why the return and the share of successes, or two shares, say different things; or nothing.

    Parameters
    ----------
    task : TaskDescription
    summary : dict
        As `run.summarise` makes it, with what a command adds.
    """
    found = [_return_and_success(task, summary), _shown_and_starts(task, summary)]
    return " ".join(text for text in found if text)


def _return_and_success(task: TaskDescription, summary: dict[str, Any]) -> str:
    ratio, success = summary["ratio_to_near_optimal"], summary["success_fraction"]
    if ratio is None:
        return ""
    dearer, missed = abs(ratio - 1.0), 1.0 - success
    number, of_what = how_good(summary)
    if missed > max(SMALL, APART * dearer):
        late = task.gamma**task.episode_steps
        return (
            f"{number} {of_what}, and yet {missed:.0%} of the starts do not {task.success}: the "
            f"two judge different things. The return is discounted by γ = {task.gamma:g} a step, "
            f"so that the last of {task.episode_steps} steps counts {late:.2g} times the first, "
            "and a policy that begins as the best one does comes near it, however it ends; whether "
            f"it does {task.success} is judged apart from that, as a yes or a no."
        )
    if dearer > max(SMALL, APART * missed):
        worse = "more" if summary["near_optimal_return"] < 0 else "less"
        return (
            f"{success:.0%} of the starts {task.success}, and yet it is {number} {of_what}: it "
            f"gets there, but on the way {worse} is summed up than by the best policy."
        )
    return ""


def _shown_and_starts(task: TaskDescription, summary: dict[str, Any]) -> str:
    shown, starts = summary.get("shown_success_fraction"), summary["success_fraction"]
    if shown is None or abs(shown - starts) <= SMALL:
        return ""
    return (
        f"{shown:.0%} of the episodes shown {task.success}, and {starts:.0%} of the starts on the "
        "model: what was shown had the vehicle's own noise and delays, and its own starts."
    )
