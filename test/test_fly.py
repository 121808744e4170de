"""`iolspi fly`, from preflight to report, on the embedded autopilot."""

import json
import os
import subprocess
import sys

import pytest


@pytest.mark.slow
@pytest.mark.timeout(400)
@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_it_flies_the_whole_way(tmp_path, domain, like):
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-m", "iolspi_ros", "fly", "--like", like, "--speed-up", "4",
         "--practice", "0", "--episodes", "2", "--shown", "3", "--out", str(out)],
        capture_output=True, text=True, env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    checklist = lines[lines.index("Preflight:") + 1 :]
    assert checklist[0].startswith(f"  autopilot: {like}, system 1, at udpin:127.0.0.1:")
    names = [line.split(":")[0].strip() for line in checklist[:7]]
    assert names[1:] == [
        "signed",
        *{"px4": ("COM_OF_LOSS_T", "COM_OBL_RC_ACT"),
          "ardupilot": ("GUID_TIMEOUT", "PSC_JERK_XY")}[like],
        "position estimate", "clock", "load",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert summary["autopilot"] == f"embedded, like {like}"
    assert summary["load"] == "reported by its own system"
    assert summary["envelope_left"] == "0"
    assert 0.0 <= summary["shown_success_fraction"] <= 1.0
    for name in ("report.html", "flight.tlog", "checkpoint.npz", "bridge.log"):
        assert (out / name).stat().st_size > 0
    assert "Traceback" not in (out / "bridge.log").read_text()
    assert not (out / "sitl.log").read_text().count("Traceback")
