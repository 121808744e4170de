"""Tells who demonstrates what their episodes are good for: `advice`, in plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from std_msgs.msg import String

from iolspi_ros import qos, runtime
from iolspi_ros.bags import coaching, survey
from iolspi_ros.core.samples import Transitions
from iolspi_ros.nodes.foresight import Foresight
from iolspi_ros.nodes.piloting import Flown


class Coach:
    """Publishes what the kept episodes cover, what would be learned from them, what helps most now.

    Parameters
    ----------
    node : SamplesOut
    foresees : bool
        Whether to learn beside from what is kept.
    """

    def __init__(self, node: Any, *, foresees: bool) -> None:
        self._node, self._task = node, node.task
        self._out = node.create_publisher(String, "advice", qos.LATCHED)
        self._foresight = Foresight(node, node.task) if foresees else None
        self._n_kept = 0
        self._share: float | None = None
        self._batch = Transitions.of([], self._task.n_dims)
        self._say("")

    def kept(self, flown: Sequence[Flown]) -> None:
        """Other episodes are kept now."""
        samples = [sample.transition for one in flown for sample, _ in one.samples]
        self._n_kept, self._batch = len(flown), Transitions.of(samples, self._task.n_dims)
        self._share = None
        if self._foresight is not None:
            self._foresight.ask(self._batch)
        beside = self._foresight is not None and self._foresight.busy
        self._say("Learning beside from what is kept …" if beside else "")

    def look(self) -> None:
        """Say what was found out beside."""
        found = self._foresight.look() if self._foresight is not None else None
        if found is not None:
            self._share = found.get("share")
            self._say(foretold(found, self._n_kept, self._task.success))

    def _say(self, foreseen: str) -> None:
        task, batch = self._task, self._batch
        covered = f"Kept: {survey.extent(batch, task)}." if len(batch) else ""
        hint = coaching.hint(batch, task, self._share, self._node.corruption)
        self._out.publish(String(data="\n".join(filter(None, (foreseen, hint, covered)))))

    def close(self) -> None:
        """Say nothing more."""
        self._out.publish(String())
        if self._foresight is not None:
            self._foresight.close()
        runtime.destroy_publishers(self._node, self._out)


def foretold(found: Mapping[str, Any], n_episodes: int, success: str) -> str:
    """What the learner would get, as `experiments.preview.foresee` has it, in words."""
    taught = f"Taught by {'this episode' if n_episodes == 1 else f'these {n_episodes} episodes'}"
    if not found:
        return f"{taught} the learner would get nothing yet."
    share = found.get("share")
    if share is None:
        useful = "a policy" if found.get("accepted") else "no policy that can be believed"
        return f"{taught} the learner would get {useful}; there is no model to fly it on."
    goal = success or "succeed"
    doubt = "" if found.get("accepted") else ", by a policy that is still in doubt"
    return f"{taught} the learner's vehicle would {goal} from {share:.0%} of the starts{doubt}."
