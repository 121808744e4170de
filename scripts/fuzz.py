#!/usr/bin/env python3
"""Let atheris look for bytes that do something else than being taken or refused with words.

Needs atheris (requirements/fuzz.in) beside the test requirements. Each reader has a process of its
own, which begins with good bytes and changes them where that reaches new lines of ours. What ends
it (an exception that is no InputError, five seconds, a gigabyte) is kept in --out.

    python scripts/fuzz.py [--minutes 5] [--out out/fuzz] [READER ...]
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

READERS = ("task", "parameters", "card", "row", "checkpoint", "message", "mcap", "db3", "mavlink")
KINDS = {
    "task": "std_msgs/msg/String",
    "sample": "std_msgs/msg/Float64MultiArray",
    "reward": "std_msgs/msg/Float64MultiArray",
    "state": "sensor_msgs/msg/JointState",
}
"""Messages of a bag that somebody reads."""
PATIENCE, MEMORY = 5, 1024
"""Seconds and MB that one input may take."""


def reader(name: str, place: Path) -> tuple[Callable[[bytes], None], list[bytes]]:
    """What takes the bytes, and good ones to begin with."""
    import numpy as np

    from iolspi_ros import arguments, bags, resources, task, wire
    from iolspi_ros.bags import survey
    from iolspi_ros.bags.reader import deserialise
    from iolspi_ros.core.learner import learner_class
    from iolspi_ros.errors import InputError
    from iolspi_ros.saving import checkpoint
    from msg_bridge.mavlink.codec import Codec
    from msg_bridge.mavlink.telemetry import Telemetry
    from sim_nodes.tasks.pendulum import Pendulum

    about = Pendulum.description
    shipped = resources.find("demos", "pendulum", "set_1")

    def file(read: Callable[[Path], object], called: str) -> Callable[[bytes], None]:
        def take(data: bytes) -> None:
            path = place / called
            path.write_bytes(data)
            with contextlib.suppress(InputError):
                read(path)

        return take

    if name == "task":

        def take(data: bytes) -> None:
            with contextlib.suppress(InputError):
                task.load(data.decode("utf-8", "replace"), "here")

        return take, [task.dump(about).encode()]
    if name == "parameters":
        config = resources.find("config", "pendulum.yaml").read_bytes()
        return file(arguments.read_sections, "p.yaml"), [config]
    if name == "card":
        return file(lambda path: bags.read_card(path.parent), bags.CARD), [
            (shipped / bags.CARD).read_bytes()
        ]
    if name == "row":
        rows = wire.SampleRows(about.names)
        good = [r for r in bags.records(shipped, bags.Damage()) if r.topic == "sample"][:2]

        def take(data: bytes) -> None:
            with contextlib.suppress(InputError):
                rows.sample(deserialise(good[0]._replace(data=data)))

        return take, [record.data for record in good]
    if name == "checkpoint":
        cls = learner_class("iolspi")
        settings = cls.Settings(centers=(3, 3))
        made = cls(about, settings, np.random.default_rng(0))
        checkpoint.save(place / "good.npz", made, "iolspi")
        good = (place / "good.npz").read_bytes()

        def read(path: Path) -> None:
            with path.open("r+b") as sealed:  # as if somebody had made it so on purpose
                end = max(sealed.seek(0, 2) - 71, 0)
                digest = checkpoint._digest(sealed, end)
                sealed.seek(end)
                sealed.write(digest)
            checkpoint.restore(checkpoint.read(path), made, "iolspi", "here")

        return file(read, "c.npz"), [good]
    if name == "message":  # of a whole bag, with a right checksum
        records = list(itertools.islice(bags.records(shipped, bags.Damage()), 3))
        flown = [r._replace(topic=t, type=k) for r in records for t, k in KINDS.items()]

        def take(data: bytes) -> None:
            folder = place / "bag"
            shutil.rmtree(folder, ignore_errors=True)
            with bags.BagWriter(folder) as writer:
                for record in flown:
                    writer.write(record.topic, record.type, record.time, record.data)
                for topic, kind in KINDS.items():
                    writer.write(topic, kind, 1, data)
            with contextlib.suppress(InputError):
                bags.read_demonstration(folder, about)
            survey.contents(folder)

        return take, [record.data for record in records]
    if name in ("mcap", "db3"):
        folder = place / "bag"
        folder.mkdir()

        def take(data: bytes) -> None:
            (folder / f"bag.{name}").write_bytes(data)
            with contextlib.suppress(InputError):
                bags.read_demonstration(folder, about)

        return take, [small_bag(place / "small", shipped, name)]
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    sender = Codec(1, 1)
    packets = [
        dialect.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3),
        dialect.MAVLink_local_position_ned_message(1, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
        dialect.MAVLink_param_value_message(b"RATE", 1.0, 9, 1, 0),
    ]

    def hear(data: bytes) -> None:
        codec, seen = Codec(255, 190), Telemetry(1, 2)
        for k in range(0, len(data), 280):
            for message in codec.read(data[k : k + 280], whole=True):
                seen.take(message, 1.0)
        assert np.isfinite(seen.acceleration).all()

    return hear, [sender.pack(message) for message in packets]


def small_bag(place: Path, shipped: Path, kind: str) -> bytes:
    """The file of a bag with a few of another one's messages, written by rosbags."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    from iolspi_ros import bags

    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer(place, version=9, storage_plugin=plugin) as writer:
        store, topics = get_typestore(Stores.ROS2_JAZZY), {}
        for record in itertools.islice(bags.records(shipped, bags.Damage()), 20):
            if record.topic not in topics:
                topics[record.topic] = writer.add_connection(
                    record.topic, record.type, typestore=store
                )
            writer.write(topics[record.topic], record.time, record.data)
    return next(place.glob(f"*.{kind}")).read_bytes()


