"""Says on `help` when the learner asks for it."""

from __future__ import annotations

from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation, Transitions
from iolspi_ros.managed import ManagedNode
from iolspi_ros.nodes.unsure import HelpSettings, Unsure, Visits
from iolspi_ros.task import TaskDescription


class Help:
    """Publishes whether the learner asks for help, at each change and at each end of an episode.

    Parameters
    ----------
    node : ManagedNode
    task : TaskDescription
    settings : HelpSettings
        Nothing is counted or published unless they say so.

    Attributes
    ----------
    silent : bool
        Count, and say nothing.
    """

    def __init__(self, node: ManagedNode, task: TaskDescription, settings: HelpSettings) -> None:
        self._node, self._rows = node, wire.Rows("help", wire.HELP)
        self._unsure = Unsure(task, settings) if settings.ask_for_help else None
        self._out, self.silent = None, False
        if self._unsure is not None:
            self._out = node.create_publisher(Float64MultiArray, "help", qos.LATCHED)

    def known(self, demonstrations: Transitions) -> None:
        """Take what was demonstrated as known."""
        if self._unsure is not None:
            self._unsure.known(demonstrations.state)

    def memory(self) -> Visits | None:
        """Where the learner has been, for a checkpoint; None when nothing is counted."""
        return None if self._unsure is None else self._unsure.memory()

    def recall(self, visits: Visits | None) -> None:
        """Go on from what `memory` gave."""
        if self._unsure is not None and visits is not None:
            self._unsure.recall(visits)

    def answered(self, observation: Observation, source: Source) -> None:
        """Take a state, and who chose the action there."""
        unsure = self._unsure
        if unsure is None or self._out is None:
            return
        before = unsure.asks
        unsure.take(observation.state, source)
        if self.silent or (unsure.asks == before and not observation.last):
            return
        stamp = wire.split(observation.stamp)
        self._out.publish(self._rows.message(
            observation.episode, observation.step, *stamp, unsure.asks, unsure.unsure,
            unsure.vetoes,
        ))  # fmt: skip
        if unsure.asks and not before:
            self._node.get_logger().warning(unsure.reason, throttle_duration_sec=10.0)

    @property
    def reason(self) -> str:
        """Why it asks, in words; empty when it does not."""
        return "" if self._unsure is None else self._unsure.reason

    def close(self) -> None:
        """Ask no more."""
        if self._out is not None:
            runtime.destroy_publishers(self._node, self._out)
