"""What of the environment ROS would stumble over, said before it does."""

from __future__ import annotations

import importlib.util
import os
import sys

from iolspi_ros.errors import InputError

MOST_DOMAIN = 232
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
RANGES = ("LOCALHOST", "SUBNET", "OFF", "SYSTEM_DEFAULT")
_CHOSEN = (RANGE, "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER",
           "FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE",
           "CYCLONEDDS_URI")  # fmt: skip
"""Variables with which somebody has said who may hear the graph."""


def check() -> None:
    """Say what of the environment rclpy would stumble over.

    Raises
    ------
    InputError
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "")
    if domain and not (domain.isascii() and domain.isdecimal() and int(domain) <= MOST_DOMAIN):
        raise InputError(
            f"environment variable ROS_DOMAIN_ID is {domain!r}; allowed: 0 to {MOST_DOMAIN}"
        )
    discovery = os.environ.get(RANGE, "")
    if discovery and discovery not in RANGES:
        raise InputError(
            f"environment variable {RANGE} is {discovery!r}; allowed: {', '.join(RANGES)}"
        )


def keep_to_this_machine() -> bool:
    """Let nobody on the network hear the graph, unless somebody has chosen; whether it did."""
    if any(os.environ.get(name) for name in _CHOSEN):
        return False
    os.environ[RANGE] = "LOCALHOST"
    return True


def no_ros(error: ImportError) -> InputError | None:
    """Why ROS cannot be imported, in a line; None when that is not what failed."""
    names = ("rclpy", "rpyutils", "rosidl", "rcl_interfaces", "ament_index")
    try:
        found = importlib.util.find_spec("rclpy")
    except (ImportError, ValueError):
        found = None
    where = found.origin if found is not None else "nowhere"
    shadowed = found is not None and not str(where).startswith(sys.prefix)
    if not shadowed and not any(name in f"{error.name} {error} {error.path}" for name in names):
        return None
    cure = (
        "another ROS stands before this one: unset PYTHONPATH, or use the Python that it is for"
        if shadowed
        else "install it: pip install 'ros-rclpy[fastrtps]==7.1.6' ros-common-interfaces==5.3.6"
    )
    return InputError(f"rclpy ({where}) cannot be imported: {error}; {cure}")
