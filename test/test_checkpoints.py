"""Checkpoints: kept while learning, checked before they are believed, never another's."""

import contextlib
import io
import json
import os
import random
import signal
import subprocess
import sys
import time
import tracemalloc
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from iolspi_ros.cli.saving import saved
from iolspi_ros.core.lspi_settings import LSPISettings
from iolspi_ros.core.online import OnlineLSPI
from iolspi_ros.core.samples import Transition
from iolspi_ros.errors import InputError
from iolspi_ros.saving import checkpoint, keeper
from iolspi_ros.saving.checkpoint import Content, DamagedError
from iolspi_ros.saving.keeper import Keeper, NotSavedError
from sim_nodes.tasks.pendulum import Pendulum

SETTINGS = LSPISettings(update_interval=50, centers=(3, 3))


def learner(steps=70, seed=0):
    rng = np.random.default_rng(seed)
    made = OnlineLSPI(Pendulum.description, SETTINGS, np.random.default_rng(seed))
    for _ in range(steps):
        t = Transition(rng.uniform(-1, 1, 2), int(rng.integers(3)), -1.0, rng.uniform(-1, 1, 2))
        if made.observe(t):
            made.finish_update(made.begin_update()())
    return made


def snapshot(made, kept=None):
    return checkpoint.snapshot(made, "iolspi", kept.run if kept else "")


def steps(path):
    return checkpoint.read(path).about["parts"]["learner"]["step"]


@pytest.fixture
def keep(tmp_path):
    said, made = [], []

    def make(name="policy.npz", kept=3):
        made.append(Keeper(tmp_path / name, kept, said.append))
        return made[-1]

    make.said = said
    yield make
    for one in made:
        one.close()


# ---------------------------------------------------------------- the file


def test_it_goes_on_bit_by_bit_and_numpy_reads_it_too(tmp_path):
    path, one, other = tmp_path / "c.npz", learner(), learner(0, 9)
    checkpoint.save(path, one, "iolspi")
    checkpoint.load(path, other, "iolspi")
    np.testing.assert_array_equal(np.load(path)["learner.weights"], one.weights)
    for _ in range(20):
        state = np.array([0.1, 0.2])
        assert one.act(state) == other.act(state)


def test_a_thousand_flipped_bits_are_all_noticed(tmp_path):
    path, rng = tmp_path / "c.npz", random.Random(0)
    checkpoint.save(path, learner(), "iolspi")
    whole = path.read_bytes()
    for _ in range(1000):
        data = bytearray(whole)
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        path.write_bytes(data)
        with pytest.raises(DamagedError):
            checkpoint.read(path)


def sealed(body):
    """A file with the right checksum, whatever it holds."""
    body = io.BytesIO(body)
    end = body.seek(-71, os.SEEK_END)
    seal = checkpoint._digest(body, end)
    return body.getvalue()[:end] + seal


def test_flipped_bits_below_a_right_checksum_give_no_traceback(tmp_path):
    path, rng, mine = tmp_path / "c.npz", random.Random(1), learner()
    checkpoint.save(path, mine, "iolspi")
    whole, before = path.read_bytes(), mine.weights.copy()
    for _ in range(1000):
        data = bytearray(whole)
        data[rng.randrange(len(data) - 71)] ^= 1 << rng.randrange(8)
        path.write_bytes(sealed(bytes(data)))
        with contextlib.suppress(InputError):  # a number that is another is one all the same
            checkpoint.load(path, learner(0), "iolspi")
    np.testing.assert_array_equal(mine.weights, before)


def with_members(path, compression=zipfile.ZIP_STORED, **members):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as packed:
        for name, data in members.items():
            packed.writestr(f"{name}.npy", data)
        packed.comment = bytes(71)
    path.write_bytes(sealed(file.getvalue()))


def npy(shape, data=b"", descr="<f8"):
    file = io.BytesIO()
    about = {"descr": descr, "fortran_order": False, "shape": shape}
    np.lib.format.write_array_header_1_0(file, about)
    return file.getvalue() + data


def pickled():
    file = io.BytesIO()
    np.lib.format.write_array(file, np.array([print], object), allow_pickle=True)
    return file.getvalue()


