"""What the learner says about itself: score, update, weights, /diagnostics."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.learner import PERSON, Learner, Source, Update
from iolspi_ros.core.samples import Array, Observation


class Reports:
    """Publishes a learner's reports.

    Parameters
    ----------
    node : rclpy.node.Node
        Whose topics they are.
    core : Learner
    """

    def __init__(self, node: Node, core: Learner) -> None:
        self._node = node
        self._core = core
        self._score_rows = wire.ScoreRows()
        self._update_rows: wire.Rows | None = None  # with the learner's own names, once known
        self._score_out = node.create_publisher(Float64MultiArray, "score", qos.REPORTS)
        self._update_out = node.create_publisher(Float64MultiArray, "update", qos.REPORTS)
        self._weights_out = node.create_publisher(Float64MultiArray, "weights", qos.REPORTS)
        self._update: Update | None = None
        self._kept = self._all_interventions = 0
        self._pretraining = "none"
        self._key = (0, 0)
        self._episode = -1  # whose sums those are; -1 for that of whatever comes next
        self.silent = False
        """Whether what is reported was so before, and nothing is published."""
        self._begin()

    def _begin(self) -> None:
        self._score, self._discounted, self._explored = 0.0, 0.0, 0
        self._interventions, self._flown = 0, False  # whether a person chose the action before
        self._before = int(Source.HOLD)  # what was answered last

    def answered(self, observation: Observation, source: Source) -> None:
        """Add a reward to the score of its episode; publish the score at the end."""
        if observation.step == 0 or self._episode not in (-1, observation.episode):
            self._begin()  # the first observation of an episode may have been missed
        self._episode = observation.episode
        if observation.step > 0 and math.isfinite(observation.reward):
            self._score += observation.reward
            gamma = self._core.task.gamma
            self._discounted += gamma ** (observation.step - 1) * observation.reward
        applied = observation.source if observation.source >= 0 else self._before
        self._explored += applied == Source.EXPLORE
        self._watch(applied)
        self._before = source
        self._key = (observation.episode, observation.step)
        if observation.last:
            sums = (self._score, self._discounted, self._explored, self._interventions)
            values = (*self._head(), *sums)
            self._publish(self._score_out, self._score_rows.message(*values))

    def _watch(self, source: int) -> None:
        """Count how often a person takes over; what the vehicle holds meanwhile is still theirs."""
        flown = source in PERSON or (self._flown and source == Source.HOLD)
        if flown and not self._flown:
            self._interventions += 1
            self._all_interventions += 1
        self._flown = flown

    def update(self, update: Update) -> None:
        """Publish one policy update."""
        core = self._core
        self._update = update
        self._kept += not update.accepted
        if update.number == 0:
            self._pretraining = update.text
        if self._update_rows is None:
            self._update_rows = wire.Rows("update", (*wire.UPDATE, *update.facts))
        message = self._update_rows.message(
            *self._head(), update.number, update.accepted, update.healthy,
            float(np.linalg.norm(core.snapshot)), update.change, core.epsilon, core.n_samples,
            update.step, *update.facts.values(),
        )  # fmt: skip
        self._publish(self._update_out, message)

    def weights(self) -> None:
        """Publish the weights in use."""
        message = wire.weights_message(self._core.snapshot, self._core.updates)
        self._publish(self._weights_out, message)

    def _publish(self, out: Any, message: Any) -> None:
        if not self.silent:
            out.publish(message)

    def condition(self) -> tuple[dict[str, object], str]:
        """How the learner is, by name, and what is wrong with it; empty for nothing."""
        core, update = self._core, self._update
        values: dict[str, object] = {
            "updates": core.updates,
            "updates that kept the weights before": self._kept,
            "epsilon": f"{core.epsilon:.4g}",
            "weights' norm": f"{np.linalg.norm(core.snapshot):.6g}",
            "transitions dropped": core.dropped,
            "times a person took over": self._all_interventions,
            "offline LSPI": self._pretraining,
            **core.health(),
        }
        if update is None:
            return values, ""
        values["last update"] = update.text
        values |= {name: f"{value:.4g}" for name, value in update.facts.items()}
        return values, "" if update.healthy else "the last update cannot be believed"

    def _head(self) -> tuple[int, int, int, int]:
        now = self._node.get_clock().now().nanoseconds
        return (*self._key, *wire.split(now))

    def memory(self) -> Array:
        """Sums of the episode under way, for a checkpoint."""
        sums = [self._score, self._discounted, self._explored, self._interventions, self._flown]
        return np.array([*sums, self._episode], float)

    def recall(self, memory: Array) -> None:
        """Go on from what `memory` gave."""
        if memory.shape not in ((3,), (5,), (6,)):  # as it was before each addition
            return
        self._score, self._discounted = float(memory[0]), float(memory[1])
        self._explored = int(memory[2])
        if len(memory) > 3:
            self._interventions, self._flown = int(memory[3]), bool(memory[4])
        if len(memory) > 5:
            self._episode = int(memory[5])

    def close(self) -> None:
        """Publish nothing more."""
        publishers = self._score_out, self._update_out, self._weights_out
        runtime.destroy_publishers(self._node, *publishers)