def run_one(name: str, seconds: int, out: Path) -> None:
    """Fuzz one reader in this process; libFuzzer ends it."""
    import atheris

    with atheris.instrument_imports(include=["iolspi_ros", "msg_bridge", "sim_nodes"]):
        place = Path(tempfile.mkdtemp(prefix="iolspi-fuzz-"))
        take, good = reader(name, place)
    corpus = place / "corpus"
    corpus.mkdir()
    for n, data in enumerate(good):
        (corpus / str(n)).write_bytes(data)
    size = max(4096, 2 * max(map(len, good)))
    atheris.Setup(
        [sys.argv[0], str(corpus), f"-max_total_time={seconds}", f"-timeout={PATIENCE}",
         f"-rss_limit_mb={MEMORY}", f"-max_len={size}", "-print_final_stats=1",
         f"-artifact_prefix={out}/{name}-", "-verbosity=1"],
        take,
    )  # fmt: skip
    atheris.Fuzz()


def main() -> int:
    """Fuzz the readers, one after the other, and print a table of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("readers", nargs="*", metavar="READER", choices=[[], *READERS])
    parser.add_argument("--minutes", type=float, default=5.0, help="for each reader")
    parser.add_argument("--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--here", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    chosen.out.mkdir(parents=True, exist_ok=True)
    seconds = max(round(60 * chosen.minutes), 1)
    if chosen.here:
        run_one(chosen.readers[0], seconds, chosen.out)
    failed = 0
    for name in chosen.readers or READERS:
        command = [sys.executable, __file__, name, "--here", f"--minutes={chosen.minutes}"]
        begin = time.monotonic()
        done = subprocess.run(
            [*command, f"--out={chosen.out}"], capture_output=True, text=True, check=False
        )
        (chosen.out / f"{name}.log").write_text(done.stdout + done.stderr)
        units = re.search(r"number_of_executed_units: (\d+)", done.stderr)
        edges = re.findall(r"cov: (\d+)", done.stderr)
        said = "nothing found" if done.returncode == 0 else f"FOUND: see {chosen.out}/{name}.log"
        failed += done.returncode != 0
        print(
            f"{name:12} {int(units[1]) if units else 0:9} inputs, {(edges or ['0'])[-1]:>6} edges, "
            f"{(time.monotonic() - begin) / 60:.1f} min: {said}",
            flush=True,
        )
    return min(failed, 1)


if __name__ == "__main__":
    sys.exit(main())
