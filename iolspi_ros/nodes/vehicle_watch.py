"""Waiting for a vehicle: as long as it takes, saying so now and then, or up to a time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.qos import QoSProfile

from iolspi_ros import qos, runtime
from iolspi_ros.errors import InputError
from iolspi_ros.unheard import unheard

TASK = "std_msgs/msg/String"
_NEWS = 10.0
"""Seconds after which it is first said that nobody is there."""
_QUIET = 6
"""Every so many of them it is said again."""


class VehicleWatch:
    """Looks whether a vehicle is heard on a topic; ends the node after `timeout`, if there is one.

    Parameters
    ----------
    node
        Logs, and fails; its timers are used.
    topic : str
        Resolved.
    heard : callable
        Whether it is.
    timeout : float
        Seconds; 0.0 for as long as it takes.
    kind : str
        Type of the topic; empty for any.
    profile : QoSProfile
        With which it is listened.
    """

    def __init__(
        self,
        node: Any,
        topic: str,
        heard: Callable[[], bool],
        timeout: float,
        kind: str = "",
        profile: QoSProfile = qos.CONTROL,
    ) -> None:
        self._node, self._topic, self._heard = node, topic, heard
        self._timeout, self._kind, self._profile = timeout, kind, profile
        self._looked = 0
        self._timer = runtime.wall_timer(node, timeout or _NEWS, self._look)

    def close(self) -> None:
        """Look no more."""
        self._node.destroy_timer(self._timer)

    def _look(self) -> None:
        if self._heard():
            self._timer.cancel()
            return
        why = unheard(self._node, self._topic, self._kind, self._profile)
        if self._timeout:
            self._timer.cancel()
            self._node.fail(self._no_vehicle(why))
            return
        if self._looked % _QUIET == 0:
            seconds, log = _NEWS * (self._looked + 1), self._node.get_logger()
            if why:
                log.warning(f"waiting for a vehicle: {why}")
            else:
                log.info(f"waiting for a vehicle: nothing on {self._topic} for {seconds:g} s")
        self._looked += 1

    def _no_vehicle(self, why: str) -> InputError:
        """Nobody is heard on a topic where a vehicle should be, or what keeps it from it."""
        if why:
            allowed = f"what docs/interfaces.md says of {self._topic}"
            return InputError(f"no vehicle: {why}; allowed: {allowed}")
        return InputError(
            f"no vehicle: nothing on {self._topic} for {self._timeout:g} s; start a simulator in "
            "the same ROS_DOMAIN_ID and namespace, or set the parameter vehicle_timeout to 0.0 to "
            "wait for ever"
        )
