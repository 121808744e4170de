"""Reading bags: whole ones, and what is left of damaged ones."""

from __future__ import annotations

import sqlite3
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.rosbag2 import Reader
from rosbags.serde import SerdeError

from iolspi_ros.bags.typestore import types
from iolspi_ros.errors import InputError
from iolspi_ros.task import plain

METADATA = "metadata.yaml"
LARGEST_CHUNK = 2**28
"""Bytes of a record, packed or not, at most."""


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
    if files[0].suffix != ".mcap" and path.is_dir() and (path / METADATA).is_file():
        whole = _whole(path)
        if whole is not None:
            yield from whole
            return
    for file in files:
        yield from (
            _read_mcap(file, damage) if file.suffix == ".mcap" else _recover_db3(file, damage)
        )


def _whole(path: Path) -> list[Record] | None:
    """All messages of a sqlite3 bag that was closed properly; None when it was not."""
    try:
        plain.read(path / METADATA, "a rosbag2 metadata file")  # within its limits
        with Reader(path) as reader:
            return [
                Record(connection.topic, connection.msgtype, time, bytes(data))
                for connection, time, data in reader.messages()
            ]
    except Exception:  # whatever a damaged bag raises there, what is readable is recovered
        return None


class _McapFile:
    """What was understood of an MCAP file so far."""

    def __init__(self) -> None:
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self.count = self.broken = 0
        self.promised: int | None = None
        self.closed = False

    def take(self, record: Any) -> Iterator[Record]:
        """The messages of a record, checked against its checksum when it has one."""
        if isinstance(record, Chunk):
            try:
                for inner in breakup_chunk(_unpacked(record)):
                    yield from self.take(inner)
            except Exception:  # struct, zstd and lz4 have errors of their own
                self.broken += 1
        elif isinstance(record, Schema):
            self._schemas[record.id] = record.name
        elif isinstance(record, Channel):
            self._channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in self._channels:
            channel = self._channels[record.channel_id]
            self.count += 1
            kind = self._schemas.get(channel.schema_id, "")
            yield Record(channel.topic, kind, record.log_time, record.data)
        elif isinstance(record, Statistics):
            self.promised = record.message_count
        elif isinstance(record, Footer):
            self.closed = True

    def notes(self) -> Iterator[str]:
        """What is missing, in words."""
        if self.broken:
            yield f"{self.broken} chunks are damaged: their checksum is another; they are left out"
        elif self.closed and self.promised is not None and self.promised != self.count:
            yield f"it has {self.count} of the {self.promised} messages that were written"


def _unpacked(chunk: Chunk) -> Chunk:
    """A chunk without compression, its checksum verified, within its limits."""
    if chunk.uncompressed_size > LARGEST_CHUNK:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    data = chunk.data
    if chunk.compression == "zstd":
        if zstandard.get_frame_parameters(data).content_size > LARGEST_CHUNK:
            raise ValueError("a chunk that is larger than it says")
        data = zstandard.decompress(data, chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(data, LARGEST_CHUNK)
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("another checksum")
    return replace(chunk, compression="", data=data)


def _read_mcap(path: Path, damage: Damage) -> Iterator[Record]:
    """Every message of a file up to where it ends or makes no sense."""
    found, size, good = _McapFile(), path.stat().st_size, 0
    with path.open("rb") as file:
        try:
            stream = StreamReader(file, emit_chunks=True, record_size_limit=LARGEST_CHUNK)
            for record in stream.records:
                good = file.tell()
                yield from found.take(record)
        except (McapError, EOFError, ValueError, OverflowError, MemoryError):
            pass
        except Exception as error:  # struct has errors of its own
            damage.notes.append(f"{path.name}: {type(error).__name__} while reading")
    damage.notes += [f"{path.name}: {note}" for note in found.notes()]
    if not found.closed:
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
