"""The slung load as an autopilot flies it: late, with a lag, and against the air."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.compiling import cached_njit
from iolspi_ros.errors import InputError
from sim_nodes.tasks.slung_load.dynamics import ACCELERATIONS, PARAMETERS, RELEASE, judge

Array = NDArray[np.float64]

FINE = 20
"""Steps of integration in one sampling time.

One step of Euler's method in 0.1 s, as T takes it, makes a swing grow by 5 % each: that pumps the
load up for nothing, where no autopilot's load does. In 20 it grows by 0.2 %.
"""
LATEST = 0.3  # longest delay [s]
_ASKED = 2 + math.ceil(LATEST / PARAMETERS[7])  # accelerations that are remembered


class Response(NamedTuple):
    """How a vehicle answers, as plain numbers for compiled code.

    Attributes
    ----------
    delay : float
        Until an acceleration that is asked for begins to come about [s].
    lag : float
        First-order time constant with which it then does [s].
    drag : float
        The vehicle's own: deceleration over speed [1/s].
    push : float
        What pushes it besides, all the time [m/s²].
    gain : float
        Times an acceleration that is asked for, it comes about.
    """

    delay: float
    lag: float
    drag: float
    push: float
    gain: float


@cached_njit()
def move(state: Array, memory: Array, asked: float, response: Response, parameters: Array) -> None:
    """One sampling time, in place: T Eq. 18 with the acceleration that comes about.

    Parameters
    ----------
    state : ndarray of shape (4,)
        As of `SlungLoad`.
    memory : ndarray of shape (n,)
        The acceleration that comes about, then those asked for, the newest first [m/s²].
    asked : float
        From now on [m/s²].
    response : Response
    parameters : ndarray of shape (8,)
        As of `SlungLoad.parameters`.
    """
    delay, lag, drag, push, gain = response
    g, L, period = parameters[0], parameters[1], parameters[7]
    h = period / FINE
    follows = -math.expm1(-h / lag) if lag > 0.0 else 1.0
    memory[2:] = memory[1:-1].copy()
    memory[1] = asked
    x, speed, angle, rate = state
    for n in range(FINE):
        behind = max(0, math.ceil((delay - n * h) / period - 1e-9))
        memory[0] += follows * (gain * memory[1 + behind] - memory[0])
        a = memory[0] - drag * speed + push
        swung = math.cos(angle) * a + math.sin(angle) * g / L
        x, speed, angle, rate = (
            x + speed * h, speed + a * h, angle + rate * h, rate - swung * h,
        )  # fmt: skip
    state[0], state[1], state[2], state[3] = x, speed, angle, rate


class AsFlown:
    """A slung load whose response is drawn for each episode; a `Stateful` vehicle.

    What it asks for, gives and looks like is the task's; hidden are the acceleration that comes
    about and those asked for that are still to come.

    Parameters
    ----------
    task : SlungLoad
        With the settings that say how it answers.
    """

    def __init__(self, task: Any) -> None:
        self.task = task
        self.description, self.usual_episodes = task.description, task.usual_episodes
        self.starts = len(task.initial_states())
        self.pilot, self.picture = task.pilot, task.picture
        self.released, self.trail = task.released, task.trail
        self._parameters = np.array(PARAMETERS)
        self._state: Array | None = None
        self._memory = np.zeros(1 + _ASKED)
        self.response = Response(0.0, 0.0, 0.0, 0.0, 1.0)

    def fresh(self) -> AsFlown:
        """Another of the kind."""
        return AsFlown(self.task)

    def begin(self, seed: int) -> Array:
        """At rest at a start of the task; how the vehicle answers in this episode."""
        rng = np.random.default_rng(seed)
        self._state = self.task.draw_initial(rng)
        self.response = self._draw(rng)
        self._memory[:] = 0.0
        return self._state.copy()

    def _draw(self, rng: np.random.Generator) -> Response:
        late, slow, braked, pushed, strong = rng.uniform(-1.0, 1.0, 5).tolist()
        task = self.task
        return Response(
            task.delay * (1.0 + task.delay_spread * late),
            task.lag * (1.0 + task.lag_spread * slow),
            task.drag * (1.0 + task.drag_spread * braked),
            task.push_spread * pushed,
            task.gain * (1.0 + task.gain_spread * strong),
        )

    def advance(self, action: int, noise: float = 0.0) -> tuple[Array, float, bool, bool]:
        """Hold an action for T_s; rewards and ends are the task's.

        A release is judged on the state left, a crash on the state reached.
        """
        if self._state is None:
            raise InputError("no episode has begun; allowed: begin, then advance")
        before = self._state.copy()
        move(
            self._state, self._memory, ACCELERATIONS[action] + noise, self.response,
            self._parameters,
        )  # fmt: skip
        after = self._state.copy()
        if action == RELEASE:
            return after, self.task.landed(self.task.landing(before)), True, False
        reward, ended = judge(before, after, self._parameters)
        return after, float(reward), bool(ended), False

    def close(self) -> None:
        """Nothing to let go of."""
