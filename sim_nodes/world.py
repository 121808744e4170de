"""One vehicle living through episodes: what the simulator node and a headless run share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from sim_nodes.tasks.base import Stateful, Task

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WorldSettings(Settings):
    """Where episodes start, and the noise between the vehicle and its controller."""

    order: str = setting(
        "random",
        "initial conditions drawn at random, or swept one after the other",
        choices=("random", "sweep"),
    )
    action_noise: float = setting(
        0.0, "standard deviation of the noise on the action, in its unit (T Eq. 10-1)", low=0.0
    )
    uniform_noise: float = setting(
        0.0, "half-width of uniform noise on the action, in its unit; T 8-1 takes 10.0", low=0.0
    )
    sensor_noise: tuple[float, ...] = setting(
        (0.0,),
        "standard deviations of the measured state (T Eq. 10-2); one for all, or each",
        low=0.0,
    )


class Noise(NamedTuple):
    """What stands between a vehicle and its controller, as plain numbers for compiled code.

    Attributes
    ----------
    action : float
        Standard deviation on the action.
    uniform : float
        Half-width of uniform noise on the action.
    blurred : bool
        Whether the measured state has noise.
    sensor : ndarray of shape (n_dims,)
        Its standard deviations.
    """

    action: float
    uniform: float
    blurred: bool
    sensor: Array


@cached_njit()
def action_noise(noise: Noise, rng: np.random.Generator) -> float:
    """What is added to an action, in its unit (T Eq. 10-1; T 8-1)."""
    added = noise.action * rng.standard_normal() if noise.action else 0.0
    if noise.uniform:
        added += noise.uniform * (2.0 * rng.random() - 1.0)
    return added


@cached_njit()
def blur(noise: Noise, rng: np.random.Generator, seen: Array) -> None:
    """Add the sensors' noise to a state, in place (T Eq. 10-2)."""
    for d in range(len(seen)):
        seen[d] += noise.sensor[d] * rng.standard_normal()


@dataclass(frozen=True)
class WorldMemory:
    """Where a world is, for a checkpoint.

    Attributes
    ----------
    state : ndarray of shape (n_dims,)
    rng : dict
    vehicle_steps, episodes_started, step : int
    seed : int
        Of the episode of a vehicle that keeps its state to itself; -1 for none.
    flown : ndarray of shape (n, 2)
        That one's actions in this episode so far, and the noise on them.
    """

    state: Array
    rng: dict[str, Any]
    vehicle_steps: int
    episodes_started: int
    step: int
    seed: int = -1
    flown: Array = field(default_factory=lambda: np.zeros((0, 2)))


