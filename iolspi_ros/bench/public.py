"""Environments that everybody knows: steps until the usual threshold, from nothing or shown how."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.bench.rows import Row
from iolspi_ros.core.learner import greedy_policy
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transitions, transition_between
from iolspi_ros.experiments.evaluate import evaluate
from iolspi_ros.experiments.headless import Listener, train
from iolspi_ros.task import Action
from sim_nodes.tasks.gym_description import Wishes
from sim_nodes.tasks.gym_vehicle import vehicle_class
from sim_nodes.world import WorldSettings, make_world

Array = NDArray[np.float64]
Pilot = Callable[[Array], int]

SETTINGS = LSPISettings(update_interval=500)
"""Of the learner, the same everywhere; no grid, no widths."""
SHOWN, CORRUPTION = 15, 0.1
"""Demonstrated episodes, and the share of their actions that are at random."""
LOOK, JUDGED = 10, 100
"""Episodes that a policy is looked at with, and those that the threshold is a mean of."""


class Challenge(NamedTuple):
    """An environment, what is asked of it, and a plain pilot.

    Attributes
    ----------
    id : str
        As for `gymnasium.make`.
    threshold : float
        Mean sum of rewards of an episode.
    most : int
        Steps after which nobody waits any more.
    pilot : callable
    actions : tuple of Action
        Where a continuous one is cut.
    """

    id: str
    threshold: float
    most: int
    pilot: Pilot
    actions: tuple[Action, ...] = ()


class Reached(NamedTuple):
    """What a learner came to.

    Attributes
    ----------
    steps : float
        Online steps until the threshold; infinite when it was not reached.
    shown : float
        Mean sum of rewards of the demonstrated episodes; NaN without.
    best : float
        The largest mean that was seen.
    """

    steps: float
    shown: float
    best: float


def _balance(state: Array) -> int:
    return int(state @ np.array([0.05, 0.1, 1.0, 0.5]) > 0.0)


def _pump(state: Array) -> int:
    return 2 if state[4] < 0.0 else 0


def _rock(state: Array) -> int:
    return 2 if state[1] >= 0.0 else 0


def _swing(state: Array) -> int:
    """Pumps energy, and holds the top."""
    angle, rate = math.atan2(state[1], state[0]), float(state[2])
    if abs(angle) < 0.5:
        torque = -10.0 * angle - 2.0 * rate
    else:
        torque = math.copysign(2.0, rate * (15.0 - rate * rate / 2.0 - 15.0 * state[0]))
    return round(min(max(torque, -2.0), 2.0)) + 2


def _land(state: Array) -> int:
    """Gymnasium's own heuristic, which asks its environment only whether actions are continuous."""
    from types import SimpleNamespace

    from gymnasium.envs.box2d.lunar_lander import heuristic

    return int(heuristic(SimpleNamespace(unwrapped=SimpleNamespace(continuous=False)), state))


TORQUES = tuple(Action(f"{torque:+d} Nm", (float(torque),)) for torque in range(-2, 3))
CHALLENGES = (
    Challenge("CartPole-v1", 475.0, 20_000, _balance),
    Challenge("Acrobot-v1", -100.0, 30_000, _pump),
    Challenge("MountainCar-v0", -110.0, 30_000, _rock),
    Challenge("Pendulum-v1", -200.0, 20_000, _swing, TORQUES),
    Challenge("LunarLander-v3", 200.0, 100_000, _land),
)


def total(seeds: int) -> int:
    """Number of realisations."""
    return 2 * seeds * len(CHALLENGES)


def rows(seeds: int, show: Callable[[int], None]) -> list[Row]:
    """Steps and vehicle time until the threshold, by environment, from nothing and shown how."""
    found: list[Row] = []
    for number, challenge in enumerate(CHALLENGES):
        for begin, name in enumerate(("from nothing", "shown")):
            reached = []
            for seed in range(seeds):
                reached.append(reach(challenge, seed, demonstrated=bool(begin)))
                show((2 * number + begin) * seeds + seed + 1)
            found += told(f"{challenge.id}, {name}", challenge, reached)
            if begin:
                found.append(Row(f"{challenge.id}: by the pilot", reached[0].shown, ""))
    return found


def told(name: str, challenge: Challenge, reached: list[Reached]) -> list[Row]:
    """Rows of some seeds."""
    steps, middle = sorted(r.steps for r in reached), len(reached) // 2
    share = sum(map(math.isfinite, steps)) / len(steps)
    return [
        Row(f"{name}: seeds that reach {challenge.threshold:g}", share, "share"),
        Row(f"{name}: steps until then, median", steps[middle], "steps"),
        Row(f"{name}: best mean, median", sorted(r.best for r in reached)[middle], ""),
    ]


class Judge:
    """Looks at a policy until it is good enough.

    Parameters
    ----------
    challenge : Challenge
    mean : callable
        Takes a number of episodes; the mean sum of rewards of the policy as it is now.

    Attributes
    ----------
    best : float
        The largest mean that was seen.
    """

    def __init__(self, challenge: Challenge, mean: Callable[[int], float]) -> None:
        self.best = -math.inf
        self._threshold, self._mean = challenge.threshold, mean

    def reached(self) -> bool:
        """Whether the mean of `JUDGED` episodes is at the threshold."""
        mean = self._mean(LOOK)
        self.best = max(self.best, mean)
        return mean >= self._threshold and self._mean(JUDGED) >= self._threshold


def reach(challenge: Challenge, seed: int, *, demonstrated: bool) -> Reached:
    """Learn until the mean of `JUDGED` episodes is at the threshold, or for `most` steps."""
    kind = vehicle_class(challenge.id, {}, Wishes(actions=challenge.actions), LOOK)
    world = make_world(kind(), WorldSettings(), np.random.default_rng([seed, 0]))
    learner = OnlineLSPI(world.task.description, SETTINGS, np.random.default_rng([seed, 1]))
    judge = Judge(challenge, lambda episodes: _mean(challenge, learner, episodes))
    shown, looked = math.nan, -1
    if demonstrated:
        samples, shown = _show(world, challenge.pilot, np.random.default_rng([seed, 2]))
        learner.pretrain(samples)
    while learner.step < challenge.most:
        if learner.updates != looked and (learner.updates or demonstrated):
            looked = learner.updates
            if judge.reached():
                return Reached(learner.step, shown, judge.best)
        train(world, learner, 1, Listener())
    return Reached(math.inf, shown, judge.best)


def _mean(challenge: Challenge, learner: OnlineLSPI, episodes: int) -> float:
    """Mean sum of rewards of the greedy policy."""
    kind = vehicle_class(challenge.id, {}, Wishes(actions=challenge.actions), episodes)
    task: Any = kind()
    return float(evaluate(task, greedy_policy(learner)).score.mean())


def _show(world: Any, pilot: Pilot, rng: np.random.Generator) -> tuple[Transitions, float]:
    """Episodes of a pilot, and what they earn in the mean."""
    samples, scores = [], []
    for episode in range(SHOWN):
        seen, score = world.begin(episode), 0.0
        while not seen.last:
            by_chance = rng.random() < CORRUPTION
            n_actions = world.task.description.n_actions
            action = int(rng.integers(n_actions)) if by_chance else pilot(seen.state)
            after = world.move(episode, action)
            samples.append(transition_between(seen, after))
            seen, score = after, score + after.reward
        scores.append(score)
    return Transitions.of(samples, world.task.description.n_dims), float(np.mean(scores))
