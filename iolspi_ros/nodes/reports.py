"""What the learner says about itself: score, update, weights, /diagnostics."""

from __future__ import annotations

import math

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.online import OnlineLSPI, Source, Update
from iolspi_ros.core.refresh import STOPS
from iolspi_ros.core.samples import Observation
from iolspi_ros.core.solve import STATUSES


class Reports:
    """Publishes the learner's reports.

    Parameters
    ----------
    node : rclpy.node.Node
        Whose topics they are.
    core : OnlineLSPI
    """

    def __init__(self, node: Node, core: OnlineLSPI) -> None:
        self._node = node
        self._core = core
        self._score_rows = wire.Rows("score", wire.SCORE)
        self._update_rows = wire.Rows("update", wire.UPDATE)
        self._score_out = node.create_publisher(Float64MultiArray, "score", qos.REPORTS)
        self._update_out = node.create_publisher(Float64MultiArray, "update", qos.REPORTS)
        self._weights_out = node.create_publisher(Float64MultiArray, "weights", qos.REPORTS)
        self._diagnostics_out = node.create_publisher(DiagnosticArray, "/diagnostics", qos.OUTGOING)
        self._update: Update | None = None
        self._kept = 0
        self._stop = "none"
        self._key = (0, 0)
        self._begin()

    def _begin(self) -> None:
        self._score, self._discounted, self._explored = 0.0, 0.0, 0

    def answered(self, observation: Observation, source: Source) -> None:
        """Add a reward to the score of its episode; publish the score at the end."""
        if observation.step == 0:
            self._begin()
        elif math.isfinite(observation.reward):
            self._score += observation.reward
            gamma = self._core.settings.gamma
            self._discounted += gamma ** (observation.step - 1) * observation.reward
        self._explored += source == Source.EXPLORE
        self._key = (observation.episode, observation.step)
        if observation.last:
            values = (*self._head(), self._score, self._discounted, self._explored)
            runtime.publish(self._score_out, self._score_rows.message(*values))

    def update(self, update: Update) -> None:
        """Publish one policy update."""
        solve, core, found = update.solve, self._core, update.refresh
        self._update = update
        self._kept += not update.accepted
        if update.number == 0:
            self._stop = update.describe()
        runtime.publish(
            self._update_out,
            self._update_rows.message(
                *self._head(), update.number, update.accepted, float(np.linalg.norm(core.weights)),
                update.change, core.epsilon, solve.condition, solve.rank, solve.residual,
                core.n_samples, update.step, STATUSES.index(solve.status),
                *(
                    (found.iterations, STOPS.index(found.stop), found.delta, found.rungs,
                     found.doubted)
                    if found else (0, 0, 0.0, 0, 0)
                ),
            )
        )  # fmt: skip

    def weights(self) -> None:
        """Publish the weights in use."""
        message = wire.weights_message(self._core.weights, self._core.updates)
        runtime.publish(self._weights_out, message)

    def diagnostics(self, condition: dict[str, object]) -> None:
        """Publish the learner's health.

        Parameters
        ----------
        condition : dict
            What the node knows beside the core.
        """
        core, update = self._core, self._update
        values: dict[str, object] = dict(condition)
        values |= {
            "updates": core.updates,
            "updates that kept the weights before": self._kept,
            "epsilon": f"{core.epsilon:.4g}",
            "weights' norm": f"{np.linalg.norm(core.weights):.6g}",
            "transitions dropped (not finite)": core.dropped,
            "offline LSPI": self._stop,
            "shield": self._shield(),
        }
        level, text = DiagnosticStatus.OK, str(condition["phase"])
        if update is not None:
            solve = update.solve
            values |= {
                "last update": update.describe(),
                "last solve": solve.status,
                "condition": f"{solve.condition:.3g}",
                "rank": solve.rank,
                "residual": f"{solve.residual:.3g}",
            }
            if not solve.healthy:
                level, text = DiagnosticStatus.WARN, f"{text}; last solve {solve.status}"
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        pairs = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        name = f"{self._node.get_fully_qualified_name()[1:]}: learning"
        status = DiagnosticStatus(level=level, name=name, message=text, values=pairs)
        message.status = [status]
        runtime.publish(self._diagnostics_out, message)

    def _shield(self) -> str:
        if not self._core.shield.raised:
            return "off"
        active = self._core.shield.guard.active
        return f"{self._core.vetoes} vetoes" + ("" if active else ", not enough samples yet")

    def _head(self) -> tuple[int, int, int, int]:
        now = self._node.get_clock().now().nanoseconds
        return (*self._key, *wire.split(now))
