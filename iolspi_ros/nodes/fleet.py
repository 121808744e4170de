"""One learner, several vehicles: it acts on each, and learns from all of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Transition
from iolspi_ros.nodes.control_loop import Controller, ControlLoop, Host
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener


class Fleet(ControlLoop):
    """The loop of the learner's own vehicle, and with it those of others in their namespaces.

    Parameters
    ----------
    node : Host
    task : TaskDescription
        Of all of them; one that says another is not flown.
    controller : Controller
        Takes the transitions of all, and chooses for all.
    timeout : float
    local : bool
        As of `ControlLoop`.
    others : sequence of str
        Namespaces.

    Attributes
    ----------
    counts : dict of str to int
        Transitions that each of the others brought.
    """

    def __init__(
        self, node: Host, task: TaskDescription, controller: Controller, timeout: float,
        *, local: bool, others: Sequence[str],
    ) -> None:  # fmt: skip
        super().__init__(node, task, controller, timeout, local=local)
        self.counts: dict[str, int] = {}
        self._others: dict[str, _Other] = {
            name: _Other(node, task, controller, name, self.counts) for name in others if name
        }

    @property
    def all_wait(self) -> bool:
        """Whether every vehicle waits for its answers, as far as was seen."""
        return self.waits and all(other.waits for other in self._others.values())

    def start(self) -> None:
        """Begin to answer."""
        super().start()
        for other in self._others.values():
            other.start()

    def stop(self) -> None:
        """Stop answering."""
        super().stop()
        for other in self._others.values():
            other.stop()

    def go_on(self) -> None:
        """Answer what waited until the controller could choose again, of every vehicle."""
        super().go_on()
        for other in self._others.values():
            other.go_on()

    def condition(self) -> tuple[dict[str, object], str]:
        """How it goes, with what each of the others brought."""
        values, worry = super().condition()
        return values | {f"samples of {name}": n for name, n in self.counts.items()}, worry

    def close(self) -> None:
        """Stop listening and publishing."""
        super().close()
        for other in self._others.values():
            other.close()


class _Other:
    """Another vehicle: flown as soon as it says that its task is the same."""

    def __init__(
        self, node: Host, task: TaskDescription, controller: Controller, name: str,
        counts: dict[str, int],
    ) -> None:  # fmt: skip
        self._node, self._controller, self._name = node, controller, name
        self._counts = counts
        self._loop = ControlLoop(node, task, self, 0.0, prefix=f"/{name.strip('/')}/")
        self._same = self._wanted = False
        self._task = task
        self._listener = TaskListener(
            node, self._on_task, self._on_conflict, prefix=f"/{name.strip('/')}/"
        )

    def _on_task(self, task: TaskDescription) -> None:
        found = self._task.differences(task)
        if found:
            self._on_conflict(f"the task of {self._name} is another one: {'; '.join(found)}")
            return
        self._same = True
        if self._wanted:
            self._loop.start()

    def _on_conflict(self, text: str) -> None:
        self._same = False
        self._loop.stop()
        self._node.get_logger().error(f"{text}; it is not flown")

    @property
    def waits(self) -> bool:
        """See `ControlLoop`."""
        return self._loop.waits

    def start(self) -> None:
        self._wanted = True
        if self._same:
            self._loop.start()

    def stop(self) -> None:
        self._wanted = False
        self._loop.stop()

    def close(self) -> None:
        self._listener.close()
        self._loop.close()

    # ------------------------------------------------------------ in its control loop

    def transition(self, before: Observation, transition: Transition) -> None:
        """Learn from a step of this vehicle."""
        self._counts[self._name] = self._counts.get(self._name, 0) + 1
        self._controller.transition(before, transition)

    @property
    def busy(self) -> bool:
        """Whether the controller of all cannot choose yet."""
        return self._controller.busy

    def go_on(self) -> None:
        """Answer what waited for the controller."""
        self._loop.go_on()

    def choose(self, observation: Observation) -> tuple[int, Source]:
        """Choose as for any."""
        return self._controller.choose(observation)

    def answered(self, observation: Observation, source: Source, answer: Any) -> None:
        """Scores are those of the learner's own vehicle."""
