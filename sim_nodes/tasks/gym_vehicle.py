"""Any environment of Gymnasium as a vehicle: `gymnasium:LunarLander-v3`, or a file about one."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import task as tasks
from iolspi_ros.errors import InputError, check_range
from iolspi_ros.task import Action, TaskDescription
from sim_nodes.tasks import gym_description
from sim_nodes.tasks.gym_description import Wishes

Array = NDArray[np.float64]

PREFIX = "gymnasium:"
PIXELS = "rgb_array"
"""The render mode that gives images."""
STARTS = 10
"""Seeds that policies are judged from, when nobody says how many."""


class GymVehicle:
    """An environment, made by its id; a `Stateful` vehicle. Subclasses say which.

    Attributes
    ----------
    description : TaskDescription
    id : str
        As for `gymnasium.make`.
    arguments : mapping
        Of the environment's own.
    starts : int
        Policies are judged from the seeds 0, 1, … below it.
    """

    description: ClassVar[TaskDescription]
    id: ClassVar[str]
    arguments: ClassVar[Mapping[str, Any]]
    starts: ClassVar[int]
    success_return: ClassVar[float | None]

    def __init__(self) -> None:
        self._env = _make(self.id, self.arguments)
        self._looked_at = False
        self._actions = gym_description.values_of(self._env, self.description.actions)
        self._continuous = hasattr(self._env.action_space, "low")

    def fresh(self) -> GymVehicle:
        """Another of the kind."""
        return type(self)()

    def begin(self, seed: int) -> Array:
        """The first state of the episode that a seed makes."""
        if self._looked_at and self._env.render_mode is None:
            self._env.close()
            self._env = _make(self.id, {**self.arguments, "render_mode": PIXELS})
        observation, _ = self._env.reset(seed=seed)
        return _state(observation)

    def advance(self, action: int, noise: float = 0.0) -> tuple[Array, float, bool, bool]:
        """One step: the next state, its reward, whether the task ended, whether the clock cut."""
        value = self._actions[action]
        if noise:
            value = self._noisy(value, noise)
        observation, reward, terminated, truncated, _ = self._env.step(value)
        return _state(observation), float(reward), bool(terminated), bool(truncated)

    def _noisy(self, value: Any, noise: float) -> Any:
        if not self._continuous:
            raise InputError(
                f"action_noise or uniform_noise is not 0.0; allowed: 0.0, since the actions of "
                f"{self.id} are numbers in a list"
            )
        space = self._env.action_space
        return np.clip(value + noise, space.low, space.high).astype(space.dtype)

    def image(self) -> NDArray[np.uint8] | None:
        """What it looks like, shape (height, width, 3); from the episode on that begins next.

        Before somebody asks, an environment is not made to draw: some step slower then.

        Raises
        ------
        InputError
            When it cannot draw itself.
        """
        self._looked_at = PIXELS in self._env.metadata.get("render_modes", ())
        if self._env.render_mode != PIXELS:
            return None
        try:
            pixels = np.asarray(self._env.render())
        except Exception as error:  # whatever an environment of somebody's raises
            raise InputError(f"environment {self.id!r} does not draw itself: {error}") from None
        return np.ascontiguousarray(pixels[..., :3], np.uint8)

    def close(self) -> None:
        """Let go of what the environment holds."""
        self._env.close()


class _Judged(GymVehicle):
    """One whose episodes succeed by what they earn."""

    def succeeded(self, states: Array, rewards: Array) -> NDArray[np.bool_]:
        """Whether episodes earned enough; rewards of shape (n_steps, n)."""
        return rewards.sum(axis=0) >= self.success_return


@cache
def by_id(name: str) -> type[GymVehicle]:
    """The vehicle of `gymnasium:ID`.

    Raises
    ------
    InputError
        When Gymnasium is not installed, has no such environment, or it is no vehicle.
    """
    return vehicle_class(name.removeprefix(PREFIX), {}, Wishes(), STARTS)


@cache
def by_file(path: Path) -> type[GymVehicle]:
    """The vehicle of a file that names an environment.

    Raises
    ------
    InputError
        Naming the file, the field, its value and what is allowed.
    """
    content = tasks.read_plain(path)
    try:
        if not isinstance(content, Mapping) or not isinstance(content.get("gymnasium"), str):
            raise InputError("it has no gymnasium: ID; it must have one")
        return vehicle_class(content["gymnasium"], *_wishes(content))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _wishes(content: Mapping[str, Any]) -> tuple[dict[str, Any], Wishes, int]:
    """What a file says besides the id."""
    own = {"gymnasium", "arguments", "starts"}
    known = set(Wishes.__dataclass_fields__) | own
    if unknown := sorted(set(map(str, content)) - known):
        raise InputError(f"it has {unknown[0]!r}; allowed: {', '.join(sorted(known))}")
    arguments, starts = content.get("arguments", {}), content.get("starts", STARTS)
    if not isinstance(arguments, dict):
        raise InputError(f"arguments is {arguments!r}; allowed: names and values")
    _number("starts", starts, int)
    check_range("starts", starts, 1, 10_000)
    values = {key: value for key, value in content.items() if key not in own}
    for name, kind in (
        ("neutral", int), ("episode_steps", int), ("sampling_time", float), ("gamma", float),
        ("success_return", float),
    ):  # fmt: skip
        if name in values:
            _number(name, values[name], kind)
    for name in ("variables", "actions"):
        if not isinstance(values.get(name, []), list):
            raise InputError(f"{name} is {values[name]!r}; allowed: a list")
    values["variables"] = tuple(values.get("variables", ()))
    values["actions"] = tuple(map(_action, values.get("actions", ())))
    return arguments, Wishes(**values), starts


def _number(name: str, value: Any, kind: type) -> None:
    allowed = (int,) if kind is int else (int, float)
    if isinstance(value, bool) or not isinstance(value, allowed):
        what = "an integer" if kind is int else "a number"
        raise InputError(f"{name} is {value!r}; allowed: {what}")


def _action(entry: Any) -> Action:
    """An action of a file: a name, a value, or both."""
    if isinstance(entry, str):
        return Action(entry)
    named = entry if isinstance(entry, dict) else {"value": entry}
    value = named.get("value", ())
    numbers = value if isinstance(value, list | tuple) else [value]
    try:
        values = tuple(map(float, numbers))
    except (TypeError, ValueError):
        raise InputError(f"action is {entry!r}; allowed: a name, a number or a list of them") from (
            None
        )
    return Action(str(named.get("name") or " ".join(f"{v:+g}" for v in values)), values)


def vehicle_class(
    id_: str, arguments: Mapping[str, Any], wishes: Wishes, starts: int
) -> type[GymVehicle]:
    """The vehicle of an environment, with what is wished of it; see `GymVehicle`."""
    env = _make(id_, arguments)
    try:
        threshold = gym_description.success_return(env, wishes)
        about = gym_description.describe(env, wishes)
        members = {
            "description": about, "id": id_,
            "arguments": dict(arguments), "starts": starts, "success_return": threshold,
        }  # fmt: skip
        gym_description.values_of(env, about.actions)
    finally:
        env.close()
    return type("GymVehicle", (GymVehicle if threshold is None else _Judged,), members)


def _make(id_: str, arguments: Mapping[str, Any]) -> Any:
    """The environment itself, with observations that are one row of numbers."""
    try:
        gymnasium = importlib.import_module("gymnasium")
    except ImportError:
        raise InputError(
            f"task gymnasium:{id_} needs Gymnasium, which is not installed; allowed: "
            "pip install iolspi_ros[gymnasium]"
        ) from None
    try:
        env = gymnasium.make(id_, disable_env_checker=True, **arguments)
        spaces = gymnasium.spaces
        if not isinstance(env.observation_space, spaces.Box | spaces.Discrete):
            env = gymnasium.wrappers.FlattenObservation(env)
    except Exception as error:  # whatever an environment of somebody's raises
        reason = " ".join(str(error).split())
        raise InputError(
            f"environment {id_!r} cannot be made: {reason}; allowed: an id of Gymnasium, as "
            "CartPole-v1, or module:ID for one that a module registers"
        ) from None
    return env


def _state(observation: Any) -> Array:
    return np.array(observation, float).reshape(-1)