def test_what_unpacks_to_gigabytes_is_refused_before_room_is_made(tmp_path):
    path = tmp_path / "c.npz"
    with_members(path, zipfile.ZIP_DEFLATED, about=npy((2**27,), bytes(2**24)))
    tracemalloc.start()
    try:
        with pytest.raises(DamagedError):
            checkpoint.read(path)
        with_members(path, about=npy((2**40,)))
        with pytest.raises(DamagedError):
            checkpoint.read(path)
        assert tracemalloc.get_traced_memory()[1] < 2**26
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "data",
    [
        pickled(), npy((2,), bytes(15)), npy((-1,)), npy((2**62, 4)), npy((1,), bytes(8), ">f8"),
        npy((), b"[" * 400, "<U100"), npy((1,), bytes(16), "<c16"), b"", b"\x93NUMPY\x09\x00",
    ],
)  # fmt: skip
def test_foreign_members_are_refused(tmp_path, data):
    with_members(tmp_path / "c.npz", about=data)
    with pytest.raises(DamagedError):
        checkpoint.read(tmp_path / "c.npz")


def test_other_files_are_refused(tmp_path):
    np.save(tmp_path / "plain.npy", np.zeros(3))
    (tmp_path / "plain.npy").rename(tmp_path / "named.npz")
    np.savez(tmp_path / "theirs.npz", about=np.zeros(3))
    (tmp_path / "empty.npz").touch()
    (tmp_path / "folder.npz").mkdir()
    os.mkfifo(tmp_path / "pipe.npz")
    for name in ("named", "theirs", "empty", "folder", "pipe"):
        with pytest.raises(InputError, match="damaged or of another format"):
            checkpoint.read(tmp_path / f"{name}.npz")


def changed(array=None, **rest):
    """A checkpoint whose content was made to say something else."""
    content = snapshot(learner())()
    about, arrays = json.loads(json.dumps(content.about)), dict(content.arrays)
    for name, value in rest.items():
        about["parts"]["learner"][name] = value
    arrays |= array or {}
    return Content(about, arrays)


WEIGHTS = (3, 9)


@pytest.mark.parametrize(
    "content",
    [
        {"array": {"learner.weights": np.full(WEIGHTS, np.nan)}},
        {"array": {"learner.weights": np.zeros((3, 8))}},
        {"array": {"learner.weights": np.zeros(WEIGHTS, np.float32)}},
        {"array": {"learner.batch.action": np.full(20, 99)}},
        {"array": {"learner.batch.action": np.zeros(19, np.int64)}},
        {"array": {"learner.buffer.born": np.zeros(3, np.int64)}},
        {"step": "many"},
        {"step": 2**70},
        {"step": True},
        {"rng": {"bit_generator": "PCG64", "state": {"state": -1, "inc": 1}}},
        {"rng": []},
        {"rng": {}},
        {"moments": {"n_samples": 1, "weight": float("inf"), "prior": 0.0}},
        {"moments": None},
        {"buffer": {}},
    ],
)
def test_what_cannot_be_is_refused_and_the_learner_stays_as_it_was(tmp_path, content):
    path, mine = tmp_path / "c.npz", learner(10, 4)
    before = mine.state()
    checkpoint.write(path, changed(**content))
    with pytest.raises(InputError):
        checkpoint.load(path, mine, "iolspi")
    after = mine.state()
    np.testing.assert_array_equal(before.weights, after.weights)
    assert (before.rng, before.step) == (after.rng, after.step)


# ---------------------------------------------------------------- the files


def test_the_last_few_are_kept_and_the_newest_has_the_name(tmp_path, keep):
    kept = keep()
    for k in range(1, 7):
        kept.save(snapshot(learner(k), kept))
    assert [steps(tmp_path / f"policy{n}.npz") for n in ("", ".5", ".4")] == [6, 5, 4]
    assert len(list(tmp_path.glob("*.npz"))) == 3


def test_what_is_of_somebody_else_is_set_aside_and_never_deleted(tmp_path, keep):
    others = {f"policy{n}.npz": f"of somebody else {n}".encode() for n in ("", ".1", ".7")}
    for name, data in others.items():
        (tmp_path / name).write_bytes(data)
    kept = keep(kept=1)
    for k in range(1, 5):
        kept.save(snapshot(learner(k), kept))
    left = {path.read_bytes() for path in tmp_path.glob("*.npz")}
    assert left >= set(others.values())
    assert steps(tmp_path / "policy.npz") == 4
    assert (tmp_path / "policy.8.npz").read_bytes() == others["policy.npz"]


