"""From messages that may be lost, doubled or late to transitions that are never wrong.

A reward names its (episode, step) and the stamp of its state; a state has that stamp. Together
they are one observation. Two observations of one episode, one step apart, are a transition;
the action between them is the one that the later one says was applied.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

from iolspi_ros import wire
from iolspi_ros.core.samples import Array, Observation, Transition, transition_between
from iolspi_ros.task import TaskDescription


class Pairer:
    """Pairs states with rewards, and observations with those one step on.

    Parameters
    ----------
    task : TaskDescription
    window : int
        Messages and observations kept while their partners are awaited.
    """

    def __init__(self, task: TaskDescription, window: int = 512) -> None:
        self._codec = wire.states(task)
        self._window = window
        self._rows = wire.RewardRows()
        self._states: OrderedDict[int, Array] = OrderedDict()
        self._rewards: OrderedDict[int, Sequence[float]] = OrderedDict()
        self._observations: OrderedDict[tuple[int, int], Observation] = OrderedDict()
        self._formed: OrderedDict[tuple[int, int], None] = OrderedDict()

    def state(self, message: Any) -> Observation | None:
        """Take a message on `state`; return the observation that it completes.

        Raises
        ------
        InputError
            When it is not a state of this task.
        """
        state, stamp = self._codec.state(message)
        known = self._states.get(stamp)
        if known is not None and known.tolist() == state.tolist():
            return None  # repeated: its reward, repeated too, will say so
        self._keep(self._states, stamp, state)
        return self._complete(stamp)

    def reward(self, message: Any) -> Observation | None:
        """Take a reward; return the observation that it completes, again if it is repeated.

        Raises
        ------
        InputError
            When it is not a reward.
        """
        values = self._rows.read(message)
        stamp = wire.join(values[2], values[3])
        self._keep(self._rewards, stamp, values)
        return self._complete(stamp)

    def take(self, observation: Observation) -> None:
        """Take a whole observation, which came by another way."""
        self._keep(self._observations, (observation.episode, observation.step), observation)

    def transitions(self, observation: Observation) -> list[tuple[Observation, Transition]]:
        """Transitions that `observation` completes and that were not formed before.

        Returns
        -------
        list of (Observation, Transition)
            The observation that the transition left, and the transition.
        """
        episode, step = observation.episode, observation.step
        found = []
        for left, right in ((step - 1, step), (step, step + 1)):
            before = self._observations.get((episode, left))
            after = self._observations.get((episode, right))
            if before is None or after is None or (episode, left) in self._formed:
                continue
            self._keep(self._formed, (episode, left), None)
            found.append((before, transition_between(before, after)))
        return found

    def _complete(self, stamp: int) -> Observation | None:
        state, values = self._states.get(stamp), self._rewards.get(stamp)
        if state is None or values is None:
            return None
        observation = self._rows.observation(values, state, stamp)
        self.take(observation)
        return observation

    def _keep(self, store: OrderedDict[Any, Any], key: Any, value: Any) -> None:
        """Remember `value`, and forget the oldest beyond the window."""
        store[key] = value
        if len(store) > self._window:
            store.popitem(last=False)
