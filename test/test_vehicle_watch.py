"""Waiting for a vehicle: for ever with a word now and then, or up to a time."""

from types import SimpleNamespace

import pytest

from iolspi_ros.nodes import vehicle_watch
from iolspi_ros.nodes.learning import LearningSettings
from iolspi_ros.nodes.teleop import TeleopSettings
from iolspi_ros.nodes.vehicle_watch import VehicleWatch


class Node:
    """What of a node is used; its timer goes when it is told to."""

    def __init__(self):
        self.said, self.failed, self.periods, self.cancelled = [], [], [], 0
        self.get_logger = lambda: SimpleNamespace(info=self.said.append)
        self.get_publishers_info_by_topic = lambda topic: []
        self.fail = self.failed.append

    def create_timer(self, period, callback, clock):
        self.periods.append(period)
        self.tick = callback
        return SimpleNamespace(cancel=self.cancel)

    def cancel(self):
        self.cancelled += 1


def test_by_default_learner_and_demonstrator_wait_as_long_as_it_takes():
    assert LearningSettings().vehicle_timeout == 0.0
    assert TeleopSettings().vehicle_timeout == 0.0


def test_it_says_that_it_waits_and_never_gives_up():
    node, heard = Node(), []
    VehicleWatch(node, "/state", lambda: bool(heard), 0.0)
    assert node.periods == [vehicle_watch._NEWS]
    for _ in range(13):
        node.tick()
    assert node.said == [
        f"waiting for a vehicle: nothing on /state for {seconds:g} s" for seconds in (10, 70, 130)
    ]
    assert node.failed == []
    heard.append(1)
    node.tick()
    assert (node.cancelled, len(node.said)) == (1, 3)


@pytest.mark.parametrize("comes", [True, False])
def test_with_a_time_out_it_ends_the_node_once(comes):
    node = Node()
    VehicleWatch(node, "/state", lambda: comes, 3.0)
    assert node.periods == [3.0]
    node.tick()
    assert node.cancelled == 1
    assert [str(error) for error in node.failed] == [
        "no vehicle: nothing on /state for 3 s; start a simulator in the same ROS_DOMAIN_ID and "
        "namespace, or set the parameter vehicle_timeout to 0.0 to wait for ever"
    ] * (not comes)