def test_whoever_resumes_goes_on_with_the_series(tmp_path, keep):
    for run in range(4):
        kept = keep()
        if run:
            path, content = kept.newest()
            assert path == tmp_path / "policy.npz"
            kept.go_on_from(path, content)
        for k in range(4):
            kept.save(snapshot(learner(10 * run + k), kept))
        kept.close()
    assert len(list(tmp_path.glob("*.npz"))) == 3


@pytest.mark.parametrize("harm", [b"", b"nonsense", None])
def test_the_newest_whole_one_is_taken(tmp_path, keep, harm):
    kept = keep()
    for k in (1, 2, 3):
        kept.save(snapshot(learner(k), kept))
    newest = tmp_path / "policy.npz"
    newest.write_bytes(newest.read_bytes()[:-100] if harm is None else harm)
    path, content = kept.newest()
    assert content.about["parts"]["learner"]["step"] == 2
    assert "damaged" in keep.said[-1]
    assert newest.exists()
    path.unlink()
    (tmp_path / "policy.1.npz").unlink()
    assert kept.newest() is None


def test_two_learners_never_share_a_file(tmp_path, keep):
    first = keep()
    with pytest.raises(InputError, match=f"another learner's .process {os.getpid()}."):
        keep()
    first.close()
    assert not list(tmp_path.glob(".*"))
    keep().save(snapshot(learner(1)))


@pytest.mark.parametrize("kind", ["folder", "link", "dangling", "below a file"])
def test_what_is_no_place_for_a_file_is_refused_untouched(tmp_path, keep, kind):
    place = tmp_path / "policy.npz"
    (tmp_path / "real.npz").write_bytes(b"real")
    if kind == "folder":
        place.mkdir()
    elif kind == "below a file":
        place = tmp_path / "real.npz" / "policy.npz"
    else:
        place.symlink_to("real.npz" if kind == "link" else "nowhere")
    with pytest.raises(InputError, match="allowed: a file"):
        keep(place.relative_to(tmp_path))
    assert (tmp_path / "real.npz").read_bytes() == b"real"
    assert place.is_dir() == (kind == "folder")


def test_a_save_that_fails_is_kept_and_said_and_goes_elsewhere_at_the_end(
    tmp_path, keep, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    kept, made = keep("there/policy.npz"), learner(5)
    (tmp_path / "there" / ".policy.npz.lock").unlink()
    (tmp_path / "there").rmdir()
    (tmp_path / "there").write_text("a file now")
    kept.offer(snapshot(made, kept))
    end = time.monotonic() + 10.0
    while not kept.failure and time.monotonic() < end:
        time.sleep(0.01)
    assert "cannot be written" in kept.failure
    assert any("it is tried again" in text for text in keep.said)
    with pytest.raises(NotSavedError, match=r"it is in .*state/iolspi_ros/policy-"):
        kept.save(snapshot(made, kept))
    (found,) = (tmp_path / "state" / "iolspi_ros").iterdir()
    assert steps(found) == 5
    (tmp_path / "there").unlink()
    kept.save(snapshot(made, kept))  # and as soon as it works again, it is there
    assert (kept.failure, steps(tmp_path / "there" / "policy.npz")) == ("", 5)


def test_a_disk_that_is_full_loses_nothing_that_was_there(tmp_path, keep, monkeypatch):
    kept = keep()
    kept.save(snapshot(learner(1), kept))

    def full(file, content):
        file.write(b"the first half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(checkpoint, "write_into", full)
    monkeypatch.setattr(keeper, "state_folder", lambda: tmp_path / "also full")
    with pytest.raises(NotSavedError, match=r"No space left on device; .* nor elsewhere"):
        kept.save(snapshot(learner(2), kept))
    assert steps(tmp_path / "policy.npz") == 1
    assert not [path for path in tmp_path.iterdir() if path.suffix == ".part"]


def test_what_is_observed_while_it_is_written_is_not_in_it(tmp_path, keep):
    kept, made = keep(), learner(40)
    taken, before = snapshot(made, kept), made.weights.copy()
    for k in range(60):
        t = Transition(np.full(2, 0.01 * k), k % 3, -1.0, np.full(2, 0.01 * k))
        if made.observe(t):
            made.finish_update(made.begin_update()())
    kept.save(taken)
    other = learner(0, 5)
    checkpoint.load(tmp_path / "policy.npz", other, "iolspi")
    np.testing.assert_array_equal(other.weights, before)
    assert (other.step, made.step) == (40, 100)
    assert replace(other.state(), batch=None).step == 40


# ---------------------------------------------------------------- the node

AT_ONCE = ["-p", "wait_for_demonstrations:=false", "-p", "update_interval:=100"]


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGQUIT, signal.SIGTERM, signal.SIGINT])
def test_every_signal_to_end_saves(nodes, tmp_path, number):
    path = tmp_path / "c.npz"
    nodes.start("graph", *AT_ONCE, "-p", "learner:update_interval:=100000",
                "-p", f"learner:checkpoint:={path}", "-p", "simulator:episodes:=1")  # fmt: skip
    nodes.wait_for("graph", "done: 1 episodes")
    assert nodes.end("graph", number) == 0
    assert steps(path) > 0  # also before the first update


