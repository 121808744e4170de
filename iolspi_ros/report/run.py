"""Report of one learning run: summary.json and report.html."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros import __version__
from iolspi_ros.core.checkpoint import atomic_file
from iolspi_ros.core.features import RBFGrid
from iolspi_ros.core.reference import NearOptimal
from iolspi_ros.experiments.evaluate import Evaluation, evaluate, policy_of
from iolspi_ros.experiments.history import History
from iolspi_ros.report import page, plots
from sim_nodes.tasks.base import Task


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write the numbers as JSON, whole or not at all."""
    with atomic_file(path) as file:
        file.write(json.dumps(summary, indent=2).encode() + b"\n")


def summarise(task: Task, features: RBFGrid, history: History, best: Evaluation) -> dict[str, Any]:
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
        "updates_refused": sum(not policy.accepted for policy in history.policies),
        "discounted_return": last.discounted_return,
        "near_optimal_return": best.discounted_return,
        "ratio_to_near_optimal": last.discounted_return / best.discounted_return,
        "upright_fraction": last.success_fraction,
    }


def write_report(
    out: Path,
    title: str,
    lead: str,
    task: Task,
    features: RBFGrid,
    history: History,
    best: Evaluation,
    best_policy: NearOptimal,
    summary: dict[str, Any],
) -> Path:
    """Draw everything and write report.html.

    Returns
    -------
    Path
        Of the page.
    """
    learned = policy_of(history.policies[-1].weights, features)
    times = [policy.time for policy in history.policies]
    returns = [
        evaluate(task, policy_of(policy.weights, features)).discounted_return
        for policy in history.policies
    ]
    n_dims = len(task.low)
    online = np.array([s for episode in history.episodes for s in episode]).reshape(-1, n_dims)
    demonstrated = np.array(history.demonstrated).reshape(-1, n_dims)
    parts: list[tuple[str, Any]] = []
    if history.shown:
        if task.name == "pendulum":
            parts.append(("", page.swing(history.shown[-1], task.dt)))
        parts.append(
            (
                "What it does now",
                plots.positions(
                    task,
                    [np.array(states) for states in history.shown],
                    f"The last {len(history.shown)} episodes: greedy, not learning",
                ),
            )
        )
    parts += [
        (
            "How good each policy was",
            plots.discounted_return(times, returns, best.discounted_return),
        ),
        (
            "What it earned while learning",
            plots.learning_score(history.scores, task.dt * task.episode_steps),
        ),
        ("What it would do where", plots.policy_maps(task, learned, best_policy)),
        ("Where it has been", plots.visit_maps(task, demonstrated, online)),
        (
            "While still exploring",
            plots.positions(
                task,
                [np.array(states) for states in history.episodes[-10:]],
                "The last 10 episodes of learning",
            ),
        ),
        (
            "Health of the solves",
            plots.solve_condition(times, [policy.condition for policy in history.policies]),
        ),
    ]
    facts = [
        (f"{summary['ratio_to_near_optimal']:.3f}", "cost, in that of the near-optimal policy"),
        (f"{summary['upright_fraction']:.0%}", "of the starts end upright"),
        (f"{summary['vehicle_seconds']:.0f} s", "of vehicle time learning online"),
        (f"{summary['demonstrated_samples']}", "demonstrated samples"),
    ]
    path = out / "report.html"
    page.write(path, title, lead, facts, parts, summary)
    return path
