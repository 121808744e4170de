"""What a person's node says to the vehicle and to the cockpit: `takeover` and `piloting`."""

from __future__ import annotations

from typing import Any

from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.takeover import REPEAT
from iolspi_ros.wire import Phase


class PilotTopics:
    """Publishes `piloting` at each change, and `takeover` besides as long as it is held.

    Parameters
    ----------
    node : rclpy.node.Node
    n_episodes : int
        How many episodes are wanted.

    Attributes
    ----------
    held : bool
    """

    def __init__(self, node: Any, n_episodes: int) -> None:
        self._node, self._n_episodes = node, n_episodes
        self._takeover_rows = wire.Rows("takeover", wire.TAKEOVER)
        self._piloting_rows = wire.Rows("piloting", wire.PILOTING)
        self._takeover_out = node.create_publisher(Float64MultiArray, "takeover", qos.LATCHED)
        self._piloting_out = node.create_publisher(Float64MultiArray, "piloting", qos.LATCHED)
        self._timer = runtime.wall_timer(node, REPEAT / 2, self._repeat)
        self._episodes = (0, 0)
        self._said: tuple[float, ...] = ()
        self._key: tuple[int, int, int, int] = (0, 0, 0, 0)
        self.held = False

    def say(
        self, phase: Phase, *, held: bool, episodes: tuple[int, int] | None = None,
        countdown: float = 0.0, seen: Observation | None = None,
    ) -> None:  # fmt: skip
        """Publish how it stands, unless that was said; episodes are those kept and discarded."""
        self._episodes = self._episodes if episodes is None else episodes
        if seen is not None:
            self._key = (seen.episode, seen.step, *wire.split(seen.stamp))
        if held != self.held:
            self.held = held
            self._hold()
        said = (phase, *self._episodes, round(countdown, 1), held, self._n_episodes)
        if said != self._said:
            self._said = said
            self._piloting_out.publish(self._piloting_rows.message(*self._key, *said))

    def _hold(self) -> None:
        self._takeover_out.publish(self._takeover_rows.message(*self._key, self.held))

    def _repeat(self) -> None:
        if self.held:
            self._hold()

    def let_go(self) -> None:
        """Give the vehicle back, if it is held."""
        if self.held:
            self.held = False
            self._hold()

    def close(self) -> None:
        """Let the vehicle go, and say nothing more."""
        self.let_go()
        self._node.destroy_timer(self._timer)
        runtime.destroy_publishers(self._node, self._takeover_out, self._piloting_out)
