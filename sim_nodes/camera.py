"""The vehicle as it draws itself, on the graph: for whoever shows `image/compressed`."""

from __future__ import annotations

import io
import time
from typing import Any

from PIL import Image
from rclpy.node import Node
from sensor_msgs.msg import CompressedImage

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from sim_nodes.markers import FRAME

PERIOD = 0.05
"""Seconds of wall time between two images at least: drawing one takes milliseconds."""


class Camera:
    """Publishes `image/compressed` while somebody looks, for a vehicle that has an `image`.

    Parameters
    ----------
    node : rclpy.node.Node
    vehicle : Task or Stateful
    """

    def __init__(self, node: Node, vehicle: Any) -> None:
        self._node = node
        self._out = (
            node.create_publisher(CompressedImage, "image/compressed", qos.LATCHED)
            if hasattr(vehicle, "image")
            else None
        )
        self._shown = 0.0

    def show(self, vehicle: Any, observation: Observation) -> None:
        """Publish what a vehicle looks like now; how an episode ended is never left out."""
        now = time.monotonic()
        soon = now - self._shown < PERIOD and not observation.last
        if self._out is None or soon or not self._out.get_subscription_count():
            return
        self._shown = now
        try:
            pixels = vehicle.image()
        except InputError as error:
            self._node.get_logger().warning(f"no images of the vehicle: {error}")
            self.close()
            return
        if pixels is None:
            return
        written = io.BytesIO()
        Image.fromarray(pixels).save(written, "JPEG", quality=85)
        message = CompressedImage(format="jpeg", data=written.getvalue())
        message.header.frame_id = FRAME
        message.header.stamp.sec, message.header.stamp.nanosec = wire.split(observation.stamp)
        self._out.publish(message)

    def close(self) -> None:
        """Show nothing more."""
        if self._out is not None:
            runtime.destroy_publishers(self._node, self._out)
        self._out = None
