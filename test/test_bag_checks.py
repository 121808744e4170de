"""Bags whose every message has a checksum, and which every reader takes."""

import random
import shutil
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from iolspi_ros import bags, wire
from iolspi_ros.bags import BagWriter, Damage
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.resources import find
from sim_nodes.tasks.pendulum import Pendulum

TASK = Pendulum.description
SHIPPED = sorted(find("demos").glob("*/set_*"))


def write(path, count=200, **more):
    rows, states, rewards = wire.SampleRows(TASK.names), wire.states(TASK), wire.RewardRows()
    path_of = np.random.default_rng(0).uniform(-1, 1, (count + 1, 2))
    with BagWriter(path, **more) as bag:
        for k in range(count):
            state, after = path_of[k : k + 2]
            sample = Sample(0, k, k, Transition(state, 1, -0.5, after), 4)
            seen = Observation(0, k, state, -0.5, 1, stamp=k)
            bag.write("sample", wire.ROW, k, rows.of(sample))
            bag.write("state", states.kind, k, states.of(seen))
            bag.write("reward", wire.ROW, k, rewards.of(seen))


def numbers(path):
    found = bags.read_demonstration(path, TASK)
    values = {s.step: (*s.transition.state, *s.transition.next_state) for s in found.samples}
    return values, found.notes


@pytest.mark.parametrize("packed", [False, True])
def test_a_flipped_bit_is_said_or_changes_nothing(tmp_path, packed):
    write(tmp_path / "bag", packed=packed)
    whole, _ = numbers(tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    data, rng, said = file.read_bytes(), random.Random(0), 0
    for _ in range(150):
        harmed = bytearray(data)
        harmed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        file.write_bytes(harmed)
        try:
            values, notes = numbers(tmp_path / "bag")
        except InputError:
            said += 1
            continue
        assert values.items() <= whole.items()  # never another number
        assert notes or values == whole
        said += bool(notes)
    assert said > 50


def test_one_damaged_message_costs_that_message_alone(tmp_path):
    write(tmp_path / "bag")
    whole, _ = numbers(tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.mcap")
    data = bytearray(file.read_bytes())
    place = data.find(np.float64(whole[100][0]).tobytes())
    data[place] ^= 1
    file.write_bytes(data)
    values, notes = numbers(tmp_path / "bag")
    assert len(values) == len(whole) - 1
    assert any("1 chunks are damaged" in note for note in notes)


def test_what_was_written_before_a_kill_is_there(tmp_path):
    writer = BagWriter(tmp_path / "bag")
    rows = wire.SampleRows(TASK.names)
    for k in range(50):
        t = Transition(np.zeros(2), 1, 0.0, np.zeros(2))
        writer.write("sample", wire.ROW, k, rows.of(Sample(0, k, k, t, 4)))
    shutil.copytree(tmp_path / "bag", tmp_path / "killed")  # as the disk is at that moment
    writer.close()
    values, notes = numbers(tmp_path / "killed")
    assert len(values) == 50
    assert any("all that is on disk is readable" in note for note in notes)


def messages(path):
    with AnyReader([path]) as reader:
        return sum(1 for c, _, raw in reader.messages() if reader.deserialize(raw, c.msgtype))


@pytest.mark.parametrize("compact", [False, True])
def test_every_reader_takes_a_new_bag(tmp_path, compact):
    write(tmp_path / "bag")
    if compact:
        before = numbers(tmp_path / "bag")
        bags.compact(tmp_path / "bag")
        assert numbers(tmp_path / "bag") == before
    assert messages(tmp_path / "bag") == 600
    assert sorted(tmp_path.iterdir()) == [tmp_path / "bag"]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_every_reader_takes_the_shipped_sets(path):
    damage = Damage()
    assert messages(path) == sum(1 for _ in bags.records(path, damage))
    assert not damage.notes


@pytest.mark.parametrize("size", [2**40, 2**28 + 1])
def test_a_chunk_that_unpacks_to_too_much_is_left_out(tmp_path, size):
    write(tmp_path / "bag", packed=True)
    (file,) = (tmp_path / "bag").glob("*.mcap")
    data = bytearray(file.read_bytes())
    chunk = data.index(b"\x04\x00\x00\x00zstd") - 12  # uncompressed size and checksum before it
    data[chunk : chunk + 8] = size.to_bytes(8, "little")
    file.write_bytes(data)
    with pytest.raises(InputError, match="chunks are damaged"):
        numbers(tmp_path / "bag")


@pytest.mark.parametrize(
    "card",
    [
        "a: &a [1]\nb: *a", "[" * 20_000, "{" * 20_000, "a: " + "[" * 25 + "]" * 25,
        "a: " + "x" * 2**17, '{"a": ' + "[" * 50 + "]" * 50 + "}", "a: !!python/name:print",
        "\xff", "? [", "a: 9" + "9" * 5000,
    ],
)  # fmt: skip
def test_a_card_within_no_limits_is_refused_at_once(tmp_path, card):
    (tmp_path / bags.CARD).write_text(card, encoding="latin-1")
    with pytest.raises(InputError, match="is not readable"):
        bags.read_card(tmp_path)
    assert bags.read_card(Path(tmp_path / "nowhere")) == {}
