import contextlib
import shutil
from dataclasses import replace

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from iolspi_ros import bags, wire
from iolspi_ros.bags.typestore import types
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.resources import find
from iolspi_ros.task import Variable
from sim_nodes.tasks.pendulum import Pendulum
from sim_nodes.tasks.slung_load import SlungLoad

TASK = Pendulum.description
ROWS = wire.SampleRows(TASK.names)
OTHER = replace(
    TASK, variables=tuple(map(Variable, ("x.position", "x.velocity", "y.position", "y.velocity")))
)
N = 40


def sample(k, episode=0):
    state, following = np.array([k, -k], float), np.array([k + 1, -k - 1], float)
    t = Transition(state, k % 3, -float(k), following, truncated=k == N - 1)
    return Sample(episode, k, k * 5_000_000, t, 4)


def kind(topic):
    return wire.states(TASK).kind if topic.endswith("state") else wire.ROW


def write(path, messages):
    writer = bags.BagWriter(path)
    for topic, stamp, message in messages:
        writer.write(topic, kind(topic), stamp, message)
    return writer


def samples(n=N):
    return [("sample", s.stamp, ROWS.of(s)) for s in map(sample, range(n))]


def read(path):
    return bags.read_demonstration(path, TASK)


def same(found, expected):
    assert [(s.episode, s.step, s.source) for s in found] == [
        (s.episode, s.step, s.source) for s in expected
    ]
    for a, b in zip(found, expected, strict=True):
        for x, y in zip(a.transition, b.transition, strict=True):
            np.testing.assert_array_equal(x, y)


def test_what_was_written_is_read_also_compressed(tmp_path):
    path = tmp_path / "bag"
    write(path, samples()).close()
    bags.write_card(path, {"task": "pendulum", "pilot": "me"})
    before = read(path)
    same(before.samples, [sample(k) for k in range(N)])
    assert before.notes == []
    bags.compact(path)
    same(read(path).samples, before.samples)
    assert read(path).card == {"task": "pendulum", "pilot": "me"}
    with Reader(path) as reader:  # a stranger's reader accepts it
        assert reader.message_count == N


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_bags_of_others_are_read_whatever_their_storage(tmp_path, plugin):
    writer = Writer(tmp_path / "bag", version=9, storage_plugin=plugin)
    with writer:
        kind = "std_msgs/msg/Float64MultiArray"
        connection = writer.add_connection("/a/sample", kind, typestore=types())
        for _, stamp, message in samples():
            writer.write(connection, stamp, message)
    same(read(tmp_path / "bag").samples, [sample(k) for k in range(N)])


def test_a_killed_writer_loses_nothing(tmp_path):
    path = tmp_path / "bag"
    writer = write(path, samples())  # neither closed nor finished
    found = read(path)
    same(found.samples, [sample(k) for k in range(N)])
    assert "was not closed" in found.notes[0]
    writer.close()


@pytest.mark.parametrize("share", [0.35, 0.8, 0.999])
def test_a_bag_cut_off_is_used_as_far_as_it_goes_and_says_how_much_is_gone(tmp_path, share):
    path = tmp_path / "bag"
    writer = write(path, samples())
    file = path / "bag_0.mcap"
    whole = file.read_bytes()
    file.write_bytes(whole[: int(len(whole) * share)])
    found = read(path)
    assert 0.2 * share * N < len(found.samples) <= N
    same(found.samples, [sample(k) for k in range(len(found.samples))])
    assert "was cut off" in found.notes[0]
    assert f"of {int(len(whole) * share)} bytes" in found.notes[0]
    writer.close()


