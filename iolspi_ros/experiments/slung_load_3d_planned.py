"""A planner on the true model of the drop-off in three dimensions: what could be had at best.

Dynamic programming cannot reach ten variables. The cross-entropy method searches plans of
accelerations instead, each flown ahead on the model in full, with all that is hidden from a
learner, and released when that pays most. Without wind the model says exactly what comes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.settings import from_mapping
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

Array = NDArray[np.float64]

_LEAST = 0.02
"""Probability that every action keeps."""


@dataclass(frozen=True)
class PlannerRun:
    """How far it looks ahead, and how hard it searches.

    Attributes
    ----------
    vehicle : mapping
        Settings of `SlungLoad3D` other than the defaults.
    horizon, hold : int
        Steps of a plan; each of its actions is held for so many.
    plans, best, rounds : int
        Drawn in each round, the best of which the next is drawn from.
    every : int
        Steps after which it searches again, from the plan that it has.
    """

    vehicle: Mapping[str, Any] = field(default_factory=dict)
    horizon: int = 30
    hold: int = 2
    plans: int = 100
    best: int = 12
    rounds: int = 10
    every: int = 5


def plan_ahead(setting: PlannerRun, seed: int) -> Mapping[str, Any]:
    """Fly from each of the 100 starts.

    Returns
    -------
    ending : ndarray of int, shape (100,)
    score, discounted : ndarray of shape (100,)
        Sum of the rewards of each episode, and its discounted return.
    """
    task: SlungLoad3D = from_mapping(SlungLoad3D, dict(setting.vehicle), "planner")
    rng = np.random.default_rng([seed, 5])
    flown = [fly_ahead(task, setting, start, rng) for start in range(task.starts)]
    ending, score, discounted = map(np.array, zip(*flown, strict=True))
    return {"ending": ending, "score": score, "discounted": discounted}


def fly_ahead(
    task: SlungLoad3D, setting: PlannerRun, start: int, rng: np.random.Generator
) -> tuple[int, float, float]:
    """One episode.

    Parameters
    ----------
    task : SlungLoad3D
    setting : PlannerRun
    start : int
        Seed of the episode.
    rng : numpy.random.Generator

    Returns
    -------
    ending : int
    score, discounted : float
        Sum of the rewards, and discounted return.
    """
    about, release = task.description, task.actions.release
    task.begin(start)
    plan = np.zeros(0, np.int64)
    rewards: list[float] = []
    ended = False
    while not ended and len(rewards) < about.episode_steps:
        if len(rewards) % setting.every == 0:
            plan = search(task, setting, plan, rng)
        action, plan = (int(plan[0]), plan[1:]) if len(plan) else (release, plan)
        _, reward, ended, _ = task.advance(action)
        rewards.append(reward)
    discounted = float(about.gamma ** np.arange(len(rewards)) @ rewards)
    return int(about.ending(rewards[-1], ended)), sum(rewards), discounted


def search(
    task: SlungLoad3D, setting: PlannerRun, plan: NDArray[np.int64], rng: np.random.Generator
) -> NDArray[np.int64]:
    """The best plan found: actions, after which the load is released.

    Parameters
    ----------
    task : SlungLoad3D
        Where it is.
    setting : PlannerRun
    plan : ndarray of int, shape (n,)
        The plan until now, which is kept when nothing better is found; empty for none.
    rng : numpy.random.Generator
    """
    blocks = -(-setting.horizon // setting.hold)
    n_actions = task.actions.release
    chance = np.full((blocks, n_actions), 1.0 / n_actions)
    best, most = plan, float(task.foresee(plan[None])[0, -1]) if len(plan) else -np.inf
    for _ in range(setting.rounds):
        drawn = (rng.random((setting.plans, blocks, 1)) > chance.cumsum(axis=1)).sum(axis=2)
        drawn = np.minimum(drawn, n_actions - 1)
        plans = drawn.repeat(setting.hold, axis=1)[:, : setting.horizon]
        returns = task.foresee(plans)
        worth = returns.max(axis=1)
        order = np.argsort(-worth)[: setting.best]
        if worth[order[0]] > most:
            most, best = worth[order[0]], plans[order[0], : returns[order[0]].argmax()]
        elite = drawn[order]
        for action in range(n_actions):
            chance[:, action] = 0.3 * chance[:, action] + 0.7 * (elite == action).mean(axis=0)
        chance = (chance + _LEAST) / (1.0 + _LEAST * n_actions)
    return best
