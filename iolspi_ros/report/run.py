"""Report of one learning run: summary.json and report.html."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros import __version__
from iolspi_ros.core.checkpoint import atomic_file
from iolspi_ros.core.features import Basis
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.reference import NearOptimal
from iolspi_ros.experiments.evaluate import Evaluation, evaluate, near_optimal_policy, policy_of
from iolspi_ros.experiments.history import History
from iolspi_ros.report import page, plots
from iolspi_ros.report.page import Part
from sim_nodes.tasks.base import Task


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
        "demonstrated_samples": len(history.demonstrated),
        "offline": history.offline,
        "episodes": len(history.scores),
        "vehicle_seconds": round(history.vehicle_time, 6),
        "updates": sum(policy.number > 0 for policy in history.policies),
        "updates_refused": sum(policy.status != "ok" for policy in history.policies),
        "discounted_return": last.discounted_return,
        "near_optimal_return": best.discounted_return,
        "ratio_to_near_optimal": last.discounted_return / best.discounted_return,
        "upright_fraction": last.success_fraction,
    }


def finish(
    out: Path,
    title: str,
    lead: str,
    task: Task,
    features: Basis,
    history: History,
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
    extra : dict
        What only the caller knows, for the summary.
    beside : (OnlineLSPI, History), optional
        The literal algorithm in the same situation.

    Returns
    -------
    dict
        The summary.
    """
    best_policy = near_optimal_policy(task)
    best = evaluate(task, best_policy)
    summary = summarise(task, features, history, best) | extra
    curves = [("learned, greedy", *_curve(task, features, history))]
    if beside and beside[1].policies:
        literal = _curve(task, beside[0].features, beside[1])
        curves.append(("thesis' algorithm to the letter", *literal))
        summary["literal_ratio_to_near_optimal"] = literal[1][-1] / best.discounted_return
    parts = _shown(task, history)
    parts += _learning(task, history, curves, best)
    parts += _maps(task, features, history, best_policy)
    facts = [
        (f"{summary['ratio_to_near_optimal']:.3f}", "times the near-optimal cost"),
        (f"{summary['upright_fraction']:.0%}", "of the starts end upright"),
        (f"{summary['vehicle_seconds']:.0f} s", "of vehicle time learning online"),
        (f"{summary['demonstrated_samples']}", "demonstrated samples"),
    ]
    page.write(out / "report.html", title, lead, facts, parts, summary)
    write_summary(out / "summary.json", summary)
    return summary


def _shown(task: Task, history: History) -> list[Part]:
    """What the vehicle does at the end, if it was shown."""
    if not history.shown:
        return []
    n = len(history.shown)
    episodes = [np.array(states) for states in history.shown]
    figure = plots.positions(task, episodes, f"The last {n} episodes: greedy, not learning")
    moving = [Part("", page.swing(episodes[-1], task.dt))] if task.name == "pendulum" else []
    says = "One line per start. At zero the goal is reached; a line that stays there holds it."
    return [*moving, Part("What it does now", figure, says)]


def _curve(task: Task, features: Basis, history: History) -> tuple[list[float], list[float]]:
    """Times and discounted returns of the policies of a run."""
    returns = [
        evaluate(task, policy_of(policy.weights, features)).discounted_return
        for policy in history.policies
    ]
    return [policy.time for policy in history.policies], returns


def _judged(history: History) -> str:
    """What was judged unhealthy or better, in words."""
    refused = [f"{p.number} ({p.status})" for p in history.policies if p.status != "ok"]
    text = "Digits that a solve may lose: 1e6 costs six of sixteen. "
    text += f"Unhealthy: updates {', '.join(refused)}. " if refused else "All were healthy. "
    judged = [p.judgement for p in history.policies if p.judgement]
    if judged:
        stayed = sum(not judgement.delta for judgement in judged)
        text += (
            f"Of {len(judged)} updates {stayed} kept the weights before, since no new policy "
            f"was predicted to be better; the last: {judged[-1].describe()}."
        )
    return text


def _learning(
    task: Task,
    history: History,
    curves: list[tuple[str, list[float], list[float]]],
    best: Evaluation,
) -> list[Part]:
    """How it got there."""
    times = [policy.time for policy in history.policies]
    conditions = [policy.condition for policy in history.policies]
    last = [np.array(states) for states in history.episodes[-10:]]
    score = plots.learning_score(history.scores, task.dt * task.episode_steps)
    return [
        Part(
            "How good each policy was",
            plots.discounted_return(curves, best.discounted_return),
            "After each update, the greedy policy flown from every start on the model, learning "
            "turned off. The red line is the best that is possible, nearly.",
        ),
        Part(
            "What it earned while learning",
            score,
            "Sum of rewards of each episode, with its exploring actions.",
        ),
        Part("While still exploring", plots.positions(task, last, "The last episodes of learning")),
        Part(
            "Health of the solves",
            plots.solve_condition(times, conditions),
            _judged(history),
        ),
    ]


def _maps(task: Task, features: Basis, history: History, best_policy: NearOptimal) -> list[Part]:
    """What it would do where, and where it has been."""
    n_dims = len(task.low)
    online = np.array([s for episode in history.episodes for s in episode]).reshape(-1, n_dims)
    demonstrated = np.array(history.demonstrated).reshape(-1, n_dims)
    learned = policy_of(history.policies[-1].weights, features)
    return [
        Part(
            "What it would do where",
            plots.policy_maps(task, learned, best_policy),
            "Compare them where the vehicle has been (below); elsewhere nothing was learned.",
        ),
        Part("Where it has been", plots.visit_maps(task, demonstrated, online)),
    ]
