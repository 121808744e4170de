"""Bags as others write them: joined, split, compressed, renamed, bare; made by plain writers."""

import shutil
import sqlite3
from dataclasses import replace

import numpy as np
import pytest
import yaml
from backports import zstd
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_typestore

from iolspi_ros import bags
from iolspi_ros.bags import Selection, select
from iolspi_ros.errors import InputError
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum.description
STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES = STORE.types
ROW, JOINTS = "std_msgs/msg/Float64MultiArray", "sensor_msgs/msg/JointState"
DT = 5_000_000


def row(**entries):
    label = ",".join(name.replace("__", ".") for name in entries)
    dimension = TYPES["std_msgs/msg/MultiArrayDimension"](label, len(entries), len(entries))
    layout = TYPES["std_msgs/msg/MultiArrayLayout"]([dimension], 0)
    return TYPES[ROW](layout, np.array(list(entries.values()), float))


def key(episode, step, stamp):
    sec, nanosec = divmod(stamp, 10**9)
    return {"episode": episode, "step": step, "sec": sec, "nanosec": nanosec}


def joints(stamp, names, positions, velocities):
    sec, nanosec = divmod(stamp, 10**9)
    header = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](sec, nanosec), "")
    return TYPES[JOINTS](
        header, list(names), np.array(positions, float), np.array(velocities, float), np.array([])
    )


def flight(seed, episodes=3, steps=10, start=0, prefix="", **names):
    """States and rewards as a recorder of a simulator has them: (topic, type, time, message)."""
    rng, stamp = np.random.default_rng(seed), start
    for episode in range(episodes):
        for step in range(steps + 1):
            stamp += DT
            angle, rate = rng.uniform(-3, 3), rng.uniform(-9, 9)
            yield names.get("state", f"{prefix}/state"), JOINTS, stamp, joints(
                stamp, ["shaft"], [angle], [rate])  # fmt: skip
            reward, action = (-seed - step / 100, rng.integers(3)) if step else (0.0, -1)
            yield f"{prefix}/reward", ROW, stamp, row(
                **key(episode, step, stamp), reward=reward, terminated=0,
                truncated=step == steps, action=action)  # fmt: skip


def samples(seed, count=30, episode=0):
    rng = np.random.default_rng(seed)
    for k in range(count):
        a, b, c, d = rng.uniform(-3, 3, 4)
        yield "/sample", ROW, k * DT, row(
            **key(episode, k, k * DT), shaft__position=a, shaft__velocity=b, action=k % 3,
            reward=-seed, next__shaft__position=c, next__shaft__velocity=d, terminated=0,
            truncated=0, source=4)  # fmt: skip


def write(path, messages, plugin=StoragePlugin.MCAP, compression=None, store=STORE):
    writer = Writer(path, version=9, storage_plugin=plugin)
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    connections = {}
    with writer:
        for topic, kind, time, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(connections[topic], time, store.serialize_cdr(message, kind))
    return path


def read(path, *args, **more):
    return bags.read_demonstration(path, TASK, select(*args, **more)).samples


def rewards(found):
    return {round(-s.transition.reward) for s in found}


# ---------------------------------------------------------------- vehicles and runs


def test_two_vehicles_are_refused_with_a_list_and_then_chosen(tmp_path):
    one, two = flight(1, prefix="/v1"), flight(2, episodes=2, prefix="/v2")
    path = write(tmp_path / "bag", [m for pair in zip(one, two, strict=False) for m in pair])
    with pytest.raises(InputError) as error:
        read(path)
    assert "vehicle /v1 run 1" in str(error.value)
    assert "vehicle /v2 run 1 (20 samples of 2 episodes)" in str(error.value)
    assert rewards(read(path, "/v2")) == {2}
    assert rewards(read(path, "v1")) == {1}
    with pytest.raises(InputError, match="has no vehicle /v3"):
        read(path, "/v3")


@pytest.mark.parametrize("make", [flight, samples])
def test_two_runs_joined_are_never_mixed(tmp_path, make):
    path = write(tmp_path / "bag", [*make(1), *make(2)])
    with pytest.raises(InputError) as error:
        read(path)
    assert "run 1 (30 samples" in str(error.value)
    assert "run 2 (30 samples" in str(error.value)
    assert rewards(read(path, run=1)) == {1}
    assert rewards(read(path, run=2)) == {2}
    assert len(read(path, run=2)) == 30
    bags.write_card(path, {"run": 2})
    assert rewards(read(path)) == {2}


def test_a_simulator_restarted_while_recording_makes_two_runs(tmp_path):
    first = [*flight(1)][:41]  # ended in the middle
    path = write(tmp_path / "bag", [*first, *flight(2)])
    assert rewards(read(path, run=2)) == {2}
    assert rewards(read(path, run=1)) == {1}


