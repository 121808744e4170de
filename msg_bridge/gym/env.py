"""`gymnasium.make("iolspi_ros/Graph-v0", task="pendulum")`: a vehicle of the graph to learn on."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.graph import Graph, own_domain
from iolspi_ros.task import TaskDescription
from msg_bridge.gym.client import GraphClient

Array = NDArray[np.float64]
PATIENCE = 60.0


class GraphEnv(gymnasium.Env[Array, np.int64]):
    """The learner's place on the graph's topics.

    Observations are the task's variables, actions its list. The vehicle is a simulator of its own
    in lockstep, and then all that happens follows from the seed; or whoever is in the graph, a
    robot or an autopilot too.

    Parameters
    ----------
    task : str
        What a simulator of its own flies: a registered task, module:Class, gymnasium:ID or a file.
        Empty for the vehicle that is in the graph.
    namespace : str
        Where the vehicle is, when it is in the graph.
    domain : int, optional
        ROS domain; ROS_DOMAIN_ID by default, or a free one for a simulator of its own.
    parameters : mapping
        Of that simulator.
    timeout : float
        Seconds that the vehicle may take to answer.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  as the base class has it

    def __init__(
        self,
        task: str = "",
        namespace: str = "",
        domain: int | None = None,
        parameters: Mapping[str, Any] | None = None,
        timeout: float = PATIENCE,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = render_mode
        self._held = ExitStack()
        self._now: Observation | None = None
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        try:
            self._open(task, namespace, domain, parameters or {}, timeout)
        except BaseException:
            self._held.close()
            raise
        about = self.description
        self.observation_space = gymnasium.spaces.Box(
            np.array(about.low), np.array(about.high), dtype=np.float64
        )
        self.action_space = gymnasium.spaces.Discrete(about.n_actions)

    def _open(
        self, task: str, namespace: str, domain: int | None, parameters: Any, timeout: float
    ) -> None:
        alive = _nothing
        if task:
            if domain is None:
                domain = self._held.enter_context(own_domain())
            folder = Path(self._held.enter_context(tempfile.TemporaryDirectory(prefix="iolspi-")))
            graph = self._held.enter_context(Graph(folder, {"ROS_DOMAIN_ID": str(domain)}))
            graph.start("simulator", {"task": task, **parameters})
            alive = graph.check
        if domain is None:
            domain = int(os.environ.get("ROS_DOMAIN_ID", "0"))
        self._client = GraphClient(domain, namespace, timeout, alive)
        self._held.callback(self._client.close)

    @property
    def description(self) -> TaskDescription:
        """What the vehicle says of itself."""
        return self._client.task

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin an episode: the vehicle's next one, or the first that a seed makes."""
        super().reset(seed=seed)
        ended = self._now is not None and self._now.last
        if seed is None and ended:
            begun = self._next_episode()
        else:
            chosen = int(self.np_random.integers(2**31)) if seed is None else seed
            begun = self._client.restart(chosen) or self._next_episode()
        self._now = begun
        return begun.state.copy(), self._facts([begun])

    def _next_episode(self) -> Observation:
        """The vehicle's next episode; that under way is flown to its end, doing nothing."""
        latest = self._now
        if latest is None:
            latest = self._client.following(_BEFORE)[-1]
            if latest.step == 0:
                return latest
        while True:
            self._client.answer(latest, self.description.neutral, Source.HOLD)
            came = self._client.following(latest)
            for latest in came:
                if latest.step == 0:
                    return latest

    def step(
        self, action: np.int64
    ) -> tuple[Array, float, bool, bool, dict[str, Any]]:  # what Gymnasium asks for
        """Answer the vehicle, and wait for what comes of it."""
        before = self._now
        if before is None or before.last:
            raise gymnasium.error.ResetNeeded("the episode is over, or none has begun: call reset")
        if not self.action_space.contains(action):
            raise InputError(
                f"action is {action!r}; allowed: 0 to {self.description.n_actions - 1}"
            )
        self._client.answer(before, int(action), Source.EXPLOIT)
        came = self._client.following(before)
        same = [seen for seen in came if seen.episode == before.episode]
        if not same:  # it goes on with another episode: the end of this one was not seen
            self._now = came[-1]._replace(truncated=True)
            return before.state.copy(), 0.0, False, True, {"lost": True}
        self._now = now = same[-1]
        reward = sum(seen.reward for seen in same)
        return now.state.copy(), reward, now.terminated, now.truncated, self._facts(same)

    def _facts(self, came: list[Observation]) -> dict[str, Any]:
        """What the vehicle says besides; `observation` has the rest."""
        return {"step": came[-1].step, "applied": came[-1].action, "steps": len(came)}

    @property
    def observation(self) -> Observation | None:
        """The latest one, with its key and stamp."""
        return self._now

    def close(self) -> None:
        """Leave the graph, and end a simulator of its own."""
        self._held.close()


_BEFORE = Observation(-1, -1, np.empty(0))


def _nothing() -> None:
    pass
