"""Jazzy's message definitions, without ROS."""

from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore


@cache
def types() -> Any:
    """Definitions, hashes and codecs of every standard message."""
    return get_typestore(Stores.ROS2_JAZZY)
