"""Reading bags: whole ones, and what is left of damaged ones."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader
from rosbags.serde import SerdeError

from iolspi_ros.bags.typestore import types
from iolspi_ros.bags.writer import METADATA
from iolspi_ros.errors import InputError


class Record(NamedTuple):
    """One message of a bag, still serialised."""

    topic: str
    type: str
    time: int
    data: bytes


@dataclass
class Damage:
    """What of a bag could not be read, in words; empty when all could."""

    notes: list[str] = field(default_factory=list)


def records(path: Path, damage: Damage) -> Iterator[Record]:
    """Every message of a bag that can be read, in the order of the file.

    Parameters
    ----------
    path : Path
        A rosbag2 directory, with MCAP or sqlite3 storage, or one such file.
    damage : Damage
        Filled with what could not be read.

    Raises
    ------
    InputError
        When there is no bag.
    """
    if not path.exists():
        raise InputError(f"bag {path} does not exist; allowed: a rosbag2 directory")
    files = [path] if path.is_file() else sorted([*path.glob("*.mcap"), *path.glob("*.db3*")])
    if not files:
        raise InputError(f"{path} holds no .mcap and no .db3 file; allowed: a rosbag2 directory")
    if path.is_dir() and (path / METADATA).is_file():
        whole = _whole(path)
        if whole is not None:
            yield from whole
            return
    for file in files:
        yield from (
            _recover_mcap(file, damage) if file.suffix == ".mcap" else _recover_db3(file, damage)
        )


def _whole(path: Path) -> list[Record] | None:
    """All messages of a bag that was closed properly; None when it was not."""
    try:
        with Reader(path) as reader:
            return [
                Record(connection.topic, connection.msgtype, time, bytes(data))
                for connection, time, data in reader.messages()
            ]
    except Exception:  # whatever a damaged bag raises there, what is readable is recovered
        return None


def _recover_mcap(path: Path, damage: Damage) -> Iterator[Record]:
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    size, good, closed = path.stat().st_size, 0, False
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, record_size_limit=2**28).records:
                good = file.tell()
                if isinstance(record, Schema):
                    schemas[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message) and record.channel_id in channels:
                    channel = channels[record.channel_id]
                    kind = schemas.get(channel.schema_id, "")
                    yield Record(channel.topic, kind, record.log_time, record.data)
            closed = True
        except (McapError, EOFError, ValueError, OverflowError, MemoryError):
            pass
        except Exception as error:  # struct, zstd and lz4 have errors of their own
            damage.notes.append(f"{path.name}: {type(error).__name__} while reading")
    if not closed:
        lost = size - good
        rest = f"its last {lost} of {size} bytes are no complete message"
        if not lost:
            rest = "all that is on disk is readable"
        damage.notes.append(f"{path.name} was cut off: it was not closed, and {rest}")


def _recover_db3(path: Path, damage: Damage) -> Iterator[Record]:
    query = (
        "SELECT topics.name, topics.type, messages.timestamp, messages.data FROM messages "
        "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.id"
    )
    try:
        connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        try:
            for row in connection.execute(query):
                yield Record(*row)
        finally:
            connection.close()
    except sqlite3.Error as error:
        damage.notes.append(f"{path.name} is damaged: {error}")
    else:
        damage.notes.append(f"{path.name} was not closed: it has no {METADATA}")


def deserialise(record: Record) -> Any:
    """Message of a record; rmw_fastrtps may leave four bytes of padding behind it."""
    try:
        return types().deserialize_cdr(record.data, record.type)
    except SerdeError:
        return types().deserialize_cdr(record.data[:-4], record.type)
