import importlib
import json
import os
import signal
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest

from iolspi_ros.errors import InputError
from iolspi_ros.experiments import engine, versions
from iolspi_ros.experiments.cells import Cell
from iolspi_ros.experiments.results import Store


@dataclass(frozen=True)
class Setting:
    slope: float = 1.0


@dataclass(frozen=True)
class OtherSetting:
    slope: float = 1.0


def line(setting, seed):
    return {"y": setting.slope * seed, "x": np.arange(3.0) + seed}


CELL = Cell("line", line, Setting(2.0), seeds=6)


def in_order(tasks):
    for task in tasks:
        yield engine._compute(*task)


def compute(store, cells=(CELL,)):
    """Compute what is missing; which seeds that was."""
    lacking = engine.missing(cells, store)
    engine.run(lacking, store.write, in_order)
    return [seed for _, seed in lacking]


def test_results_are_stacked_by_seed(tmp_path):
    store = Store(tmp_path)
    assert compute(store) == [0, 1, 2, 3, 4, 5]
    data = engine.gather([CELL], store)["line"]
    np.testing.assert_array_equal(data["y"], 2.0 * np.arange(6))
    assert data["x"].shape == (6, 3)
    assert compute(store) == []


def test_a_cell_of_two_figures_is_computed_once(tmp_path):
    store = Store(tmp_path)
    assert compute(store, [CELL, replace(CELL, label="the same", seeds=8)]) == list(range(8))


def test_the_longest_come_first(tmp_path):
    long = replace(CELL, setting=Setting(3.0), cost=9.0, seeds=1)
    lacking = engine.missing([CELL, long], Store(tmp_path))
    assert lacking[0][0].setting.slope == 3.0


def test_an_interrupted_run_goes_on_where_it_stopped(tmp_path):
    store = Store(tmp_path)

    def stop_after_two(cell, seed, result):
        if seed == 2:
            raise KeyboardInterrupt
        store.write(cell, seed, result)

    with pytest.raises(KeyboardInterrupt):
        engine.run(engine.missing([CELL], store), stop_after_two, in_order)
    assert compute(store) == [2, 3, 4, 5]


def test_a_file_cut_short_costs_itself_only(tmp_path):
    said = []
    store = Store(tmp_path, said.append)
    compute(store)
    path = store.path(CELL, 3)
    path.write_bytes(path.read_bytes()[:-40])
    store = Store(tmp_path, said.append)
    assert compute(store) == [3]
    assert len(said) == 1
    assert str(path) in said[0]
    np.testing.assert_array_equal(engine.gather([CELL], store)["line"]["y"], 2.0 * np.arange(6))


def test_a_full_disk_keeps_what_was_computed(tmp_path):
    """/dev/full answers every write as a full disk does."""
    store = Store(tmp_path)
    full = store.path(CELL, 4)
    full.parent.mkdir()
    full.with_name(f".4.npz.{os.getpid()}.part").symlink_to("/dev/full")
    with pytest.raises(InputError, match=r"No space left on device.*is kept"):
        compute(store)
    assert not full.exists()
    assert compute(store) == [4, 5]


def test_an_unusable_folder_is_said_before_anything_is_computed(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="cannot be written"):
        Store(tmp_path / "file" / "data")


def test_a_result_says_what_made_it(tmp_path):
    store = Store(tmp_path)
    compute(store)
    with np.load(store.path(CELL, 5)) as file:
        about = json.loads(str(file["about"]))
    assert about["setting"] == {"kind": "Setting", "slope": 2.0}
    assert about["seed"] == 5
    assert about["versions"]["numpy"] == np.__version__


def test_another_setting_version_or_file_is_another_result(tmp_path, monkeypatch):
    key = CELL.key
    assert replace(CELL, label="x", seeds=9).key == key
    assert replace(CELL, setting=Setting(2.5)).key != key
    assert replace(CELL, setting=OtherSetting(2.0)).key != key
    monkeypatch.setattr(versions, "libraries", lambda: {"numpy": "0.1"})
    assert replace(CELL).key != key


def test_code_counts_and_its_comments_do_not(tmp_path, monkeypatch):
    module = tmp_path / "made_up.py"
    monkeypatch.syspath_prepend(str(tmp_path))

    def digest(text):
        module.write_text(text)
        importlib.invalidate_caches()
        sys.modules.pop("made_up", None)
        versions.code.cache_clear()
        return versions.code("made_up")

    first = digest('"""One."""\ndef f():\n    """Two."""\n    return 1\n')
    assert digest('"""Other."""\n# more\ndef f():\n    return 1\n') == first
    assert digest("def f():\n    return 2\n") != first
    inside = digest("from iolspi_ros.core.lspi import solve\n")
    monkeypatch.setattr(versions, "ROOMS", ("sim_nodes",))
    assert digest("from iolspi_ros.core.lspi import solve\n") != inside


def test_two_processes_give_what_one_does(tmp_path):
    one, two = Store(tmp_path / "one"), Store(tmp_path / "two")
    compute(one)
    engine.run(engine.missing([CELL], two), two.write, engine.local(2))
    for a, b in zip(*(engine.gather([CELL], s)["line"].items() for s in (one, two)), strict=True):
        assert a[0] == b[0]
        np.testing.assert_array_equal(a[1], b[1])


def slow_line(setting, seed):
    import time

    time.sleep(0.05)
    return line(setting, seed) | {"process": os.getpid()}


@pytest.fixture
def dask_cluster():
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        yield cluster


def test_a_killed_worker_loses_nothing_and_nothing_counts_twice(tmp_path, dask_cluster):
    store, cell = Store(tmp_path), Cell("slow", slow_line, Setting(), seeds=40)
    kept = []

    def keep(cell, seed, result):
        kept.append(seed)
        store.write(cell, seed, result)
        if len(kept) == 10:  # the one that made this result is at work on others
            os.kill(int(result["process"]), signal.SIGKILL)

    backend = engine.cluster(dask_cluster.scheduler_address)
    engine.run(engine.missing([cell], store), keep, backend)
    assert sorted(kept) == list(range(40))
    data = engine.gather([cell], store)["slow"]
    np.testing.assert_array_equal(data["y"], np.arange(40.0))
    assert len(set(data["process"].tolist())) >= 2


def test_nobody_at_the_schedulers_address_is_said():
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        engine.cluster("tcp://127.0.0.1:9")


def test_a_worker_with_other_code_refuses():
    other = replace(CELL)
    vars(other)["key"] = "of other code"  # as whoever asks would have named it
    with pytest.raises(InputError, match="would compute 'line' otherwise"):
        engine._compute(0, other, 0)
