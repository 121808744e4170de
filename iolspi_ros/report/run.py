"""Report of one learning run: summary.json and report.html."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iolspi_ros import __version__
from iolspi_ros import task as tasks
from iolspi_ros.core.learner import Learner, greedy_policy
from iolspi_ros.experiments.evaluate import Evaluation, endings, evaluate, succeeded
from iolspi_ros.experiments.headless import Beside
from iolspi_ros.experiments.history import EpisodeRecord, History
from iolspi_ros.folders import atomic_file
from iolspi_ros.methods.near_optimal import NearOptimal
from iolspi_ros.report import page, plots
from iolspi_ros.report.headline import how_good, note
from iolspi_ros.report.page import Part
from iolspi_ros.task import TaskDescription
from iolspi_ros.task.maps import map_limits
from sim_nodes import pictures
from sim_nodes.tasks.base import Task

ANIMATED = 6
"""Episodes in the animation at most."""


class Subject(NamedTuple):
    """What a report is about.

    Attributes
    ----------
    model : Task
        The vehicle.
    learner : Learner
    history : History
    baseline : NearOptimal, optional
        A near-optimal policy to compare with, where there is one.
    """

    model: Task
    learner: Learner
    history: History
    baseline: NearOptimal | None

    @property
    def task(self) -> TaskDescription:
        """What the vehicle is to do."""
        return self.model.description


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the numbers as JSON, whole or not at all."""
    with atomic_file(path) as file:
        file.write(json.dumps(summary, indent=2).encode() + b"\n")


def summarise(subject: Subject, best: Evaluation | None) -> dict[str, Any]:
    """Numbers of a run that need no graph.

    The policy that counts is the last one, greedy, from every initial condition.
    """
    history, task = subject.history, subject.task
    last = evaluate(subject.model, greedy_policy(subject.learner, history.policies[-1].weights))
    return {
        "task": task.name,
        "version": __version__,
        "demonstrated_samples": len(history.demonstrations),
        "offline": history.offline,
        "episodes": len(history.scores),
        "interventions": sum(history.interventions),
        "vehicle_seconds": round(history.vehicle_time, 6),
        "updates": sum(policy.number > 0 for policy in history.policies),
        "updates_refused": sum(not policy.healthy for policy in history.policies),
        "discounted_return": last.discounted_return,
        "near_optimal_return": best.discounted_return if best else None,
        "ratio_to_near_optimal": _ratio(last.discounted_return, best),
        "success": task.success,
        "success_fraction": last.success_fraction,
        "task_description": json.loads(tasks.dump(task)),
    } | _ends(task, history)


def _ends(task: TaskDescription, history: History) -> dict[str, Any]:
    """How episodes ended, where there is more than one way."""
    if len(task.endings) == 1:
        return {}
    demonstrations = history.demonstrations
    ends = demonstrations.terminated | demonstrations.truncated
    counted = {
        "ends_demonstrated": task.ending(
            demonstrations.reward[ends], demonstrations.terminated[ends]
        ),
        "ends_while_learning": endings(task, whole(history.episodes)),
        "ends_shown": endings(task, whole(history.shown)),
    }
    return {name: _shares(task, found) for name, found in counted.items() if len(found)}


def _shares(task: TaskDescription, ends: NDArray[np.int64]) -> dict[str, float]:
    counts = np.bincount(ends, minlength=len(task.endings)) / len(ends)
    return {
        ending.name: round(float(share), 4)
        for ending, share in zip(task.endings, counts, strict=True)
    }


def whole(episodes: Sequence[EpisodeRecord]) -> list[EpisodeRecord]:
    """Those whose end was seen."""
    return [episode for episode in episodes if episode.whole]


def share_shown(subject: Subject) -> float:
    """Share of the episodes shown at the end that reached the goal."""
    return float(succeeded(subject.model, whole(subject.history.shown)).mean())


def _ratio(discounted: float, best: Evaluation | None) -> float | None:
    """To the near-optimal return; none where that is zero, or unknown."""
    return discounted / best.discounted_return if best and best.discounted_return else None


