"""Report of one learning run: summary.json and report.html."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iolspi_ros import __version__
from iolspi_ros.core.checkpoint import atomic_file
from iolspi_ros.core.features import Basis
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.reference import NearOptimal
from iolspi_ros.experiments.evaluate import Evaluation, endings, evaluate, policy_of
from iolspi_ros.experiments.history import Episode, History
from iolspi_ros.report import page, plots
from iolspi_ros.report.page import Part
from sim_nodes import pictures
from sim_nodes.tasks.base import Task

ANIMATED = 6
"""Episodes in the animation at most."""


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the numbers as JSON, whole or not at all."""
    with atomic_file(path) as file:
        file.write(json.dumps(summary, indent=2).encode() + b"\n")


def summarise(task: Task, features: Basis, history: History, best: Evaluation) -> dict[str, Any]:
    """Numbers of a run that need no graph.

    The policy that counts is the last one, greedy, from every initial condition.
    """
    last = evaluate(task, policy_of(history.policies[-1].weights, features))
    return {
        "task": task.name,
        "version": __version__,
        "demonstrated_samples": len(history.taught),
        "offline": history.offline,
        "episodes": len(history.scores),
        "vehicle_seconds": round(history.vehicle_time, 6),
        "updates": sum(policy.number > 0 for policy in history.policies),
        "updates_refused": sum(policy.status != "ok" for policy in history.policies),
        "discounted_return": last.discounted_return,
        "near_optimal_return": best.discounted_return,
        "ratio_to_near_optimal": _ratio(last.discounted_return, best),
        "success": task.success,
        "success_fraction": last.success_fraction,
    } | _ends(task, history)


def _ends(task: Task, history: History) -> dict[str, Any]:
    """How episodes ended, where there is more than one way."""
    if len(task.endings) == 1:
        return {}
    taught = history.taught
    ends = taught.terminated | taught.truncated
    counted = {
        "ends_demonstrated": task.ending(taught.reward[ends], taught.terminated[ends]),
        "ends_while_learning": endings(task, whole(history.episodes)),
        "ends_shown": endings(task, whole(history.shown)),
    }
    return {name: _shares(task, found) for name, found in counted.items() if len(found)}


def _shares(task: Task, ends: NDArray[np.int64]) -> dict[str, float]:
    counts = np.bincount(ends, minlength=len(task.endings)) / len(ends)
    return {name: round(float(c), 4) for name, c in zip(task.endings, counts, strict=True)}


def whole(episodes: Sequence[Episode]) -> list[Episode]:
    """Those whose end was seen."""
    return [episode for episode in episodes if episode.whole]


def _ratio(discounted: float, best: Evaluation) -> float | None:
    """To the near-optimal return; none where that is zero."""
    return discounted / best.discounted_return if best.discounted_return else None


def how_good(summary: dict[str, Any]) -> tuple[str, str]:
    """The last policy's number, and what it is: rewards may be costs, or none at all."""
    ratio, best = summary["ratio_to_near_optimal"], summary["near_optimal_return"]
    if ratio is None:
        return f"{summary['discounted_return']:.3g}", "discounted return, the near-optimal one is 0"
    return f"{ratio:.3f}", f"times the near-optimal {'cost' if best < 0 else 'return'}"


def finish(
    out: Path,
    title: str,
    lead: str,
    task: Task,
    features: Basis,
    history: History,
    best_policy: NearOptimal,
    extra: dict[str, Any],
    beside: tuple[OnlineLSPI, History] | None = None,
) -> dict[str, Any]:
    """Compute what a run has come to; write report.html and summary.json.

    Parameters
    ----------
    out : Path
    title, lead : str
        Of the page.
    task : Task
    features : Basis
    history : History
    best_policy : NearOptimal
        The yardstick.
    extra : dict
        What only the caller knows, for the summary.
    beside : (OnlineLSPI, History), optional
        The literal algorithm in the same situation.

    Returns
    -------
    dict
        The summary.
    """
    best = evaluate(task, best_policy)
    summary = summarise(task, features, history, best) | extra
    curves = [_curve("learned, greedy", task, features, history)]
    if history.policies[0].number == 0:
        summary["success_fraction_offline"] = curves[0].successes[0]
    if beside and beside[1].policies:
        curves.append(
            _curve("thesis' algorithm to the letter", task, beside[0].features, beside[1])
        )
        summary["literal_ratio_to_near_optimal"] = _ratio(curves[1].returns[-1], best)
        summary["literal_success_fraction"] = curves[1].successes[-1]
    parts = _shown(task, history)
    parts += _learning(task, history, curves, best)
    parts += _maps(task, features, history, best_policy)
    facts = [
        how_good(summary),
        (f"{summary['success_fraction']:.0%}", f"of the starts {task.success}"),
        (f"{summary['vehicle_seconds']:.0f} s", "of vehicle time learning online"),
        (f"{summary['demonstrated_samples']}", "demonstrated samples"),
    ]
    page.write(out / "report.html", title, lead, facts, parts, summary)
    write_summary(out / "summary.json", summary)
    return summary


