"""Processes that start together where nothing is compiled yet, as a graph's nodes do."""

import os
import subprocess
import sys

import pytest

STEPS = """
import sys
import numba, numpy as np
for k in range(int(sys.argv[1])):  # numba counts what a process has compiled
    numba.njit(lambda x: x)(k)
from sim_nodes.tasks import make_task
task = make_task(sys.argv[2], {}, "")
states, actions = task.initial_states(), np.zeros(len(task.initial_states()), np.int64)
many = task.step(states, actions)
for n, state in enumerate(states):
    for one, all_ in zip(task.step(state, 0), many, strict=True):
        np.testing.assert_array_equal(one, all_[n])
"""


@pytest.mark.parametrize("task", ["pendulum", "slung_load", "cart_pole"])
def test_what_they_compile_is_whole(tmp_path, task):
    """Also later: with generalised ufuncs they crashed, and then every process that came after."""

    def start(compiled):
        return subprocess.Popen(
            [sys.executable, "-c", STEPS, str(compiled), task],
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        )

    together = [start(compiled) for compiled in (0, 2)]
    assert [process.wait(120) for process in together] == [0, 0]
    assert start(0).wait(120) == 0


@pytest.mark.parametrize("how", ["full", "nowhere"])
def test_a_disk_that_takes_nothing_ends_nothing(tmp_path, how):
    """What was compiled is only not kept."""
    folder = tmp_path / "cache"
    folder.mkdir()
    if how == "nowhere":
        folder = tmp_path / "file" / "cache"
        folder.parent.write_text("")
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n"
    command = [sys.executable, "-c", (limit if how == "full" else "") + STEPS, "0", "pendulum"]
    done = subprocess.run(
        command, env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not list(tmp_path.rglob("*.nbc"))
