"""Folders for results: each run its own, whatever was there before."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from iolspi_ros.cli.record import _put_in_place
from iolspi_ros.errors import InputError
from iolspi_ros.folders import LATEST, MARK, SERIES, check_free, new_folder


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def content(folder):
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


@pytest.mark.parametrize("place", SERIES)
def test_the_usual_place_gets_a_numbered_folder_each_time(place):
    for number in (1, 2, 3):
        folder = new_folder(place)
        assert folder == place / str(number)
        (folder / "simulator.log").write_text("said")
        assert (place / LATEST).resolve() == folder.resolve()
    assert content(place / "1")[place / "1" / "simulator.log"] == b"said"


def test_what_an_older_version_or_the_user_left_there_stays():
    place = SERIES[0]
    place.mkdir(parents=True)
    for name in ("report.html", "simulator.log", "checkpoint.npz", LATEST, "7"):
        (place / name).write_text("mine")
    before = content(place)
    assert new_folder(place) == place / "8"
    assert before.items() <= content(place).items()


@pytest.mark.parametrize("name", ["simulator.log", "bridge.log", "checkpoint.npz", ".hidden"])
def test_a_place_that_holds_something_is_refused_untouched(tmp_path, name):
    (tmp_path / name).write_text("mine")
    before = content(tmp_path)
    for out in (tmp_path, Path(".")):
        for look in (check_free, new_folder):
            with pytest.raises(InputError, match="holds other files; allowed"):
                look(out)
    assert content(tmp_path) == before


def test_a_place_that_is_no_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(InputError, match="cannot be made"):
            new_folder(out)


@pytest.mark.parametrize("out", [SERIES[0], Path("mine")])
def test_many_at_once_never_share_a_folder(out):
    with ThreadPoolExecutor(16) as pool:
        made = list(pool.map(lambda _: _or_none(out), range(16)))
    given = [folder for folder in made if folder]
    assert len(given) == len(set(given)) == (16 if out in SERIES else 1)


def _or_none(out):
    try:
        return new_folder(out)
    except InputError:
        return None


def test_each_folder_says_who_made_it():
    assert "iolspi_ros" in (new_folder(Path("a/b")) / MARK).read_text()


def test_a_bag_never_replaces_one_that_came_meanwhile(tmp_path):
    for name in ("work/bag", "bag"):
        (tmp_path / name).mkdir(parents=True)
        (tmp_path / name / "file").write_text(name)
    with pytest.raises(InputError, match="the bag is in"):
        _put_in_place(tmp_path / "work" / "bag", tmp_path / "bag", tmp_path / "work")
    assert (tmp_path / "bag" / "file").read_text() == "bag"
    assert (tmp_path / "work" / "bag" / "file").read_text() == "work/bag"


def test_learning_twice_keeps_both(tmp_path):
    command = [sys.executable, "-m", "iolspi_ros", "learn", "--episodes", "4"]
    for _ in range(2):
        subprocess.run(command, check=True, cwd=tmp_path, capture_output=True)
    for number in ("1", "2"):
        assert (tmp_path / "out" / "learn" / number / "checkpoint.npz").is_file()
        assert (tmp_path / "out" / "learn" / number / "report.html").is_file()
