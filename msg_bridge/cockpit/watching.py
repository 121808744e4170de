"""Listens to a graph, and keeps what is to be shown on a board."""

from __future__ import annotations

import base64
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import Marker, MarkerArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.learner import Learner
from iolspi_ros.errors import InputError
from iolspi_ros.learner_asked import LearnerAsked
from iolspi_ros.pairing import Pairer
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import TaskListener
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.episodes import Episodes, Score
from msg_bridge.cockpit.policy import policy_map

PERIOD, SLOW_PERIOD = 1 / 30, 1.0
"""Seconds between looks at what came: at states; at maps and the pace."""
AT_ONCE = 64
"""States taken in a look; in lockstep more come, and the newest are shown."""
LARGEST = 2**22
"""Bytes of an image that is shown."""
_IMAGES = {"jpeg": b"\xff\xd8\xff", "png": b"\x89PNG\r\n\x1a\n"}
LINES = 6
"""Of advice that are shown."""
_KINDS = {Marker.CUBE: "box", Marker.SPHERE: "ball", Marker.LINE_STRIP: "line"}


class Watching:
    """Shows `task`, `state`, `reward`, `markers`, `score`, `update` and more on a board.

    Parameters
    ----------
    node : rclpy.node.Node
    board : Board
    on_task : callable
        Called with the task when it is heard.
    images : bool
        Whether to show `image/compressed`, which a vehicle draws only for those who look.
    """

    def __init__(
        self,
        node: Node,
        board: Board,
        on_task: Callable[[TaskDescription], None],
        images: bool = False,
    ) -> None:
        self._node, self.board, self._on_task, self._images = node, board, on_task, images
        self._states: deque[bytes] = deque(maxlen=AT_ONCE)
        self._rewards: deque[bytes] = deque(maxlen=AT_ONCE)
        self._actions: deque[bytes] = deque(maxlen=1)
        self._health: dict[str, dict[str, Any]] = {}
        self._weights: Any = None
        self._learner: Learner | None = None
        self.episodes: Episodes | None = None
        self.ignored = 0
        self._pace = (0.0, 0)  # when, and the stamp then [s, ns]
        self._updates = wire.Rows("update", wire.UPDATE)
        self._scores = wire.ScoreRows()
        self._action_rows, self._asked_by = wire.Rows("action", wire.ACTION), -1
        self._subscriptions: list[Any] = []
        self._timers = [
            runtime.wall_timer(node, PERIOD, self._look),
            runtime.wall_timer(node, SLOW_PERIOD, self._look_slowly),
        ]
        self._listener = TaskListener(node, self._hear, self._conflict)
        self._asked: LearnerAsked | None = None
        self._listen("/diagnostics", DiagnosticArray, self._on_diagnostics, qos.RECORDING)

    def close(self) -> None:
        """Listen no more."""
        self._listener.close()
        for timer in self._timers:
            self._node.destroy_timer(timer)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        if self._asked is not None:
            self._asked.close()

    def _listen(
        self, topic: str, kind: Any, handle: Callable[[Any], None], profile: QoSProfile
    ) -> None:
        def careful(message: Any) -> None:
            try:
                handle(message)
            except InputError as error:
                self.ignored += 1
                self._node.get_logger().warning(str(error), throttle_duration_sec=5.0)

        self._subscriptions.append(self._node.create_subscription(kind, topic, careful, profile))

    def _hear(self, task: TaskDescription) -> None:
        self.episodes, self._pairer = Episodes(task), Pairer(task, 2 * AT_ONCE)
        self._asked = LearnerAsked(self._node, task, self._on_learner)
        x, y = (task.variables[d].axis for d in task.map_dims)
        self.board.put("task", {
            "name": task.name, "actions": [action.name for action in task.actions],
            "neutral": task.neutral, "sampling_time": task.sampling_time,
            "episode_steps": task.episode_steps, "axes": [x, y],
            "variables": [
                {"name": v.axis, "low": v.low, "high": v.high, "periodic": v.periodic}
                for v in task.variables
            ],
        })  # fmt: skip
        # Kept as bytes: in lockstep thousands come in a second, and few are shown.
        for topic, kind, kept in (
            ("state", wire.states(task).type, self._states),
            ("reward", Float64MultiArray, self._rewards),
            ("action", Float64MultiArray, self._actions),
        ):
            self._subscriptions.append(
                self._node.create_subscription(
                    kind, topic, lambda data, kept=kept: kept.append(data), qos.WATCHING, raw=True
                )
            )
        self._listen("markers", MarkerArray, self._on_markers, qos.LATCHED)
        if self._images:
            self._listen("image/compressed", CompressedImage, self._on_image, qos.LATCHED)
        self._listen("score", Float64MultiArray, self._on_score, qos.REPORTS)
        self._listen("update", Float64MultiArray, self._on_update, qos.REPORTS)
        self._listen("weights", Float64MultiArray, self._on_weights, qos.REPORTS)
        for topic, names in (
            ("piloting", wire.PILOTING), ("takeover", wire.TAKEOVER), ("help", wire.HELP),
        ):  # fmt: skip
            rows = wire.Rows(topic, names)
            self._listen(topic, Float64MultiArray, self._shower(topic, rows), qos.LATCHED)
        self._listen("advice", String, self._on_advice, qos.LATCHED)
        self._on_task(task)

    def _conflict(self, text: str) -> None:
        self._node.get_logger().error(text)
        self.board.put("said", {"text": text, "good": False})

    def _shower(self, part: str, rows: wire.Rows) -> Callable[[Any], None]:
        return lambda message: self.board.put(part, rows.read_all(message))

    # ------------------------------------------------------------ what comes

    def _look(self) -> None:
        """Take what has come of states and rewards since the last look."""
        if self.episodes is None or not self._rewards:
            return
        seen = []
        for kept, take in (
            (self._states, self._pairer.state),
            (self._rewards, self._pairer.reward),
        ):
            while kept:
                try:
                    seen.append(take(kept.popleft()))
                except InputError:
                    self.ignored += 1
        for observation in sorted(filter(None, seen), key=lambda o: (o.episode, o.step)):
            self.episodes.take(observation)
            if observation.last:
                self._show_scores()
        for action in self._taken(self._actions, self._action_rows.read):
            self._asked_by = wire.whole(action[-1])
        self.board.put("now", self.episodes.as_shown(self._asked_by))

    def _taken(self, kept: deque[bytes], read: Callable[[bytes], Any]) -> list[Any]:
        """What the messages that were kept say; what is none is counted."""
        found = []
        while kept:
            try:
                found.append(read(kept.popleft()))
            except InputError:
                self.ignored += 1
        return found

    def _look_slowly(self) -> None:
        """Show maps, and how fast it goes."""
        if self.episodes is None or self._asked is None:
            return
        if self._show_pace():
            visits = self.episodes.map_of_visits()
            self.board.put("visits", {
                "bins": len(visits), "counts": visits.ravel().tolist(),
                "limits": self.episodes.limits,
            })  # fmt: skip
        self._asked.ask()
        self._show_policy()

    def _show_pace(self) -> bool:
        """Show vehicle seconds per second since the last look; whether the vehicle moved."""
        assert self.episodes is not None
        then, before = self._pace
        seen = self.episodes.now
        self._pace = now, stamp = time.monotonic(), seen.stamp if seen is not None else 0
        factor = (stamp - before) / wire.NANOSECONDS / (now - then) if before else 0.0
        self.board.put("rate", {"factor": max(factor, 0.0)})
        return stamp != before

    def _show_policy(self) -> None:
        """Draw the policy map if there is a new policy: at most once a second."""
        limits = None if self.episodes is None else self.episodes.limits
        if self._weights is None or self._learner is None or limits is None:
            return
        weights, number = self._weights
        self._weights = None
        try:
            shown = policy_map(self._learner, weights, limits)
        except (ValueError, InputError) as error:  # weights of another learner
            self._node.get_logger().warning(f"no map of the policy: {error}")
            return
        self.board.put("policy", shown | {"number": number})

    def _on_learner(self, learner: Learner) -> None:
        self._learner = learner

    def _on_weights(self, message: Any) -> None:
        self._weights = wire.read_weights(message)

    def _on_score(self, message: Any) -> None:
        episode, _, _, _, score, _, _, interventions = self._scores.read(message)
        assert self.episodes is not None
        self.episodes.score(Score(wire.whole(episode), score, False, wire.whole(interventions)))
        self._show_scores()

    def _show_scores(self) -> None:
        assert self.episodes is not None
        self.board.put("scores", [
            [s.episode, s.score, s.demonstrated, s.interventions]
            for _, s in sorted(self.episodes.scores.items())
        ])  # fmt: skip

    def _on_update(self, message: Any) -> None:
        row = self._updates.read_all(message)
        self.board.put("update", {name: row[name] for name in wire.UPDATE[4:]})

    def _on_advice(self, message: Any) -> None:
        self.board.put("advice", message.data.splitlines()[:LINES])

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            level = int.from_bytes(status.level, "big")
            self._health[status.name] = {
                "name": status.name, "level": level, "text": status.message,
            }  # fmt: skip
        self.board.put("health", list(self._health.values()))

    def _on_markers(self, message: Any) -> None:
        shapes = [_shape(m) for m in message.markers if m.action == Marker.ADD]
        self.board.put("picture", [shape for shape in shapes if shape is not None])

    def _on_image(self, message: Any) -> None:
        data = bytes(message.data)
        kind = next((name for name, first in _IMAGES.items() if data.startswith(first)), None)
        if kind is None or len(data) > LARGEST:
            raise InputError(
                f"image/compressed has {len(data)} bytes of {message.format!r}; allowed: JPEG or "
                f"PNG of at most {LARGEST}"
            )
        self.board.put("image", f"data:image/{kind};base64,{base64.b64encode(data).decode()}")


def _shape(marker: Any) -> dict[str, Any] | None:
    """A marker for the page; None for what it cannot draw."""
    kind = _KINDS.get(marker.type)
    if kind is None:
        return None
    at = marker.pose.position
    points = marker.points if kind == "line" else [at]
    c = marker.color
    return {
        "name": marker.ns, "kind": kind, "size": [marker.scale.x, marker.scale.y, marker.scale.z],
        "points": [[round(p.x, 5), round(p.y, 5), round(p.z, 5)] for p in points],
        "colour": [round(255 * value) for value in (c.r, c.g, c.b)] + [round(c.a, 2)],
    }  # fmt: skip