def finish(
    out: Path,
    title: str,
    lead: str,
    subject: Subject,
    extra: dict[str, Any],
    beside: Beside | None = None,
    flown: Sequence[tuple[str, str]] = (),
) -> dict[str, Any]:
    """Compute what a run has come to; write report.html and summary.json.

    Parameters
    ----------
    out : Path
    title, lead : str
        Of the page.
    subject : Subject
    extra : dict
        What only the caller knows, for the summary.
    beside : Beside, optional
        Another learner in the same situation.
    flown : sequence of (str, str)
        What a vehicle really did, a figure and what it is of: these come first, and all others
        are said to be of the model.

    Returns
    -------
    dict
        The summary.
    """
    best = evaluate(subject.model, subject.baseline) if subject.baseline else None
    summary = summarise(subject, best) | extra
    history, task = subject.history, subject.task
    curves = [_curve("learned, greedy", subject.model, subject.learner, history)]
    if history.policies[0].number == 0:
        summary["success_fraction_offline"] = curves[0].successes[0]
    if beside and beside.history.policies:
        curves.append(_curve(beside.label, subject.model, beside.learner, beside.history))
        summary["beside"] = beside.label
        summary["beside_ratio_to_near_optimal"] = _ratio(curves[1].returns[-1], best)
        summary["beside_success_fraction"] = curves[1].successes[-1]
    parts = [*_shown(subject), *_learning(subject, curves, best), *_maps(subject)]
    value, what = how_good(summary)
    model = ", the same policy on the model" if flown else ""
    facts = [
        *flown,
        (value, what + model),
        (f"{summary['success_fraction']:.0%}", f"of the starts {task.success}{model}"),
        (f"{summary['vehicle_seconds']:.0f} s", "of vehicle time learning online"),
        (f"{summary['demonstrated_samples']}", "demonstrated samples"),
    ]
    together = summary["headline_note"] = note(task, summary)
    page.write(out / "report.html", title, lead, facts, together, parts, summary)
    write_summary(out / "summary.json", summary)
    return summary


