"""What an environment of Gymnasium says of itself, as a task description; and what a file adds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from iolspi_ros.errors import InputError
from iolspi_ros.task import Action, Ending, TaskDescription, Variable
from iolspi_ros.task.description import MOST_ACTIONS, MOST_VARIABLES

USUAL_RATE = 50.0
"""Steps a second of an environment that does not say how it is to be shown."""
USUAL_STEPS = 1000
USUAL_GAMMA = 0.99
_HUGE = 1e30
"""Limits beyond this mean that there is none: float32's largest number is a usual one."""
_LEVELS = (0.0, 0.5, 1.0)
"""Where a continuous action is cut when nobody says: its least, its middle, its largest."""
_GRID = 3
"""Entries of a continuous action up to which all combinations of levels are actions."""


class _Known(NamedTuple):
    """What an environment's page says and its spaces don't.

    Attributes
    ----------
    names : tuple of str
        Of the variables.
    neutral : int
    low, high : tuple of float
        What occurs in an episode, where the spaces are wider; empty where they are not.
    """

    names: tuple[str, ...] = ()
    neutral: int | None = None
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()


_KNOWN: dict[str, _Known] = {
    "CartPole": _Known(
        ("position", "velocity", "angle", "rate"), 0,
        (-2.4, -3.0, -0.21, -3.5), (2.4, 3.0, 0.21, 3.5),
    ),
    "MountainCar": _Known(("position", "velocity"), 1),
    "MountainCarContinuous": _Known(("position", "velocity"), 1),
    "Acrobot": _Known(("cosine_1", "sine_1", "cosine_2", "sine_2", "rate_1", "rate_2"), 1),
    "Pendulum": _Known(("cosine", "sine", "rate"), 1),
    "LunarLander": _Known(
        ("x", "y", "vx", "vy", "angle", "rate", "left_leg", "right_leg"), 0,
        (-1.0, -0.3, -1.5, -2.0, -1.5, -2.0, 0.0, 0.0), (1.0, 1.7, 1.5, 0.7, 1.5, 2.0, 1.0, 1.0),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Wishes:
    """What a file may say of an environment; what it leaves out the environment says.

    Parameters
    ----------
    name : str
    variables : tuple of dict
        For each variable what is other than the environment says: fields of `Variable`.
    actions : tuple of Action
        Where a continuous action is cut, or what discrete ones are called.
    neutral : int
    sampling_time : float
    episode_steps : int
    gamma : float
    success_return : float
        Sum of rewards from which an episode counts as a success.
    """

    name: str = ""
    variables: tuple[dict[str, Any], ...] = ()
    actions: tuple[Action, ...] = ()
    neutral: int | None = None
    sampling_time: float | None = None
    episode_steps: int | None = None
    gamma: float = USUAL_GAMMA
    success_return: float | None = None


def describe(env: Any, wishes: Wishes) -> TaskDescription:
    """Task of an environment.

    Parameters
    ----------
    env : gymnasium.Env
        Its observations a `Box` of one dimension or `Discrete`.
    wishes : Wishes

    Raises
    ------
    InputError
        When it has spaces that are none of a task, or a wish does not fit them.
    """
    family = env.spec.id.rpartition("/")[2].rpartition("-v")[0]
    known = _KNOWN.get(family, _Known())
    actions = _actions(env, wishes.actions)
    neutral = known.neutral if wishes.neutral is None else wishes.neutral
    if neutral is None or neutral >= len(actions):
        neutral = len(actions) // 2 if _continuous(env) else 0
    threshold = success_return(env, wishes)
    return TaskDescription(
        name=wishes.name or family,
        variables=_variables(env.observation_space, known, wishes.variables),
        actions=actions,
        neutral=neutral,
        sampling_time=wishes.sampling_time or 1.0 / _rate(env),
        episode_steps=wishes.episode_steps or env.spec.max_episode_steps or USUAL_STEPS,
        gamma=wishes.gamma,
        endings=(Ending("time-out"), Ending("end")),
        success="come to an end" if threshold is None else f"earn {threshold:g} or more",
    )


def success_return(env: Any, wishes: Wishes) -> float | None:
    """Sum of rewards from which an episode is a success, where anybody says."""
    if wishes.success_return is not None:
        return wishes.success_return
    threshold = env.spec.reward_threshold
    return None if threshold is None else float(threshold)


def values_of(env: Any, actions: Sequence[Action]) -> list[Any]:
    """What `env.step` takes for each action."""
    space = env.action_space
    if not _continuous(env):
        return list(_discrete(space))
    return [np.array(a.value, space.dtype).reshape(space.shape) for a in actions]


def _continuous(env: Any) -> bool:
    return hasattr(env.action_space, "low")


def _rate(env: Any) -> float:
    rate = env.metadata.get("render_fps")
    return float(rate) if rate else USUAL_RATE


# ---------------------------------------------------------------- variables


def _variables(space: Any, known: _Known, wishes: Sequence[dict[str, Any]]) -> tuple[Variable, ...]:
    names: Sequence[str] = known.names
    if hasattr(space, "low"):
        low, high = np.ravel(space.low).astype(float), np.ravel(space.high).astype(float)
    elif hasattr(space, "n"):
        low, high = np.array([float(space.start)]), np.array([float(space.start + space.n - 1)])
        names = names or ("state",)
    else:
        raise InputError(
            f"the environment's observations are {space}; allowed: Box or Discrete, or what "
            "gymnasium.wrappers.FlattenObservation makes a Box of"
        )
    if not 0 < len(low) <= MOST_VARIABLES:
        raise InputError(
            f"the environment's observations have {len(low)} entries; allowed: 1 to "
            f"{MOST_VARIABLES} (pictures are for other learners)"
        )
    if wishes and len(wishes) != len(low):
        raise InputError(
            f"variables has {len(wishes)} entries; allowed: {len(low)}, one for each entry of the "
            "observation"
        )
    if len(names) != len(low):
        names = [f"x{number}" for number in range(len(low))]
    elif known.low:
        low, high = np.array(known.low), np.array(known.high)
    found = [
        Variable(name, low=_limit(a, -math.inf), high=_limit(b, math.inf))
        for name, a, b in zip(names, low.tolist(), high.tolist(), strict=True)
    ]
    return (
        tuple(_wished(v, wish) for v, wish in zip(found, wishes, strict=True))
        if wishes
        else (tuple(found))
    )


def _wished(variable: Variable, wish: dict[str, Any]) -> Variable:
    try:
        return replace(variable, **wish)
    except TypeError:
        known = ", ".join(Variable.__dataclass_fields__)
        raise InputError(f"variable {variable.name} has {wish}; allowed: {known}") from None


def _limit(value: float, none: float) -> float:
    return value if abs(value) < _HUGE else none


# ---------------------------------------------------------------- actions


def _actions(env: Any, wished: Sequence[Action]) -> tuple[Action, ...]:
    if _continuous(env):
        return (tuple(wished) and _checked(env.action_space, wished)) or _cut(env.action_space)
    options = list(_discrete(env.action_space))
    if wished and len(wished) != len(options):
        raise InputError(
            f"actions has {len(wished)} entries; allowed: {len(options)}, as the environment has"
        )
    return tuple(wished) or tuple(
        Action(str(number), tuple(np.ravel(option).astype(float).tolist()))
        for number, option in enumerate(options)
    )


def _checked(space: Any, wished: Sequence[Action]) -> tuple[Action, ...]:
    """Actions that the space has."""
    size = int(np.prod(space.shape))
    low, high = np.ravel(space.low), np.ravel(space.high)
    for action in wished:
        value = np.array(action.value)
        if len(value) != size or not ((low <= value) & (value <= high)).all():
            raise InputError(
                f"value of action {action.name} is {list(action.value)}; allowed: {size} numbers "
                f"from {low.tolist()} to {high.tolist()}"
            )
    return tuple(wished)


def _cut(space: Any) -> tuple[Action, ...]:
    """Some actions of a continuous space."""
    low, high = np.ravel(space.low).astype(float), np.ravel(space.high).astype(float)
    if not (np.isfinite(low).all() and np.isfinite(high).all()):
        raise InputError(
            f"the environment's actions are {space}, without limits; allowed: a file with a list "
            "of actions"
        )
    levels = [
        [float(a + share * (b - a)) for share in _LEVELS] for a, b in zip(low, high, strict=True)
    ]
    if len(levels) <= _GRID:
        values = list(itertools.product(*levels))
    else:  # one at a time
        middle = [level[1] for level in levels]
        values = [tuple(middle)]
        for place, (least, _, most) in enumerate(levels):
            values += [(*middle[:place], value, *middle[place + 1 :]) for value in (least, most)]
    return tuple(Action(" ".join(f"{v:+g}" for v in value), value) for value in values)


def _discrete(space: Any) -> Any:
    """Every action of a space of numbered ones."""
    if hasattr(space, "nvec"):
        ranges = [range(n) for n in np.ravel(space.nvec).tolist()]
    elif hasattr(space, "start"):
        return range(int(space.start), int(space.start + space.n))
    elif hasattr(space, "n"):
        ranges = [range(2)] * int(space.n)
    else:
        raise InputError(
            f"the environment's actions are {space}; allowed: Discrete, MultiDiscrete, "
            "MultiBinary or Box"
        )
    if math.prod(map(len, ranges)) > MOST_ACTIONS:
        raise InputError(
            f"the environment's actions are {space}; allowed: at most {MOST_ACTIONS} combinations"
        )
    return [np.array(option) for option in itertools.product(*ranges)]
