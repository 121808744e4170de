"""Sample sets to learn from before flying: demonstrations, and two kinds of random ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from iolspi_ros import resources
from iolspi_ros.bags import read_demonstration
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import (
    Observation,
    Sample,
    Transition,
    Transitions,
    transition_between,
)
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription
from sim_nodes.pilots import PilotSettings, ScriptedPilot
from sim_nodes.tasks.base import Task
from sim_nodes.world import World, WorldSettings

MODES = {1: ("perform", 0.0), 2: ("explore", 0.0), 3: ("perform", 0.5), 4: ("perform", 0.33),
         5: ("explore", 0.33)}  # fmt: skip
"""T Table 1: mode and corruption of each demonstration set, and of every other task's."""
NOTHING, SEQUENTIAL, INDEPENDENT = "nothing", "random sequential", "random independent"
SOURCES = (NOTHING, SEQUENTIAL, INDEPENDENT, *(f"set {n}{a}" for n in MODES for a in ("", "a")))
_REPEATS_SEED = 100


def mode_and_corruption(number: int) -> tuple[str, float]:
    """How a shipped set was flown.

    Raises
    ------
    InputError
        When there is no such set.
    """
    if number not in MODES:
        raise InputError(f"--set is {number}; allowed: 1 to {len(MODES)}")
    return MODES[number]


def bag(source: str, task: str = "pendulum") -> Path | None:
    """The shipped bag of a source, if it is one."""
    shipped = source.startswith("set ") and not source.endswith("a")
    return resources.find("demos", task, f"set_{source[4:]}") if shipped else None


def samples(source: str, task: Task, seed: int) -> Transitions | None:
    """What a realisation learns from before it flies.

    Parameters
    ----------
    source : str
        One of `SOURCES`. "set 1" to "set 5" are shipped and the same for every seed, and so are
        their repeats "set 1a" to "set 5a" (T 10-2-1), flown here by the scripted pilot anew.
    task : Task
        Whose initial conditions the sequential samples begin from.
    seed : int

    Returns
    -------
    Transitions or None
        One episode's worth of samples for each initial condition (T: 6,300).
    """
    if source == NOTHING:
        return None
    about, rng = task.description, np.random.default_rng([seed, 2])
    if source == SEQUENTIAL:  # random actions in whole episodes (T fig. 8)
        return _flown(task, rng, lambda seen: int(rng.integers(task.description.n_actions)))
    if source == INDEPENDENT:  # random states and actions on the model (T fig. 9)
        n = len(task.initial_states()) * about.episode_steps
        state = rng.uniform(about.low, about.high, (n, about.n_dims))
        action = rng.integers(about.n_actions, size=n)
        next_state, reward, ended = task.step(state, action)
        return Transitions(state, action, reward, next_state, ended, np.zeros(n, bool))
    if source not in SOURCES:
        raise InputError(f"sample set is {source!r}; allowed: {', '.join(SOURCES)}")
    if path := bag(source, task.description.name):
        return _read(path, task.description)
    number = int(source[4:-1])
    return demonstrate(task, *MODES[number], _REPEATS_SEED + number)


def demonstrate(task: Task, mode: str, corruption: float, seed: int) -> Transitions:
    """Let the scripted pilot fly one episode from each initial condition.

    The order of every random draw is that of the demonstrator node, so both give the same
    samples.
    """
    rng = np.random.default_rng([seed, 2])
    pilot = ScriptedPilot(task, PilotSettings(mode=mode), rng)

    def choose(seen: Observation) -> int:
        if seen.step == 0:
            pilot.begin()
        action = pilot.act(seen.state)
        return (
            int(rng.integers(task.description.n_actions)) if rng.random() < corruption else action
        )

    return _flown(task, np.random.default_rng([seed, 0]), choose)


def corrupted(
    samples: Iterable[Sample], task: Task, share: float, rng: np.random.Generator
) -> Iterator[Sample]:
    """Samples of which some have a random action (T Table 1), and what the model does with it.

    T corrupts while the vehicle is flown; here each step is changed by itself, from the state that
    it had, so that the next one no longer begins where it ends.

    Parameters
    ----------
    samples : iterable of Sample
    task : Task
        The model.
    share : float
        Probability that a sample is changed.
    rng : numpy.random.Generator
    """
    for sample in samples:
        if rng.random() >= share:
            yield sample
            continue
        state = sample.transition.state
        action = int(rng.integers(task.description.n_actions))
        after, reward, ended = task.step(state, action, sample.stamp / 1e9)
        cut = sample.transition.truncated and not ended
        changed = Transition(state, action, float(reward), after, bool(ended), cut)
        yield replace(sample, transition=changed, source=Source.CORRUPTED)


def _flown(
    task: Task, rng: np.random.Generator, choose: Callable[[Observation], int]
) -> Transitions:
    """One episode from each initial condition."""
    world = World(task, WorldSettings(order="sweep"), rng)
    rows = []
    for episode in range(len(task.initial_states())):
        seen = world.begin(episode)
        while not seen.last:
            after = world.move(episode, choose(seen))
            rows.append(transition_between(seen, after))
            seen = after
    return Transitions.of(rows, task.description.n_dims)


@cache
def _read(path: Path, task: TaskDescription) -> Transitions:
    return read_demonstration(path, task).transitions()