def test_a_killed_learner_has_lost_little_and_two_never_share(nodes, tmp_path):
    path = tmp_path / "c.npz"
    more = ["-p", f"learner:checkpoint:={path}", "-p", "checkpoint_updates:=1"]
    nodes.start("graph", *AT_ONCE, *more)
    nodes.wait_for("graph", "acting on")
    end = time.monotonic() + 60.0
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.05)
    status, said = nodes.finish("learner", "-p", f"checkpoint:={path}", "-p", "autostart:=activate")
    assert (status, "another learner's" in said) == (2, True), said
    nodes.end("graph", signal.SIGKILL)
    before = steps(path)
    nodes.start("graph", *AT_ONCE, *more, "-p", "learner:resume:=true", name="again")
    nodes.wait_for("again", f"resumed from {path} at step {before}")
    assert nodes.end("again") == 0
    assert steps(path) >= before > 0


def test_nothing_to_resume_from_starts_from_nothing_and_says_so(nodes, tmp_path):
    nodes.start("graph", *AT_ONCE, "-p", f"learner:checkpoint:={tmp_path / 'new' / 'c.npz'}",
                "-p", "learner:resume:=true")  # fmt: skip
    nodes.wait_for("graph", "no whole checkpoint at")
    nodes.wait_for("graph", "acting on")
    assert nodes.end("graph") == 0


def test_a_learner_that_could_not_save_says_so_and_where_it_is(nodes, tmp_path):
    nodes.env["XDG_STATE_HOME"] = str(tmp_path / "state")
    path = tmp_path / "there" / "c.npz"
    nodes.start("graph", *AT_ONCE, "-p", f"learner:checkpoint:={path}",
                "-p", "simulator:episodes:=2")  # fmt: skip
    nodes.wait_for("graph", "acting on")
    (path.parent).rename(tmp_path / "gone")
    path.parent.write_text("a file now")
    nodes.wait_for("graph", "done: 2 episodes")
    assert nodes.end("graph") == 1
    assert "it is in" in nodes.log("graph")
    assert len(list((tmp_path / "state" / "iolspi_ros").iterdir())) == 1


@pytest.mark.parametrize("place", ["/proc/1/c.npz", "{here}", "{here}/link.npz"])
def test_a_place_where_nothing_can_be_saved_is_refused_at_the_start(run_here, tmp_path, place):
    (tmp_path / "link.npz").symlink_to("elsewhere")
    status, said = run_here("learner", "-p", f"checkpoint:={place.format(here=tmp_path)}")
    assert (status, "Traceback" in said, "allowed: a file" in said) == (2, False, True), said


# ---------------------------------------------------------------- the command

TRAIN = [sys.executable, "-m", "iolspi_ros", "learn", "--episodes", "5000", "--out"]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGKILL])
def test_learning_without_a_graph_saves_on_every_end(tmp_path, number):
    out = tmp_path / "out"
    process = subprocess.Popen([*TRAIN, str(out)], stdout=subprocess.DEVNULL)
    end = time.monotonic() + 90.0
    while not (out / "checkpoint.npz").exists() and time.monotonic() < end:
        time.sleep(0.05)
    process.send_signal(number)
    status = process.wait(60.0)
    assert status == (-number if number == signal.SIGKILL else 128 + number)
    assert steps(out / "checkpoint.npz") > 0


def test_what_is_half_computed_is_not_saved_as_finished(tmp_path):
    made = learner(10)
    with saved(tmp_path / "c.npz", made, "iolspi") as saving:

        def half():
            made.weights = made.weights * 0.0
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(10.0)

        saving.computed(half)
    assert (saving.interrupted, saving.status) == (True, 128 + signal.SIGTERM)
    assert checkpoint.read(tmp_path / "c.npz").arrays["learner.weights"].any()
