"""Reading bags: whole ones, and what is left of damaged ones."""

from __future__ import annotations

import re
import shutil
import sqlite3
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import zstandard
from backports import zstd  # rosbags needs it too
from mcap.records import Channel, Chunk, Footer, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from rosbags.serde import SerdeError

from iolspi_ros.bags.typestore import types
from iolspi_ros.errors import InputError

METADATA = "metadata.yaml"
LARGEST_CHUNK = 2**28
"""Bytes of a record, packed or not, at most."""

ZSTD = ".zstd"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


TEXT = "std_msgs/msg/String"
"""Type of a task's messages."""


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
    """Every message of a bag that can be read, file after file, in the order of each.

    Parameters
    ----------
    path : Path
        A rosbag2 directory, with MCAP or sqlite3 storage, or one such file; compressed or not.
    damage : Damage
        Filled with what could not be read.

    Raises
    ------
    InputError
        When there is no bag.
    """
    if not path.exists():
        raise InputError(f"bag {path} does not exist; allowed: a rosbag2 directory")
    files = [path] if path.is_file() else bag_files(path)
    if not files:
        raise InputError(f"{path} holds no .mcap and no .db3 file; allowed: a rosbag2 directory")
    for file in files:
        with _uncompressed(file, damage) as whole:
            if whole.suffix == ".mcap":
                yield from _read_mcap(whole, file.name, damage)
            else:
                yield from _read_db3(whole, file, damage)


def bag_files(folder: Path) -> list[Path]:
    """Files of a bag in their natural order: 2 comes before 10."""
    kinds = (".mcap", ".db3", *(f"{kind}{ZSTD}" for kind in (".mcap", ".db3")))
    found = [path for path in folder.iterdir() if path.name.endswith(kinds)]
    plain = {path.name for path in found}
    return sorted(
        (path for path in found if path.name.removesuffix(ZSTD) not in plain - {path.name}),
        key=_natural,
    )


def _natural(path: Path) -> list[tuple[int, str]]:
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


@contextmanager
def _uncompressed(path: Path, damage: Damage) -> Iterator[Path]:
    """A file as it was before it was compressed, as far as it can be had; sqlite's with its log."""
    beside = path.with_name(f"{path.name}-wal")
    if path.suffix != ZSTD and not beside.is_file():
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="iolspi-bag-") as folder:
        plain = Path(folder, path.name.removesuffix(ZSTD))
        if path.suffix != ZSTD:  # what is not yet in the file itself is in its log
            shutil.copy(path, plain)
            shutil.copy(beside, plain.with_name(f"{plain.name}-wal"))
        else:
            _decompress(path, plain, damage)
        yield plain


def _decompress(path: Path, plain: Path, damage: Damage) -> None:
    with plain.open("wb") as out:
        try:
            with zstd.open(path, "rb") as compressed:
                while part := compressed.read(2**20):
                    out.write(part)
        except (zstd.ZstdError, EOFError, OSError) as error:
            damage.notes.append(f"{path.name} is damaged: {error}")


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
            yield Record(channel.topic, kind, record.log_time, _message(record.data))
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


def _read_mcap(path: Path, name: str, damage: Damage) -> Iterator[Record]:
    """Every message of a file up to where it ends or makes no sense."""
    found, size, good = _McapFile(), path.stat().st_size, 0
    with path.open("rb") as file:
        try:
            stream = StreamReader(file, emit_chunks=True, record_size_limit=LARGEST_CHUNK)
            for record in stream.records:
                good = file.tell()
                yield from found.take(record)
        except Exception:  # of mcap, struct and others, wherever it was cut: said below
            pass
    damage.notes += [f"{name}: {note}" for note in found.notes()]
    if not found.closed:
        lost = size - good
        rest = f"its last {lost} of {size} bytes are no complete message"
        if not lost:
            rest = "all that is on disk is readable"
        damage.notes.append(f"{name} was cut off: it was not closed, and {rest}")


def _read_db3(path: Path, origin: Path, damage: Damage) -> Iterator[Record]:
    query = (
        "SELECT topics.name, topics.type, messages.timestamp, messages.data FROM messages "
        "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.id"
    )
    mode = "ro" if path == origin else "rw"  # a copy of ours: its log is to be taken in
    broken = 0
    try:
        connection = sqlite3.connect(f"file:{path}?mode={mode}", uri=True)
        connection.text_factory = lambda text: text.decode("utf-8", "replace")
        try:
            for topic, kind, time, data in connection.execute(query):
                if [type(v) for v in (topic, kind, time, data)] == [str, str, int, bytes]:
                    yield Record(topic, kind, time, _message(data))
                else:  # a column of SQLite may hold anything
                    broken += 1
        finally:
            connection.close()
    except (sqlite3.Error, UnicodeDecodeError) as error:  # also of what SQLite says itself
        damage.notes.append(f"{origin.name} is damaged: {error}")
    else:
        if not (origin.parent / METADATA).is_file():
            damage.notes.append(f"{origin.name} was not closed: it has no {METADATA}")
    if broken:
        damage.notes.append(f"{origin.name} is damaged: {broken} of its messages are none")


def _message(data: bytes) -> bytes:
    """A message as it was before it was compressed by itself, if it was."""
    if not data.startswith(_ZSTD_MAGIC):
        return data
    try:
        return zstd.decompress(data)
    except zstd.ZstdError:
        return data  # nobody can read it, and who reads it says so


def deserialise(record: Record) -> Any:
    """Message of a record; rmw_fastrtps may leave four bytes of padding behind it.

    Raises
    ------
    InputError
        When the bytes are no such message.
    """
    try:
        try:
            return types().deserialize_cdr(record.data, record.type)
        except SerdeError:
            return types().deserialize_cdr(record.data[:-4], record.type)
    except Exception as error:  # whatever a reader of bytes stumbles over
        raise InputError(
            f"a message on {record.topic} is unreadable: {len(record.data)} bytes are no "
            f"{record.type} ({type(error).__name__})"
        ) from error
