"""Bags of demonstrations: written so that a kill loses nothing, read as far as they go."""

from iolspi_ros.bags.card import CARD, read_card, write_card
from iolspi_ros.bags.demonstration import (
    Demonstration,
    numbered_through,
    read_demonstration,
)
from iolspi_ros.bags.reader import Damage, Record, deserialise, records
from iolspi_ros.bags.selection import Selection, select
from iolspi_ros.bags.writer import BagWriter, check_place, compact

__all__ = [
    "CARD",
    "BagWriter",
    "Damage",
    "Demonstration",
    "Record",
    "Selection",
    "check_place",
    "compact",
    "deserialise",
    "numbered_through",
    "read_card",
    "read_demonstration",
    "records",
    "select",
    "write_card",
]
