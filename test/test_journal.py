"""What a learner observes between two checkpoints: on disk at once, learned anew after a kill."""

import random
import signal
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from iolspi_ros.core.samples import Observation
from iolspi_ros.nodes import journal
from iolspi_ros.nodes.journal import NOTHING, Journal, Mark
from iolspi_ros.saving import checkpoint

WHOLE = st.integers(-(2**63), 2**63 - 1)
NUMBER = st.floats(allow_nan=True, allow_infinity=True)
OBSERVATIONS = st.lists(
    st.builds(
        Observation, WHOLE, WHOLE, arrays(float, 3, elements=NUMBER), NUMBER, WHOLE, st.booleans(),
        st.booleans(), WHOLE, WHOLE,
    ),
    max_size=8,
)  # fmt: skip


def seen(step):
    return Observation(0, step, np.array([0.1 * step, 1.0, -2.0]), -1.0, 1, stamp=step, source=2)


@given(OBSERVATIONS, st.integers(0, 500))
def test_what_was_noted_is_read_up_to_where_it_was_cut(tmp_path_factory, noted, cut):
    path = tmp_path_factory.mktemp("journal") / "policy.npz"
    written = Journal(path, 3, print)
    written.begin("a", Mark(7, 1, 2), saved=False)
    for observation in noted:
        written.note(observation)
    written.close(needed=True)
    (file,) = path.parent.iterdir()
    np.testing.assert_equal(journal.read(path, "a", Mark(7, 1, 2), 3), noted)
    content = file.read_bytes()
    file.write_bytes(content[: max(len(content) - cut, 20)])
    left = journal.read(path, "a", Mark(7, 1, 2), 3)
    np.testing.assert_equal(left, noted[: len(left)])
    size = 5 * 8 + 2 + 4 * 8 + 4  # of one
    assert len(left) == max(size * len(noted) - cut, 0) // size


def test_it_begins_at_its_checkpoint_and_goes_on_through_those_that_failed(tmp_path):
    path, kept = tmp_path / "policy.npz", Journal(tmp_path / "policy.npz", 3, print)
    for k in range(12):  # ten files: their order is that of numbers, not of names
        kept.begin("a", Mark(10 * k, 0, k), saved=False)
        kept.note(seen(k))
    Journal(path, 3, print).begin("b", Mark(20, 0, 2), saved=True)  # another series
    for begun in (0, 2, 11):
        found = journal.read(path, "a", Mark(10 * begun, 0, begun), 3)
        assert [o.step for o in found] == list(range(begun, 12))
    assert journal.read(path, "a", Mark(5, 0, 5), 3) == []
    kept.begin("a", Mark(20, 0, 2), saved=False)  # gone back to by hand
    kept.note(seen(99))
    assert [o.step for o in journal.read(path, "a", Mark(20, 0, 2), 3)] == [99]
    kept.begin("a", Mark(500, 3, 3), saved=True)  # what is needed for two checkpoints, and that
    assert len(list(tmp_path.glob(".policy.npz.a.*"))) == journal.KEPT + 1
    kept.close(needed=False)
    assert [file.name.split(".")[3] for file in tmp_path.iterdir()] == ["b"]


@pytest.mark.parametrize("name", ["policy[1].npz", "po*licy?.npz"])
def test_a_name_is_no_pattern(tmp_path, name):
    path = tmp_path / name
    kept = Journal(path, 3, print)
    kept.begin("a", NOTHING, saved=False)
    kept.note(seen(1))
    kept.close(needed=True)
    assert [o.step for o in journal.read(path, "a", NOTHING, 3)] == [1]
    assert journal.begun_from_nothing(path) == "a"


def test_a_damaged_record_ends_its_file_and_what_is_no_journal_is_none(tmp_path):
    path = tmp_path / "policy.npz"
    kept = Journal(path, 3, print)
    kept.begin("a", NOTHING, saved=False)
    for k in range(5):
        kept.note(seen(k))
    kept.close(needed=True)
    (file,) = tmp_path.iterdir()
    content = bytearray(file.read_bytes())
    content[-100] ^= 1  # in the last but one
    file.write_bytes(content)
    assert [o.step for o in journal.read(path, "a", NOTHING, 3)] == [0, 1, 2]
    assert journal.begun_from_nothing(path) == "a"
    for text in (b"", b"\n", b"[" * 9000, b'{"a": 1}\n', b'["a", 1, 2]\n', b"\xff\xfe\n"):
        file.write_bytes(text)
        assert journal.read(path, "a", NOTHING, 3) == []
        assert journal.begun_from_nothing(path) == ""


def test_a_full_disk_is_said_once_and_ends_nothing(tmp_path, monkeypatch):
    said = []
    kept = Journal(tmp_path / "policy.npz", 3, said.append)
    kept.begin("a", NOTHING, saved=False)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(journal.os, "write", full)
    for k in range(3):
        kept.note(seen(k))
    kept.begin("a", Mark(1, 1, 1), saved=False)
    kept.note(seen(4))
    assert said == ["what comes after a checkpoint is not written down: No space left on device"]


def parameters(path, *more):
    return [
        "-p", f"checkpoint:={path}", "-p", "resume:=true", "-p", "wait_for_demonstrations:=false",
        "-p", "update_interval:=200", "-p", "checkpoint_updates:=3", "-p", "seed:=5", *more,
    ]  # fmt: skip


def fly(nodes, path, kills):
    """A learner and its simulator; the learner is killed so many times."""
    rng, name = random.Random(2), path.stem
    nodes.start("simulator", "-p", "episodes:=12", "-p", "seed:=5", "-p", "resend_after:=0.02",
                name=f"{name} simulator")  # fmt: skip
    for life in range(kills + 1):
        nodes.start("learner", *parameters(path), name=f"{name} learner {life}")
        if life < kills:
            nodes.wait_for(f"{name} learner {life}", "acting on")
            time.sleep(
                rng.uniform(0.0, 0.5)
            )  # a random moment, the first ones before any checkpoint
            assert nodes.end(f"{name} learner {life}", signal.SIGKILL) == -signal.SIGKILL
    nodes.wait_for(f"{name} simulator", "done:")
    assert nodes.end(f"{name} learner {kills}", signal.SIGTERM) == 0
    nodes.end(f"{name} simulator")
    return checkpoint.read(path)


@pytest.mark.slow
def test_a_learner_that_is_killed_again_and_again_learns_what_it_would_have_learned(
    nodes, tmp_path
):
    alone, killed = (fly(nodes, tmp_path / f"{n}.npz", n) for n in (0, 4))
    assert alone.arrays.keys() == killed.arrays.keys()
    for name, array in alone.arrays.items():
        np.testing.assert_array_equal(killed.arrays[name], array, name)
    assert killed.about["parts"] == alone.about["parts"]
    assert not list(tmp_path.glob(".*.journal"))  # all of it is in the checkpoint
