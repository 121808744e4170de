"""Bags of demonstrations: written so that a kill loses nothing, read as far as they go."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import yaml
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore

from iolspi_ros import wire
from iolspi_ros.core.samples import Sample, Transitions
from iolspi_ros.errors import InputError
from iolspi_ros.pairing import Pairer

CARD = "card.yaml"
_METADATA = "metadata.yaml"


class Record(NamedTuple):
    """One message of a bag, still serialised."""

    topic: str
    type: str
    time: int
    data: bytes


@cache
def _types() -> Any:
    return get_typestore(Stores.ROS2_JAZZY)


# ---------------------------------------------------------------- writing


class BagWriter:
    """Writes a rosbag2 directory with MCAP storage, each message on disk as soon as written.

    Parameters
    ----------
    path : Path
        Directory to make.

    Raises
    ------
    InputError
        When it exists already or cannot be made.
    """

    def __init__(self, path: Path) -> None:
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
        # Without chunks each record is complete in itself, whatever happens to the next.
        self._mcap = McapWriter(self._file, use_chunking=False)
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
            self._file.flush()
        except OSError as error:
            raise InputError(
                f"bag {self.path} cannot be written: {error.strerror}; "
                f"{sum(self._counts.values())} messages are kept; allowed: a disk with room"
            ) from error
        self._counts[topic] = count + 1
        self._span = [*self._span[:1], time] if self._span else [time, time]

    def _add_channel(self, topic: str, kind: str) -> None:
        definition, _ = _types().generate_msgdef(kind, ros_version=2)
        schema = self._mcap.register_schema(kind, "ros2msg", definition.encode())
        about = {"offered_qos_profiles": "", "topic_type_hash": _types().hash_rihs01(kind)}
        channel = self._mcap.register_channel(topic, "cdr", schema, about)
        self._channels[topic], self._counts[topic] = (channel, kind), 0

    def close(self) -> None:
        """Finish the file and write what `ros2 bag info` reads."""
        if self._closed:
            return
        self._closed = True
        self._mcap.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        (self.path / _METADATA).write_text(yaml.safe_dump(self._metadata(), sort_keys=False))

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
                    "type_description_hash": _types().hash_rihs01(kind),
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


def compact(path: Path) -> None:
    """Compress a closed bag in place; its other files, such as the card, stay."""
    packed = path.with_name(f".{path.name}.part")
    shutil.rmtree(packed, ignore_errors=True)
    writer = Writer(packed / path.name, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with Reader(path) as reader, writer:
        connections = {
            c.id: writer.add_connection(c.topic, c.msgtype, typestore=_types())
            for c in reader.connections
        }
        for connection, time, data in reader.messages():
            writer.write(connections[connection.id], time, data)
    for other in path.iterdir():
        if other.suffix != ".mcap" and other.name != _METADATA:
            shutil.copy2(other, packed / path.name / other.name)
    shutil.rmtree(path)
    (packed / path.name).rename(path)
    packed.rmdir()


def write_card(path: Path, card: dict[str, Any]) -> None:
    """Write who flew what, beside the messages."""
    (path / CARD).write_text(yaml.safe_dump(card, sort_keys=False, allow_unicode=True))


def read_card(path: Path) -> dict[str, Any]:
    """The card of a bag; empty when it has none.

    Raises
    ------
    InputError
        When there is one and it is no YAML mapping.
    """
    try:
        card = yaml.safe_load((path / CARD).read_text())
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        card = None
    if not isinstance(card, dict):
        raise InputError(f"{path / CARD} is not readable; allowed: a YAML mapping, or no card")
    return card


# ---------------------------------------------------------------- reading


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
    if path.is_dir() and (path / _METADATA).is_file():
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
        damage.notes.append(
            f"{path.name} was cut off: it was not closed, and its last {lost} of {size} bytes "
            "are no complete message"
        )


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
        damage.notes.append(f"{path.name} was not closed: it has no {_METADATA}")


@dataclass(frozen=True)
class Demonstration:
    """What a bag teaches.

    Attributes
    ----------
    path : Path
    samples : list of Sample
        Each (episode, step) once, in order.
    card : dict
        Who flew; empty when nobody said.
    notes : list of str
        What was lost, for a person.
    """

    path: Path
    samples: list[Sample]
    card: dict[str, Any]
    notes: list[str]

    def transitions(self, n_dims: int) -> Transitions:
        """The samples without their keys."""
        return Transitions.of([sample.transition for sample in self.samples], n_dims)


def read_demonstration(path: Path, task: str, joints: Sequence[str]) -> Demonstration:
    """Read the transitions of a bag.

    They are its `sample` messages; a bag without any is searched for `state` and `reward`, and
    transitions are formed from those. Topics are found by the last part of their name.

    Parameters
    ----------
    path : Path
    task : str
    joints : sequence of str
        The task that it must be of, and that task's joints.

    Raises
    ------
    InputError
        When the bag is missing, empty, of another task or has no readable transition.
    """
    card = read_card(path) if path.is_dir() else {}
    if card.get("task", task) != task:
        raise InputError(f"bag {path} is of task {card['task']!r}; allowed: {task!r}")
    damage = Damage()
    found = _Finder(joints)
    for record in records(path, damage):
        found.take(record)
    samples = found.samples()
    if not samples:
        why = "; ".join([*found.complaints, *damage.notes]) or "it holds " + found.topics()
        raise InputError(
            f"bag {path} has no transition of task {task!r}: {why}; allowed: messages on sample "
            f"({','.join(wire.sample_names(joints))}), or on state and reward"
        )
    gaps = _gaps(samples)
    notes = [*damage.notes, *found.complaints]
    if gaps:
        notes.append(f"{gaps} steps inside its episodes are missing")
    return Demonstration(path, samples, card, notes)


def numbered_through(demonstrations: Sequence[Demonstration]) -> list[Sample]:
    """Samples of several bags as one: no (episode, step) twice, stamps growing."""
    samples: list[Sample] = []
    for demonstration in demonstrations:
        first = demonstration.samples[0]
        episode, stamp = 0, 0
        if samples:
            episode = samples[-1].episode + 1 - first.episode
            stamp = samples[-1].stamp + 1 - first.stamp
        samples += [
            replace(sample, episode=sample.episode + episode, stamp=sample.stamp + stamp)
            for sample in demonstration.samples
        ]
    return samples


class _Finder:
    """Collects samples, and states and rewards in case there are none."""

    def __init__(self, joints: Sequence[str]) -> None:
        self._rows = wire.SampleRows(joints)
        self._pairer = Pairer(joints)
        self._sampled: dict[tuple[int, int], Sample] = {}
        self._paired: dict[tuple[int, int], Sample] = {}
        self._counts: dict[str, int] = {}
        self.complaints: list[str] = []

    def take(self, record: Record) -> None:
        topic = record.topic.rsplit("/", 1)[-1]
        self._counts[record.topic] = self._counts.get(record.topic, 0) + 1
        if topic not in ("sample", "state", "reward"):
            return
        try:
            message = _deserialise(record)
            if topic == "sample":
                self._take_sample(message)
            else:
                self._take_half(topic, message)
        except InputError as error:
            self._complain(str(error))
        except Exception as error:  # bytes that are no such message
            self._complain(f"a message on {record.topic} is unreadable ({type(error).__name__})")

    def _take_sample(self, message: Any) -> None:
        sample = self._rows.sample(message)
        self._sampled.setdefault((sample.episode, sample.step), sample)

    def _take_half(self, topic: str, message: Any) -> None:
        pair = self._pairer.state if topic == "state" else self._pairer.reward
        observation = pair(message)
        if observation is None:
            return
        for before, transition in self._pairer.transitions(observation):
            key = (before.episode, before.step)
            self._paired[key] = Sample(*key, before.stamp, transition, -1)

    def _complain(self, text: str) -> None:
        if len(self.complaints) < 3 and text not in self.complaints:
            self.complaints.append(text)

    def samples(self) -> list[Sample]:
        chosen = self._sampled or self._paired
        return [chosen[key] for key in sorted(chosen)]

    def topics(self) -> str:
        return ", ".join(f"{n} on {topic}" for topic, n in self._counts.items()) or "no message"


def _deserialise(record: Record) -> Any:
    """Message of a record; rmw_fastrtps may leave four bytes of padding behind it."""
    try:
        return _types().deserialize_cdr(record.data, record.type)
    except SerdeError:
        return _types().deserialize_cdr(record.data[:-4], record.type)


def _gaps(samples: list[Sample]) -> int:
    """Steps missing between the first and the last of each episode."""
    missing = 0
    for before, after in pairwise(samples):
        if before.episode == after.episode:
            missing += after.step - before.step - 1
    return missing
