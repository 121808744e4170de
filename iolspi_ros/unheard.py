"""Why a topic that somebody publishes is not heard: another type, or a quality of service."""

from __future__ import annotations

from typing import Any

from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible


def unheard(node: Any, topic: str, kind: str, profile: QoSProfile) -> str:
    """What stands between a topic's publishers and a subscription, in words; empty for nothing.

    Parameters
    ----------
    node : rclpy.node.Node
    topic : str
        Resolved.
    kind : str
        Type that is listened for, as "std_msgs/msg/String"; empty for any.
    profile : QoSProfile
        With which it is listened.
    """
    for other in node.get_publishers_info_by_topic(topic):
        if kind and other.topic_type != kind:
            return (
                f"topic {topic} is published by {name_of(other)} as {other.topic_type}, and {kind} "
                "is listened for"
            )
        found, why = qos_check_compatible(other.qos_profile, profile)
        if found == QoSCompatibility.ERROR:
            return (
                f"topic {topic} of {name_of(other)} cannot be heard: its quality of service does "
                f"not suit ({why.strip('; ')})"
            )
    return ""


def name_of(other: Any) -> str:
    """Of the node at a topic's other end; just after it has come nobody knows."""
    name = str(other.node_name)
    return "a node" if "UNKNOWN" in name else name