def test_a_sqlite_bag_without_its_metadata_is_used(tmp_path):
    path = tmp_path / "bag"
    writer = Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    with writer:
        kind = "std_msgs/msg/Float64MultiArray"
        connection = writer.add_connection("sample", kind, typestore=types())
        for _, stamp, message in samples():
            writer.write(connection, stamp, message)
    (path / "metadata.yaml").unlink()
    found = read(path)
    same(found.samples, [sample(k) for k in range(N)])
    assert "was not closed" in found.notes[0]
    file = next(path.glob("*.db3"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(InputError, match=r"damaged|no transition"):
        read(path)


def test_states_and_rewards_do_where_there_are_no_samples(tmp_path):
    rewards, messages = wire.RewardRows(), []
    for k in range(N + 1):
        state = np.array([k, -k], float)
        o = Observation(0, k, state, 1.0 - k, (k - 1) % 3, truncated=k == N, stamp=k * 5_000_000)
        messages.append(("/sim/state", k, wire.states(TASK).of(o)))
        messages.append(("/sim/reward", k, rewards.of(o)))
    write(tmp_path / "bag", messages).close()
    found = read(tmp_path / "bag").samples
    assert [s.transition.action for s in found] == [k % 3 for k in range(N)]
    assert [s.transition.reward for s in found] == [-float(k) for k in range(N)]
    assert found[-1].transition.truncated


def test_gaps_are_counted(tmp_path):
    kept = [m for k, m in enumerate(samples()) if k not in (5, 6, 20)]
    write(tmp_path / "bag", kept).close()
    assert read(tmp_path / "bag").notes == ["3 steps inside its episodes are missing"]


def test_several_bags_become_one(tmp_path):
    for name in ("a", "b"):
        write(tmp_path / name, samples(10)).close()
    joined = bags.numbered_through([read(tmp_path / "a"), read(tmp_path / "b")])
    assert [(s.episode, s.step) for s in joined] == [(e, k) for e in (0, 1) for k in range(10)]
    stamps = [s.stamp for s in joined]
    assert stamps == sorted(set(stamps))


def test_bad_bags_get_a_clear_message(tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        read(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"holds no .mcap and no .db3"):
        read(tmp_path / "empty")
    write(tmp_path / "silent", []).close()
    with pytest.raises(InputError, match="no transition of task 'pendulum': it holds no message"):
        read(tmp_path / "silent")
    write(tmp_path / "other", samples()).close()
    bags.write_card(tmp_path / "other", {"task": "slung_load"})
    with pytest.raises(InputError, match="is of task 'slung_load'; allowed: 'pendulum'"):
        read(tmp_path / "other")
    write(tmp_path / "dims", samples()).close()
    with pytest.raises(InputError, match=r"no entry x\.position"):
        bags.read_demonstration(tmp_path / "dims", OTHER)
    (tmp_path / "dims" / "card.yaml").write_text("]:")
    with pytest.raises(InputError, match=r"card.yaml is not readable: .* is no YAML"):
        read(tmp_path / "dims")
    (tmp_path / "junk").mkdir()
    (tmp_path / "junk" / "junk.mcap").write_bytes(bytes(range(256)) * 40)
    with pytest.raises(InputError, match="cut off"):
        read(tmp_path / "junk")


def test_damaged_bytes_inside_are_no_crash(tmp_path):
    path = tmp_path / "bag"
    write(path, samples()).close()
    file = next(path.glob("*.mcap"))
    whole = bytearray(file.read_bytes())
    for place in range(len(whole) // 4, len(whole) - 100, 997):
        whole[place : place + 33] = b"X" * 33
    file.write_bytes(whole)
    with contextlib.suppress(InputError):  # a message, not a crash
        found = read(path)
        assert len(found.samples) <= N
        assert found.transitions().usable(3).shape == (len(found.samples),)


def test_a_bag_is_never_overwritten(tmp_path):
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="exists already"):
        bags.BagWriter(tmp_path / "bag")


@pytest.mark.parametrize("number", range(1, 6))
@pytest.mark.parametrize("task", [Pendulum(), SlungLoad()])
def test_the_shipped_sets_are_whole_and_say_who_flew(task, number):
    path = find("demos", task.description.name, f"set_{number}")
    found = bags.read_demonstration(path, task.description)
    flown = found.transitions()
    ends = flown.terminated | flown.truncated
    assert len(found.samples) == found.card["samples"]
    assert ends.sum() == len(task.initial_states())
    assert ends[-1]
    assert found.notes == []
    assert found.card["task"] == task.description.name
    assert found.card["reaction_delay"] >= 0.03
    assert found.card["hold_time"] >= 0.02
    assert "scripted pilot" in found.card["pilot"]
    assert "no person" in found.card["pilot"]
    wanted = {1: ("perform", 0.0), 2: ("explore", 0.0), 3: ("perform", 0.5),
              4: ("perform", 0.33), 5: ("explore", 0.33)}[number]  # fmt: skip
    assert (found.card["mode"], found.card["corruption"]) == wanted
    corrupted = np.mean([s.source == 3 for s in found.samples])
    assert abs(corrupted - wanted[1]) < 0.04


def test_a_copy_cut_off_of_a_shipped_set_is_used(tmp_path):
    path = tmp_path / "set"
    shutil.copytree(find("demos", "pendulum", "set_5"), path)
    file = next(path.glob("*.mcap"))
    file.write_bytes(file.read_bytes()[: int(file.stat().st_size * 0.7)])
    found = read(path)
    assert 1000 < len(found.samples) < 6300
    assert "was cut off" in found.notes[0]