def _shown(task: Task, history: History) -> list[Part]:
    """What the vehicle does at the end, if it was shown."""
    episodes = whole(history.shown)
    if not episodes:
        return []
    some = episodes[:: -(-len(episodes) // ANIMATED)]
    films = [pictures.film(task, e.states, e.rewards[-1]) for e in some]
    moving = []
    if films[0][0]:
        ways = task.endings if len(task.endings) > 1 else ("",)
        ends = [ways[end] for end in endings(task, some)]
        heading = "Some of the last episodes, as the graph flew them"
        moving = [Part("", page.animation(heading, films, ends, task.dt))]
    title = f"The last {len(episodes)} episodes: greedy, not learning"
    return [*moving, Part("What it does now", *_flown(task, episodes, title))]


def _flown(task: Task, episodes: Sequence[Episode], title: str) -> tuple[Figure, str]:
    """Whole episodes in one figure, and how to read it."""
    first = episodes[0]
    if pictures.trail(task, np.array(first.states), first.rewards[-1]) is None:
        states = [np.array(episode.states) for episode in episodes]
        says = "One line per start. At zero the goal is reached; a line that stays there holds it."
        return plots.positions(task, states, title), says
    says = "One line per start, which is the dot: the way of what hangs below, and of its fall."
    return plots.trails(task, episodes, title), says


def _curve(label: str, task: Task, features: Basis, history: History) -> plots.Curve:
    """What the policies of a run were worth."""
    flown = [evaluate(task, policy_of(policy.weights, features)) for policy in history.policies]
    return plots.Curve(
        label,
        [policy.time for policy in history.policies],
        [one.discounted_return for one in flown],
        [one.success_fraction for one in flown],
    )


def _judged(history: History) -> str:
    """What was judged unhealthy or better, in words."""
    refused = [f"{p.number} ({p.status})" for p in history.policies if p.status != "ok"]
    text = "Digits that a solve may lose: 1e6 costs six of sixteen. "
    text += f"Unhealthy: updates {', '.join(refused)}. " if refused else "All were healthy. "
    refreshed = [p.refresh for p in history.policies if p.refresh]
    if refreshed:
        stayed = sum(not refresh.converged for refresh in refreshed)
        text += (
            f"Of {len(refreshed)} updates {stayed} kept the weights before, since policy iteration "
            f"did not converge; the last: {refreshed[-1].describe()}."
        )
    return text


def _learning(
    task: Task,
    history: History,
    curves: list[plots.Curve],
    best: Evaluation,
) -> list[Part]:
    """How it got there."""
    times = [policy.time for policy in history.policies]
    conditions = [policy.condition for policy in history.policies]
    time = np.cumsum([task.dt * (len(episode.states) - 1) for episode in history.episodes])
    flown = min(len(time), len(history.scores))
    score = plots.learning_score(time[:flown], history.scores[:flown])
    last = whole(history.episodes)[-10:]
    exploring = _flown(task, last, "The last episodes of learning") if last else None
    return [
        Part(
            "How good each policy was",
            plots.discounted_return(curves, best.discounted_return),
            "After each update, the greedy policy flown from every start on the model, learning "
            "turned off. The red line is the best that is possible, nearly.",
        ),
        Part("How often they reach the goal", plots.successes(curves, task.success), "The same."),
        Part(
            "What it earned while learning",
            score,
            "Sum of rewards of each episode, with its exploring actions.",
        ),
        *_ending_shares(task, history),
        *([Part("While still exploring", *exploring)] if exploring else []),
        Part(
            "Health of the solves",
            plots.solve_condition(times, conditions),
            _judged(history),
        ),
    ]


def _ending_shares(task: Task, history: History) -> list[Part]:
    """How episodes ended while learning, where there is more than one way."""
    episodes = whole(history.episodes)
    if len(task.endings) == 1 or len(episodes) < 2:
        return []
    window = max(2, min(100, len(episodes) // 5))
    figure = plots.ending_shares(task, endings(task, episodes), window)
    return [Part("How safe learning was", figure, "With its exploring actions, from the start.")]


def _maps(task: Task, features: Basis, history: History, best_policy: NearOptimal) -> list[Part]:
    """What it would do where, and where it has been."""
    n_dims = len(task.low)
    flown = [state for episode in history.episodes for state in episode.states]
    online = np.array(flown).reshape(-1, n_dims)
    learned = policy_of(history.policies[-1].weights, features)
    return [
        Part(
            "What it would do where",
            plots.policy_maps(task, learned, best_policy),
            "Compare them where the vehicle has been (below); elsewhere nothing was learned."
            + (" Where the state has more variables, they are zero here." * (n_dims > 2)),
        ),
        Part("Where it has been", plots.visit_maps(task, history.taught.state, online)),
    ]
