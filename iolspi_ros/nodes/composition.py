"""Simulator and learner in one process, as a component container has them: for fast training.

An observation is handed over as it is, and so is the answer; the topics carry what somebody else
listens to. The bits that come of it are those of two processes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from iolspi_ros import runtime
from iolspi_ros.nodes.demonstrator import Demonstrator
from iolspi_ros.nodes.learner import LearnerNode
from iolspi_ros.vehicle_topics import Answer
from sim_nodes.simulator import Simulator

BURST = 200
"""Steps between two looks at what the graph has brought, at most."""
MOMENT = 0.05
"""Seconds between them, at most."""


class Composition:
    """Nodes of one process.

    Parameters
    ----------
    arguments : sequence of str
        As in `sys.argv`; what is for one node alone has its name before it, as in
        `-p learner:seed:=1`.
    demonstrator : bool
        Whether a demonstrator is among them.
    """

    def __init__(self, arguments: Sequence[str], *, demonstrator: bool) -> None:
        self.simulator = Simulator(arguments)
        self.learner = LearnerNode(arguments, local=True)
        self.learner.vehicle = self.simulator
        self.nodes = [self.simulator, self.learner]
        if demonstrator:
            self.nodes.append(Demonstrator(arguments))

    def pump(self) -> bool:
        """Let the vehicle move and the learner answer, for a while; False when nothing moved."""
        end = time.monotonic() + MOMENT
        for step in range(BURST):
            if time.monotonic() > end:
                break
            observation = self.simulator.handed_over()
            answer = None if observation is None else self.learner.respond(observation)
            if observation is None or answer is None:
                return step > 0
            self.simulator.take(Answer(observation.episode, observation.step, *answer))
        return True


def main() -> int:
    """Run them; a demonstrator among them when it is given bags."""

    def make(arguments: Sequence[str]) -> Composition:
        demonstrator = any("bags:=" in argument for argument in arguments)
        return Composition(arguments, demonstrator=demonstrator)

    return runtime.main(make, "graph")
