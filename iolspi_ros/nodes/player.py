"""Replays bags as samples, as they were recorded or as fast as it goes."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iolspi_ros import runtime, wire
from iolspi_ros.bags import numbered_through, read_demonstration, select
from iolspi_ros.core.samples import Sample
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.samples_out import SamplesOut
from iolspi_ros.settings import Settings, setting

SLICE = 500
"""Samples sent in one go, so that signals and services are heard in between."""


@dataclass(frozen=True)
class PlayerSettings(Settings):
    """What is replayed, and how fast."""

    bags: tuple[str, ...] = setting(("",), "bags to replay, one after the other")
    bag_vehicle: str = setting("", "replay: namespace of the vehicle, where a bag has several")
    bag_run: int = setting(0, "replay: run, from 1, where a bag has several", low=0)
    bag_topics: tuple[str, ...] = setting(
        ("",), "replay: topics that are called otherwise, as state:=/joint_states"
    )
    rate: float = setting(
        0.0, "replay at so many times the recorded speed; 0.0 for as fast as it goes",
        low=0.0, high=1e6,
    )  # fmt: skip
    listeners: int = setting(1, "replay: nodes that must listen before it begins", low=1)
    learner_timeout: float = setting(
        10.0, "replay: give up when nobody listens for this long [s]; 0.0 for never",
        low=0.0, high=1e6,
    )  # fmt: skip


class Player:
    """Waits for a listener, then sends every sample of the bags.

    Parameters
    ----------
    node : SamplesOut
    settings : PlayerSettings

    Raises
    ------
    InputError
        When a bag cannot be used.
    """

    def __init__(self, node: SamplesOut, settings: PlayerSettings) -> None:
        self._node, self._settings = node, settings
        self._samples = _read(node, settings)
        self._next = 0
        self._start = time.monotonic()
        self._playing = self._begun = False
        self._timer = runtime.wall_timer(node, 0.02, self._play)

    def resume(self) -> None:
        """Play, or go on."""
        self._playing, self._start = True, time.monotonic()
        self._first = self._next

    def pause(self) -> None:
        """Play nothing for now."""
        self._playing = False

    def close(self) -> None:
        """Stop for good."""
        self._node.destroy_timer(self._timer)

    def _play(self) -> None:
        if not self._playing:
            return
        if not self._begun:
            if self._node.listeners() < self._settings.listeners:
                self._check_patience()
                return
            self._begun = True
            self._node.begin()
            self._start = time.monotonic()
        if not self._node.flush():
            return
        until = min(self._next + SLICE, len(self._samples))
        while self._next < until and self._due(self._samples[self._next]):
            self._node.send(self._samples[self._next])
            self._next += 1
        if self._next == len(self._samples):
            self._timer.cancel()
            self._node.end()

    def _check_patience(self) -> None:
        timeout = self._settings.learner_timeout
        if timeout and time.monotonic() - self._start > timeout:
            topic = self._node.resolve_topic_name("sample")
            self._node.fail(
                InputError(
                    f"nobody listens on {topic} after {timeout:g} s; start a learner in the same "
                    "ROS_DOMAIN_ID, or set the parameter learner_timeout to 0.0 to wait for ever"
                )
            )

    def _due(self, sample: Sample) -> bool:
        if self._settings.rate == 0.0:
            return True
        recorded = (sample.stamp - self._samples[self._first].stamp) / wire.NANOSECONDS
        return (time.monotonic() - self._start) * self._settings.rate >= recorded


def check_bags(settings: PlayerSettings) -> list[Path]:
    """Paths of the bags.

    Raises
    ------
    InputError
        When none are given.
    """
    paths = [Path(path).expanduser() for path in settings.bags if path]
    if not paths:
        raise InputError("parameter bags is empty; allowed: paths of rosbag2 directories")
    return paths


def _read(node: SamplesOut, settings: PlayerSettings) -> list[Sample]:
    chosen = select(settings.bag_vehicle, settings.bag_run, settings.bag_topics)
    demonstrations = [read_demonstration(path, node.task, chosen) for path in check_bags(settings)]
    for demonstration in demonstrations:
        n, path = len(demonstration.samples), demonstration.path
        for note in demonstration.notes:
            node.get_logger().warning(f"{path}: {note}; its {n} readable samples are used")
        node.get_logger().info(f"{path}: {n} samples, {who(demonstration.card)}")
    return numbered_through(demonstrations)


def who(card: dict[str, Any]) -> str:
    """Who flew, by the card."""
    return f"flown by {card['pilot']}" if "pilot" in card else "no card says who flew"
