"""A machine without Chromium: what CI does about it, and what the tests say."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parent.parent / "scripts" / "chromium.sh"
INSTALLING = """case "$*" in
*install*chromium*chromium-driver) touch chromium chromedriver; chmod +x chrom* ;;
esac"""


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Install on a PATH with these scripts alone; the status, and what is said."""
    monkeypatch.chdir(tmp_path)

    def install(**commands):
        for name, text in commands.items():
            file = tmp_path / name.replace("_", "-")
            file.write_text(f"#!/bin/sh\nPATH=/usr/bin:/bin\n{text}\n")
            file.chmod(0o755)
        ended = subprocess.run(
            ["/bin/sh", SCRIPT], env={"PATH": str(tmp_path)}, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        return ended.returncode, ended.stdout + ended.stderr

    return install


def test_what_is_there_is_not_installed(machine):
    assert machine(chromium="", chromedriver="", apt_get="exit 1", id="exit 1") == (0, "")


@pytest.mark.parametrize(("commands", "why"), [
    ({}, "there is no apt-get"), ({"apt_get": "exit 1", "id": "echo 1000"}, "only root may"),
])  # fmt: skip
def test_where_it_cannot_be_installed_the_tests_will_skip(machine, commands, why):
    status, said = machine(**commands)
    assert status == 0
    assert why in said
    assert "will skip" in said


def test_root_installs_it(machine, tmp_path):
    status, said = machine(apt_get=INSTALLING, id="echo 0")
    assert status == 0, said
    assert (tmp_path / "chromedriver").exists()


@pytest.mark.parametrize(("apt", "why"), [
    ("echo no network; exit 100", "no network"), ("exit 100", "could not install"),
    ("exit 0", "installed no chromium"),
])  # fmt: skip
def test_an_installation_that_fails_is_an_error(machine, apt, why):
    status, said = machine(apt_get=apt, id="echo 0")
    assert status == 1
    assert why in said


@pytest.mark.parametrize("chosen", ["browser", "not slow"])
def test_without_it_the_last_lines_say_so(chosen):
    file = Path(__file__).with_name("test_cockpit_browser.py")
    ended = subprocess.run(
        [sys.executable, "-m", "pytest", "-rs", "-m", chosen, file], capture_output=True, text=True,
        env=os.environ | {"PATH": "/nowhere"}, cwd=file.parent.parent, check=False,
    )  # fmt: skip
    assert " passed" not in ended.stdout
    last = ended.stdout.strip().splitlines()[-15:]
    assert "not tested in a browser: no Chromium: apt-get install chromium" in "".join(last)