def test_a_restarted_vehicle_whose_clock_goes_on_makes_two_runs(tmp_path):
    path = write(tmp_path / "bag", [*flight(1), *flight(2, start=10**10)])
    assert len(read(path, run=1)) == len(read(path, run=2)) == 30
    assert rewards(read(path, run=2)) == {2}


def test_two_vehicles_on_the_same_topics_are_refused(tmp_path):
    both = [m for pair in zip(flight(1, 20), flight(2, 20), strict=True) for m in pair]
    path = write(tmp_path / "bag", both)
    with pytest.raises(InputError, match="several vehicles"):
        read(path)


def test_repeated_and_doubled_messages_are_one_run(tmp_path):
    messages = [m for m in flight(1) for _ in range(2)]
    path = write(tmp_path / "bag", [*messages, *flight(1)])
    assert len(read(path)) == 30


def test_a_bag_played_in_parts_out_of_order_is_one_run(tmp_path):
    whole = [*samples(1)]
    path = write(tmp_path / "bag", [*whole[:5], *whole[9:], *whole[5:9]])
    assert [s.step for s in read(path)] == list(range(30))


# ---------------------------------------------------------------- names


def test_topics_are_mapped_by_option_and_by_card(tmp_path):
    path = write(tmp_path / "bag", flight(1, state="/joint_states"))
    with pytest.raises(InputError, match="/joint_states"):
        read(path)
    assert len(read(path, topics=["state:=/joint_states"])) == 30
    bags.write_card(path, {"topics": {"state": "joint_states"}})
    assert len(read(path)) == 30


@pytest.mark.parametrize("bad", ["state", "state:=", "wheel:=/x"])
def test_a_topic_that_is_none_is_refused(bad):
    with pytest.raises(InputError, match="state"):
        select(topics=[bad])


def test_a_mapped_topic_is_that_of_the_vehicle_chosen(tmp_path):
    messages = [*flight(1, prefix="/v1", state="/joint_states"), *flight(2, prefix="/v2")]
    path = write(tmp_path / "bag", messages)
    found = read(path, "/v1", topics=["state:=/joint_states"])
    assert rewards(found) == {1}
    assert len(found) == 30


# ---------------------------------------------------------------- files