def _shown(subject: Subject) -> list[Part]:
    """What the vehicle does at the end, if it was shown."""
    model, task = subject.model, subject.task
    episodes = whole(subject.history.shown)
    if not episodes:
        return []
    some = episodes[:: -(-len(episodes) // ANIMATED)]
    films = [pictures.film(model, e.states, e.rewards[-1]) for e in some]
    moving = []
    if films[0][0]:
        names = [ending.name for ending in task.endings] if len(task.endings) > 1 else [""]
        ends = [names[end] for end in endings(task, some)]
        heading = "Some of the last episodes, as the graph flew them"
        moving = [Part("", page.animation(heading, films, ends, task.sampling_time))]
    title = f"The last {len(episodes)} episodes: greedy, not learning"
    return [*moving, Part("What it does now", *_flown(model, episodes, title))]


def _flown(model: Task, episodes: Sequence[EpisodeRecord], title: str) -> tuple[Figure, str]:
    """Whole episodes in one figure, and how to read it."""
    first = episodes[0]
    if pictures.trail(model, np.array(first.states), first.rewards[-1]) is None:
        states = [np.array(episode.states) for episode in episodes]
        says = (
            "A line for each episode. At zero (dashed) the goal is reached; a line that stays "
            "there holds it."
        )
        return plots.positions(model.description, states, title), says
    says = (
        "A line from each start, the dot, to its end, the marker: the way of what hangs below, and "
        "of its fall."
    )
    return plots.trails(model, episodes, title), says


def _curve(label: str, model: Task, learner: Learner, history: History) -> plots.Curve:
    """What the policies of a run were worth."""
    flown = [evaluate(model, greedy_policy(learner, p.weights)) for p in history.policies]
    return plots.Curve(
        label,
        [policy.time for policy in history.policies],
        [one.discounted_return for one in flown],
        [one.success_fraction for one in flown],
    )


def _health(history: History) -> str:
    """What was not believed, or no better, in words."""
    refused = [str(policy.number) for policy in history.policies if not policy.healthy]
    stayed = sum(not policy.accepted for policy in history.policies if policy.healthy)
    text = "Digits that a solve may lose: 1e6 costs six of sixteen. "
    text += f"Unhealthy: updates {', '.join(refused)}. " if refused else "All were healthy. "
    if stayed:
        text += f"Of {len(history.policies)} updates {stayed} kept the policy before."
    return text


def _learning(subject: Subject, curves: list[plots.Curve], best: Evaluation | None) -> list[Part]:
    """How it got there."""
    history, task = subject.history, subject.task
    seconds = [task.sampling_time * (len(episode.states) - 1) for episode in history.episodes]
    time = np.cumsum(seconds)
    flown = min(len(time), len(history.scores))
    score = plots.learning_score(time[:flown], history.scores[:flown])
    last = whole(history.episodes)[-10:]
    exploring = _flown(subject.model, last, "The last episodes of learning") if last else None
    dashed = " The dashed line is the best that is possible, nearly." if best else ""
    return [
        Part(
            "How good each policy was",
            plots.discounted_return(curves, best.discounted_return if best else None),
            "After each update, the greedy policy flown from every start on the model, learning "
            f"turned off.{dashed}",
        ),
        Part(
            "How often they reach the goal",
            plots.successes(curves, task.success),
            "The same flights.",
        ),
        Part(
            "What it earned while learning",
            score,
            "Sum of rewards of each episode, with its exploring actions.",
        ),
        *_interventions(time[:flown], history.interventions[:flown]),
        *_ending_shares(task, history),
        *([Part("While still exploring", *exploring)] if exploring else []),
        *_conditions(history),
    ]


def _interventions(time: NDArray[np.float64], counts: Sequence[int]) -> list[Part]:
    """How often a person took over, where one did."""
    if not any(counts):
        return []
    says = "Times that a person took over in each episode. They should become fewer as it learns."
    return [Part("How often a person helped", plots.interventions(time, counts), says)]


def _conditions(history: History) -> list[Part]:
    """Health of a learner's solves, of one that solves anything."""
    if not all("condition" in policy.facts for policy in history.policies):
        return []
    times = [policy.time for policy in history.policies]
    conditions = [policy.facts["condition"] for policy in history.policies]
    figure = plots.solve_condition(times, conditions)
    return [Part("Health of the solves", figure, _health(history))]


def _ending_shares(task: TaskDescription, history: History) -> list[Part]:
    """How episodes ended while learning, where there is more than one way."""
    episodes = whole(history.episodes)
    if len(task.endings) == 1 or len(episodes) < 2:
        return []
    window = max(2, min(100, len(episodes) // 5))
    figure = plots.ending_shares(task, endings(task, episodes), window)
    return [Part("How safe learning was", figure, "With its exploring actions, from the start.")]


def _maps(subject: Subject) -> list[Part]:
    """What it would do where, and where it has been; for two variables or more."""
    task, history = subject.task, subject.history
    if task.n_dims < 2:
        return []
    flown = [state for episode in history.episodes for state in episode.states]
    online = np.array(flown).reshape(-1, task.n_dims)
    demonstrated = history.demonstrations.state
    limits = map_limits(task, np.concatenate([online, demonstrated]))
    seen = [("Demonstrated", demonstrated), ("Online", online)]
    policies: list[tuple[str, Any]] = [
        ("Learned policy", greedy_policy(subject.learner, history.policies[-1].weights))
    ]
    if subject.baseline:
        policies.append(("Near-optimal policy", subject.baseline))
    return [
        Part(
            "What it would do where",
            plots.policy_maps(task, policies, limits),
            "Compare them where the vehicle has been (below); elsewhere nothing was learned."
            + (" Where the state has more variables, they are zero here." * (task.n_dims > 2)),
        ),
        Part("Where it has been", plots.visit_maps(task, seen, limits), "Darker is more often."),
    ]
