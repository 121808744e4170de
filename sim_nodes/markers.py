"""The simulator's picture on the graph, for RViz and Foxglove."""

from __future__ import annotations

import time

import numpy as np
from geometry_msgs.msg import Point
from rclpy.node import Node
from visualization_msgs.msg import Marker, MarkerArray

from iolspi_ros import qos, runtime, wire
from iolspi_ros.core.samples import Observation
from sim_nodes import pictures
from sim_nodes.tasks.base import Task
from sim_nodes.tasks.shapes import AMBER, BALL, BOX, FALL_TIME, LINE, Picture, Shape

FRAME = "world"
PERIOD = 0.02
"""Seconds of wall time between two pictures at least: nobody sees more, and lockstep is fast."""

_KINDS = {
    BOX: Marker.CUBE,
    BALL: Marker.SPHERE,
    LINE: Marker.LINE_STRIP,
}


class Markers:
    """Publishes `markers` while somebody looks, and does next to nothing while nobody does.

    Parameters
    ----------
    node : rclpy.node.Node
    task : Task
    """

    def __init__(self, node: Node, task: Task) -> None:
        self._node, self._task = node, task
        self._out = node.create_publisher(MarkerArray, "markers", qos.LATCHED)
        self._shown = 0.0
        self._latest: Observation | None = None
        self._before: Observation | None = None

    def show(self, observation: Observation) -> None:
        """Publish what an observation looks like; how an episode ended is never left out."""
        if observation is not self._latest:  # else it is repeated
            self._before, self._latest = self._latest, observation
        now = time.monotonic()
        if now - self._shown < PERIOD and not observation.terminated:
            return
        self._shown = now
        if not self._out.get_subscription_count():
            return
        shapes = pictures.picture(self._task, observation.state)
        if observation.terminated and self._before is not None:
            shapes += _fall(self._task, self._before, observation)
        self._out.publish(message(shapes, observation.stamp))

    def close(self) -> None:
        """Show nothing more."""
        runtime.destroy_publishers(self._node, self._out)


def message(shapes: Picture, stamp: int) -> MarkerArray:
    """One marker for each shape, known by its name as namespace."""
    return MarkerArray(markers=[_marker(shape, stamp) for shape in shapes])


def _marker(shape: Shape, stamp: int) -> Marker:
    marker = Marker(ns=shape.name, type=_KINDS[shape.kind], action=Marker.ADD)
    marker.header.frame_id = FRAME
    marker.header.stamp.sec, marker.header.stamp.nanosec = wire.split(stamp)
    marker.pose.orientation.w = 1.0
    points = [Point(x=x, y=y, z=z) for x, y, z in shape.points]
    if shape.kind == LINE:
        marker.points = points
    else:
        marker.pose.position = points[0]
    marker.scale.x, marker.scale.y, marker.scale.z = shape.size
    colour = marker.color
    colour.r, colour.g, colour.b, colour.a = shape.colour
    return marker


def _fall(task: Task, before: Observation, last: Observation) -> Picture:
    """The path of what was released; it stays until the next one."""
    times = np.linspace(0.0, FALL_TIME, 15)
    path = pictures.released(task, before.state, last.reward, times)
    if not len(path):
        return ()
    points = tuple((x, y, z) for x, y, z in path.tolist())
    return (Shape("fall", LINE, points, (0.02, 0.0, 0.0), (*AMBER[:3], 0.6)),)