def test_split_bags_are_read_in_natural_order_each_with_its_own_run_of_times(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    messages = [*samples(1, 360)]
    for number in range(12):
        part = write(tmp_path / f"p{number}", messages[30 * number : 30 * (number + 1)])
        shutil.move(next(part.glob("*.mcap")), folder / f"bag_{number}.mcap")
    names = [file.name for file in bags.reader.bag_files(folder)]
    assert names == [f"bag_{number}.mcap" for number in range(12)]
    found = bags.read_demonstration(folder, TASK)
    assert [s.step for s in found.samples] == list(range(360))
    assert found.notes == []


def test_two_files_with_the_same_times_are_two_runs(tmp_path):
    path, other = write(tmp_path / "bag", samples(1)), write(tmp_path / "other", samples(2))
    shutil.copy(next(other.glob("*.mcap")), path / "bag_1.mcap")
    about = yaml.safe_load((path / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"]["relative_file_paths"].append("bag_1.mcap")
    (path / "metadata.yaml").write_text(yaml.safe_dump(about))
    with pytest.raises(InputError, match="run 2"):
        read(path)


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("compression", list(CompressionMode))
@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_compressed_by_message_chunk_or_file(tmp_path, plugin, compression, metadata):
    try:
        path = write(tmp_path / "bag", samples(1), plugin, compression)
    except Exception as error:  # what the writer itself refuses
        pytest.skip(str(error))
    if not metadata:
        (path / "metadata.yaml").unlink()
    assert len(read(path)) == 30


def test_a_file_compressed_as_rosbag2_does(tmp_path):
    for plugin, end in ((StoragePlugin.MCAP, "mcap"), (StoragePlugin.SQLITE3, "db3")):
        path = write(tmp_path / end, samples(1), plugin)
        file = next(path.glob(f"*.{end}"))
        packed = file.with_name(f"{file.name}.zstd")
        packed.write_bytes(zstd.compress(file.read_bytes()))
        file.unlink()
        assert len(read(path)) == 30
        assert len(read(packed)) == 30
        packed.write_bytes(packed.read_bytes()[:-50])
        damage = bags.Damage()
        list(bags.records(path, damage))
        assert damage.notes


def test_a_sqlite_bag_whose_messages_are_still_in_its_log(tmp_path):
    whole = write(tmp_path / "whole", samples(1), StoragePlugin.SQLITE3)
    path = tmp_path / "killed"
    path.mkdir()
    source = sqlite3.connect(next(whole.glob("*.db3")))
    target = sqlite3.connect(path / "killed_0.db3")
    source.backup(target)
    target.execute("DELETE FROM messages WHERE id > 10")
    target.commit()
    target.execute("PRAGMA journal_mode=WAL")
    target.execute("PRAGMA wal_autocheckpoint=0")
    rest = source.execute("SELECT * FROM messages WHERE id > 10").fetchall()
    marks = ",".join("?" * len(rest[0]))
    target.executemany(f"INSERT INTO messages VALUES ({marks})", rest)
    target.commit()
    copy = tmp_path / "copy"
    shutil.copytree(path, copy)  # as a kill leaves it: not closed
    assert (copy / "killed_0.db3-wal").stat().st_size
    assert len(read(copy)) == 30
    before = {p.name: p.read_bytes() for p in copy.iterdir()}
    read(copy)
    assert {p.name: p.read_bytes() for p in copy.iterdir()} == before  # nothing is touched
    source.close()
    target.close()


@pytest.mark.parametrize(
    ("change", "left", "says"),
    [
        ("UPDATE messages SET data = 'text' WHERE id = 3", 29, "1 of its messages are none"),
        ("UPDATE messages SET timestamp = 'soon' WHERE id < 3", 28, "2 of its messages are none"),
        ("UPDATE topics SET name = CAST(X'EB41' AS TEXT)", 0, ""),
        ("UPDATE topics SET type = X'FF'", 0, "are none"),
        ("ALTER TABLE messages RENAME TO other", 0, "is damaged: no such table: messages"),
    ],
)
def test_a_sqlite_bag_whose_columns_hold_something_else(tmp_path, change, left, says):
    path = write(tmp_path / "bag", samples(1), StoragePlugin.SQLITE3)
    with sqlite3.connect(next(path.glob("*.db3"))) as connection:
        connection.execute(change)
    connection.close()
    damage = bags.Damage()
    found = [record for record in bags.records(path, damage) if record.topic.endswith("sample")]
    assert len(found) == left
    assert says in " ".join(damage.notes)


# ---------------------------------------------------------------- what messages hold


def test_a_state_without_velocities_has_differences_in_their_place(tmp_path):
    def messages():
        for topic, kind, stamp, message in flight(1, episodes=1):
            if kind == JOINTS:
                angle = 3.1 + 0.01 * (stamp // DT)  # on and on, over the top
                angle = (angle + np.pi) % (2 * np.pi) - np.pi
                message = joints(stamp, ["shaft"], [angle], [])
            yield topic, kind, stamp, message

    found = bags.read_demonstration(write(tmp_path / "bag", messages()), TASK)
    assert len(found.samples) == 9  # the first state has no velocity
    assert [s.transition.state[1] for s in found.samples] == pytest.approx([2.0] * 9)
    assert "differences" in " ".join(found.notes)


def test_other_joints_and_another_order_are_no_matter(tmp_path):
    def messages():
        for topic, kind, stamp, message in flight(1):
            if kind == JOINTS:
                p, v = message.position[0], message.velocity[0]
                message = joints(stamp, ["wheel", "shaft", "arm"], [7, p, 8], [1, v, 2])
            yield topic, kind, stamp, message

    plain = read(write(tmp_path / "plain", flight(1)))
    found = read(write(tmp_path / "bag", messages()))
    for a, b in zip(plain, found, strict=True):
        np.testing.assert_array_equal(a.transition.state, b.transition.state)


@pytest.mark.parametrize("store", [Stores.ROS2_HUMBLE, Stores.ROS2_IRON])
def test_recordings_of_other_distributions_are_read(tmp_path, store):
    path = write(tmp_path / "bag", flight(1), store=get_typestore(store))
    assert len(read(path)) == 30


def test_a_bag_of_another_task_is_refused_and_another_vehicles_task_is_not_looked_at(tmp_path):
    from iolspi_ros.task import dump

    text = "std_msgs/msg/String"
    other = dump(replace(TASK, gamma=0.5))
    messages = [
        ("/v1/task", text, 0, TYPES[text](dump(TASK))), ("/v2/task", text, 0, TYPES[text](other)),
        *flight(1, prefix="/v1"), *flight(2, prefix="/v2"),
    ]  # fmt: skip
    path = write(tmp_path / "bag", messages)
    assert rewards(read(path, "/v1")) == {1}
    with pytest.raises(InputError, match="gamma"):
        read(path, "/v2")


def test_a_selection_that_cannot_be_is_refused():
    with pytest.raises(InputError):
        Selection(run=-1)
