"""What commands say of time: how long it took, and how long it will still take."""

import subprocess
import sys
import time

import pytest

from iolspi_ros.cli.progress import Remaining

PACES = {
    # seconds of what is before the first sign of life, and how the rest goes: share by share
    "steady": (0.0, lambda share: share),
    "after compiling": (95.0, lambda share: share),
    "ever slower": (0.0, lambda share: 1.0 - (1.0 - share) ** 1.5),
    "ever faster": (5.0, lambda share: share**1.5),
    "half of it there already": (0.0, lambda share: 0.5 + share / 2.0),
    "by fits and starts": (2.0, lambda share: int(share * 20) / 20),
}


@pytest.mark.parametrize("name", PACES)
@pytest.mark.parametrize("seconds", [20.0, 600.0])
def test_what_is_left_is_sensible_and_true_at_the_end(name, seconds):
    before, pace = PACES[name]
    remaining, total, step = Remaining(1000), 1000, seconds / 200
    for count in range(200):
        done = int(total * pace(count / 200))
        left = remaining(before + count * step, done)
        really = seconds * (1.0 - count / 200)
        if left is None:
            assert count < 30
        elif count > 60:
            assert really / 3.0 - 2.0 * step - seconds / 20 <= left <= 3.0 * really + seconds / 20


def test_a_late_start_does_not_count():
    """The issue's own: 91 s were said to be left four seconds before the end."""
    remaining, said = Remaining(80), []
    for second in range(100):  # 95 s of nothing, then 80 episodes in 5 s
        done = max(0, (second - 94) * 16)
        said.append(remaining(float(second), done))
    assert [left for left in said if left is not None][-4] <= 6.0


def test_the_time_that_a_command_took_is_that_since_its_start():
    """Also what passed before our own first line: loading Python and what it imports."""
    script = (
        "import time; time.sleep(0.7)\nfrom iolspi_ros.cli.progress import so_far\nprint(so_far())"
    )
    begin = time.monotonic()
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    took = time.monotonic() - begin
    assert 0.65 <= float(done.stdout) <= took + 0.05
