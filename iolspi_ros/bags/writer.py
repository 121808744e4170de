"""Writing bags: each message is on disk as soon as it is written."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

import yaml
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from iolspi_ros.bags.reader import METADATA, Damage, Record, deserialise, records
from iolspi_ros.bags.typestore import types
from iolspi_ros.errors import InputError

PACKED = 2**18
"""Bytes of a chunk of a packed bag."""


class BagWriter:
    """Writes a rosbag2 directory with MCAP storage, each message on disk as soon as written.

    Parameters
    ----------
    path : Path
        Directory to make.
    packed : bool
        Compress many messages together; a kill then loses those of the last chunk.

    Raises
    ------
    InputError
        When it exists already or cannot be made.
    """

    def __init__(self, path: Path, *, packed: bool = False) -> None:
        self.path = path
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            raise InputError(
                f"bag {path} exists already; allowed: a folder that is not there yet"
            ) from None
        except OSError as error:
            raise InputError(
                f"bag {path} cannot be made: {error.strerror}; allowed: a place you may write to"
            ) from error
        self._file = (path / f"{path.name}_0.mcap").open("wb")
        # A chunk for each message, unless they are packed: complete in itself, with a checksum.
        self._packed = packed
        self._mcap = McapWriter(
            self._file, chunk_size=PACKED if packed else 1,
            compression=CompressionType.ZSTD if packed else CompressionType.NONE,
        )  # fmt: skip
        self._mcap.start(profile="ros2", library="iolspi_ros")
        self._channels: dict[str, tuple[int, str]] = {}
        self._counts: dict[str, int] = {}
        self._span: list[int] = []
        self._closed = False

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def write(self, topic: str, kind: str, time: int, data: bytes) -> None:
        """Add one serialised message.

        Parameters
        ----------
        topic : str
        kind : str
            Type, as "std_msgs/msg/Float64MultiArray".
        time : int
            Vehicle time [ns]; one before that of the last message is moved up to it, since
            readers want the times of a file in order.
        data : bytes
            CDR, as rclpy's `serialize_message` gives it.

        Raises
        ------
        InputError
            When the disk takes no more; what was written before stays readable.
        """
        if self._closed:
            return
        time = max(time, *self._span, 0)
        try:
            if topic not in self._channels:
                self._add_channel(topic, kind)
            count = self._counts[topic]
            channel = self._channels[topic][0]
            self._mcap.add_message(channel, time, data, time, sequence=count)
            if not self._packed:
                self._file.flush()
        except OSError as error:
            raise InputError(
                f"bag {self.path} cannot be written: {error.strerror}; "
                f"{sum(self._counts.values())} messages are kept; allowed: a disk with room"
            ) from error
        self._counts[topic] = count + 1
        self._span = [*self._span[:1], time] if self._span else [time, time]

    def _add_channel(self, topic: str, kind: str) -> None:
        definition, _ = types().generate_msgdef(kind, ros_version=2)
        schema = self._mcap.register_schema(kind, "ros2msg", definition.encode())
        about = {"offered_qos_profiles": "", "topic_type_hash": types().hash_rihs01(kind)}
        channel = self._mcap.register_channel(topic, "cdr", schema, about)
        self._channels[topic], self._counts[topic] = (channel, kind), 0

    def close(self) -> None:
        """Finish the file and write what `ros2 bag info` reads."""
        if self._closed:
            return
        self._closed = True
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        (self.path / METADATA).write_text(yaml.safe_dump(self._metadata(), sort_keys=False))

    def _metadata(self) -> dict[str, Any]:
        begin, end = self._span or (0, 0)
        total = sum(self._counts.values())
        start, duration = {"nanoseconds_since_epoch": begin}, {"nanoseconds": end - begin}
        name = f"{self.path.name}_0.mcap"
        topics = [
            {
                "topic_metadata": {
                    "name": topic,
                    "type": kind,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": [],
                    "type_description_hash": types().hash_rihs01(kind),
                },
                "message_count": self._counts[topic],
            }
            for topic, (_, kind) in self._channels.items()
        ]
        file = {"path": name, "starting_time": start, "duration": duration, "message_count": total}
        return {
            "rosbag2_bagfile_information": {
                "version": 9,
                "storage_identifier": "mcap",
                "duration": duration,
                "starting_time": start,
                "message_count": total,
                "topics_with_message_count": topics,
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [name],
                "files": [file],
                "custom_data": None,
                "ros_distro": "jazzy",
            }
        }


def check_place(path: Path) -> None:
    """See that a bag can be made at a path, without making it.

    Raises
    ------
    InputError
        When it exists already, or nothing can be made there.
    """
    if path.exists():
        raise InputError(f"bag {path} exists already; allowed: a folder that is not there yet")
    parent = next(folder for folder in path.absolute().parents if folder.exists())
    if not (parent.is_dir() and os.access(parent, os.W_OK | os.X_OK)):
        raise InputError(
            f"bag {path} cannot be made in {parent}; allowed: a place you may write to"
        )


def compact(path: Path) -> None:
    """Compress a closed bag in place; its other files, such as the card, stay.

    Messages are written anew as their types say, without what a transport left behind them.
    """
    work = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
    try:
        with BagWriter(work / path.name, packed=True) as writer:
            for record in _whole_bag(path):
                data = bytes(types().serialize_cdr(deserialise(record), record.type))
                writer.write(record.topic, record.type, record.time, data)
        for other in path.iterdir():
            if other.suffix != ".mcap" and other.name != METADATA:
                shutil.copy2(other, writer.path / other.name)
        path.rename(work / "before")
        writer.path.rename(path)
    finally:
        shutil.rmtree(work)


def _whole_bag(path: Path) -> Iterator[Record]:
    damage = Damage()
    yield from records(path, damage)
    if damage.notes:
        raise InputError(f"bag {path}: {'; '.join(damage.notes)}; allowed: a whole bag")
