"""The report of `iolspi fly`: what was flown first, and by it what the model says."""

from __future__ import annotations

import ast
from pathlib import Path
from typing import TYPE_CHECKING, Any

from iolspi_ros.cli.flight_plan import FlightPlan
from iolspi_ros.cli.progress import baseline, console

if TYPE_CHECKING:
    from iolspi_ros.cli.flight import Flown
    from iolspi_ros.experiments.history import EpisodeRecord
    from iolspi_ros.nodes.monitor import Monitor
    from sim_nodes.tasks.base import Task

Fact = tuple[str, str]


def write(
    out: Path, vehicle: Task, plan: FlightPlan, monitor: Monitor, flown: Flown, seconds: float
) -> None:
    """Compute what needs no graph, and write the pages; however the flight ended."""
    from iolspi_ros.experiments.evaluate import succeeded
    from iolspi_ros.experiments.headless import prepare
    from iolspi_ros.report import run as report

    monitor.episodes[:] = [episode for episode in monitor.episodes if episode.whole]
    history = monitor.history(min(flown.learned, len(monitor.episodes)))
    shown = report.whole(history.shown)
    episodes, kind = (shown, "shown") if shown else (history.episodes, "flown while learning")
    extra: dict[str, Any] = flown.said | {
        "autopilot": plan.vehicle, "url": plan.url, "seed": plan.seed, "trouble": flown.trouble,
        "episodes_shown": len(shown), "wall_seconds": seconds,
    }  # fmt: skip
    if plan.demonstrated:
        extra["demonstrated_samples"] = plan.demonstrated
    extra |= _flown(vehicle, monitor.episodes)
    successes = int(succeeded(vehicle, episodes).sum()) if episodes else 0
    if shown:
        extra["shown_success_fraction"] = successes / len(shown)
    facts = _facts(vehicle, successes, len(episodes), kind, flown)
    if not episodes or not history.policies:
        report.write_summary(out / "summary.json", extra)
        console.print(f"\nNo episode was flown to its end. What is known is in {out}.")
        return
    learner = prepare(plan.task, plan.config, 0).learner
    subject = report.Subject(vehicle, learner, history, baseline(vehicle))
    with console.status("drawing …"):
        title = f"Flying {plan.task} on an autopilot"
        summary = report.finish(out, title, _lead(plan, flown), subject, extra, flown=facts)
    for value, what in facts:
        console.print(f"  [bold]{value}[/bold] {what}")
    console.print(
        f"  {summary['success_fraction']:.0%} is what the same policy does on the model.\n"
        f"  That took {seconds:.0f} s.\nLook at [bold]{out / 'report.html'}[/bold]"
    )


def _flown(vehicle: Task, episodes: list[EpisodeRecord]) -> dict[str, int]:
    """Of all whole episodes, while learning and shown: how they ended."""
    from iolspi_ros.experiments.evaluate import succeeded

    ends = vehicle.description.endings
    crashing = {end.reward for end in ends if end.name.startswith("crash")}
    crashes = sum(episode.rewards[-1] in crashing for episode in episodes)
    successes = int(succeeded(vehicle, episodes).sum()) if episodes else 0
    return {
        "flown_episodes": len(episodes), "flown_successes": successes,
        "flown_crashes": int(crashes),
    }  # fmt: skip


def _facts(vehicle: Task, successes: int, count: int, kind: str, flown: Flown) -> list[Fact]:
    """What was flown, and what of it was seen; before all that a model says."""
    share = f"{successes / count:.0%}" if count else "none"
    found = [
        (share, f"{vehicle.description.success} as flown: {successes} of {count} episodes {kind}")
    ]
    found += [(str(n), f"releases in all: {seen}") for seen, n in releases(flown.said).items()]
    if chances := flown.said.get("chances"):
        found.append((chances, "releases expected inside, by how well it was known where"))
    found += [
        (flown.said.get("episodes_abandoned") or "?", "episodes broken off"),
        (flown.said.get("envelope_left") or "?", "times the envelope was left"),
    ]
    return found


def releases(said: dict[str, str]) -> dict[str, int]:
    """How often what was seen of a release, as the bridge says it."""
    try:
        found = ast.literal_eval(said.get("releases") or "{}")
        return {str(seen): int(n) for seen, n in found.items()}
    except (ValueError, SyntaxError, AttributeError):
        return {}


def _lead(plan: FlightPlan, flown: Flown) -> str:
    lead = (
        f"An autopilot ({plan.vehicle}) was flown over MAVLink by a learner that was pretrained on "
        f"{plan.pretrained_on}. The first figures are of what was flown; those below are of the "
        "same policy on the model. Where a load came down is what its own system reported; where "
        "there is none it is the parabola from an estimated swing, which nobody measured. "
    )
    if plan.embedded:
        lead += "The embedded autopilot is an imitation: this proves nothing about a real one. "
    return lead + (f"The flight ended before it should: {flown.trouble}." if flown.trouble else "")