class World:
    """A task with a state, a clock and a random generator.

    Parameters
    ----------
    task : Task
    settings : WorldSettings
    rng : numpy.random.Generator
        Draws initial conditions and noise.

    Attributes
    ----------
    state : ndarray of shape (n_dims,)
        Of the vehicle, as it is.
    noise : Noise
    """

    def __init__(self, task: Task, settings: WorldSettings, rng: np.random.Generator) -> None:
        self.task = task
        self.settings = settings
        self.rng = rng
        self.vehicle_steps = 0
        noise, n_dims = settings.sensor_noise, task.description.n_dims
        if len(noise) not in (1, n_dims):
            raise InputError(f"sensor_noise has {len(noise)} entries; allowed: 1 or {n_dims}")
        sensor = np.broadcast_to(np.array(noise, float), (n_dims,)).copy()
        self.noise = Noise(
            settings.action_noise, settings.uniform_noise, bool(sensor.any()), sensor
        )
        self._starts = self._all_starts()
        self.state = np.empty(n_dims)
        self._episodes_started = 0
        self._step = 0

    @property
    def vehicle_time(self) -> float:
        """Time that the vehicle has moved [s]; starting an episode takes none of it."""
        return self.vehicle_steps * self.task.description.sampling_time

    def begin(self, episode: int) -> Observation:
        """Put the vehicle at an initial condition."""
        number = self._episodes_started if self.settings.order == "sweep" else None
        self.state = self._start(number)
        self._episodes_started += 1
        self._step = 0
        return Observation(episode, 0, self._measured())

    def move(self, episode: int, action: int) -> Observation:
        """Hold an action for one sampling time."""
        noise = 0.0
        if self.noise.action or self.noise.uniform:
            noise = action_noise.py_func(self.noise, self.rng)
        self.state, reward, ended, cut = self._advance(action, noise)
        self._step += 1
        self.vehicle_steps += 1
        cut = not ended and (cut or self._step >= self.task.description.episode_steps)
        return Observation(episode, self._step, self._measured(), reward, action, ended, cut)

    def close(self) -> None:
        """Let go of what the vehicle holds."""

    def _all_starts(self) -> Any:
        return self.task.initial_states()

    def _start(self, number: int | None) -> Array:
        """The initial condition with a number, or one at random."""
        if number is None:
            return self.task.draw_initial(self.rng)
        return self._starts[number % len(self._starts)]

    def _advance(self, action: int, noise: float) -> tuple[Array, float, bool, bool]:
        """Next state, reward, whether the task ended, and whether the vehicle cut the episode."""
        after, reward, ended = self.task.step(self.state, action, self.vehicle_time, noise)
        return after, float(reward), bool(ended), False

    def memory(self) -> WorldMemory:
        """All that a later `recall` needs to go on bit by bit the same."""
        return WorldMemory(
            np.array(self.state, float), dict(self.rng.bit_generator.state), self.vehicle_steps,
            self._episodes_started, self._step,
        )  # fmt: skip

    def recall(self, memory: WorldMemory) -> None:
        """Go on from what `memory` gave.

        Raises
        ------
        InputError
            When it is of another vehicle, or no memory.
        """
        n_dims = self.task.description.n_dims
        if memory.state.shape != (n_dims,) or memory.step < 0:
            raise InputError(
                f"the vehicle's state has shape {memory.state.shape}; allowed: ({n_dims},), this "
                "vehicle's"
            )
        try:
            self.rng.bit_generator.state = memory.rng
        except (TypeError, ValueError, LookupError, OverflowError) as error:
            raise InputError(f"rng is no state of its random generator: {error}") from None
        self.state, self.vehicle_steps = memory.state, memory.vehicle_steps
        self._episodes_started, self._step = memory.episodes_started, memory.step

    def flown(self, state: Array, steps: int) -> None:
        """Take over a stretch that was computed elsewhere, and where it led."""
        self.state = state
        self._step += steps
        self.vehicle_steps += steps

    def _measured(self) -> Array:
        if not self.noise.blurred:
            return self.state
        seen = self.state.copy()
        blur.py_func(self.noise, self.rng, seen)
        return seen


class StatefulWorld(World):
    """The same with a vehicle that keeps its state to itself.

    Parameters
    ----------
    vehicle : Stateful
    settings : WorldSettings
    rng : numpy.random.Generator
        Draws the seeds of episodes, and noise.
    """

    def __init__(
        self, vehicle: Stateful, settings: WorldSettings, rng: np.random.Generator
    ) -> None:
        self._vehicle = vehicle
        self._seed, self._flown = -1, list[tuple[float, float]]()
        known_by: Any = vehicle  # a task's description, and what it may have besides
        super().__init__(known_by, settings, rng)

    def close(self) -> None:
        """Let go of what the vehicle holds."""
        self._vehicle.close()

    def _all_starts(self) -> Any:
        return range(self._vehicle.starts)

    def _start(self, number: int | None) -> Array:
        seed = int(self.rng.integers(2**31)) if number is None else number % len(self._starts)
        self._seed, self._flown = seed, []
        return self._vehicle.begin(seed)

    def _advance(self, action: int, noise: float) -> tuple[Array, float, bool, bool]:
        self._flown.append((float(action), noise))
        return self._vehicle.advance(action, noise)

    def memory(self) -> WorldMemory:
        """All that a later `recall` needs to go on bit by bit the same."""
        flown = np.array(self._flown, float).reshape(-1, 2)
        return replace(super().memory(), seed=self._seed, flown=flown)

    def recall(self, memory: WorldMemory) -> None:
        """Go on from what `memory` gave: the episode so far is flown again.

        Raises
        ------
        InputError
            When it is of another vehicle, or no memory.
        """
        about, flown = self.task.description, memory.flown
        n_actions, steps = about.n_actions, min(memory.step, about.episode_steps)
        known = flown.shape == (steps, 2) and np.isfinite(flown).all()
        if not known or memory.seed < 0 or not np.isin(flown[:, 0], range(n_actions)).all():
            raise InputError(
                "what was flown in this episode is not known; allowed: the episode's seed, and "
                f"rows of an action below {n_actions} and its noise"
            )
        super().recall(memory)
        self._seed, self._flown = memory.seed, []
        self._vehicle.begin(memory.seed)
        for action, noise in flown.tolist():
            self._advance(int(action), noise)


def make_world(vehicle: Any, settings: WorldSettings, rng: np.random.Generator) -> World:
    """The world of a `Task`, or of a `Stateful` vehicle."""
    if isinstance(vehicle, Stateful):
        return StatefulWorld(vehicle, settings, rng)
    return World(vehicle, settings, rng)
