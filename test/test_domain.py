"""A ROS domain of one's own: one where nobody is, and that nobody else is given meanwhile."""

import socket
import subprocess
import sys
from contextlib import ExitStack

import pytest

from iolspi_ros import graph
from iolspi_ros.errors import InputError

HOLD = """
from iolspi_ros.graph import own_domain
with own_domain() as domain:
    print(domain, flush=True)
    input()
"""


def test_no_two_hold_the_same_one_before_they_have_begun():
    with ExitStack() as held:
        mine = {held.enter_context(graph.own_domain()) for _ in range(10)}
        assert len(mine) == 10
        other = held.enter_context(
            subprocess.Popen(
                [sys.executable, "-c", HOLD], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                text=True,
            )
        )  # fmt: skip
        theirs = int(other.stdout.readline())
        assert theirs not in mine
        rest = {held.enter_context(graph.own_domain()) for _ in range(10)}
        assert not rest & (mine | {theirs})
        other.communicate("\n")


@pytest.mark.parametrize("participant", [0, 1, 7])
def test_one_that_somebody_is_in_is_nobody_s(monkeypatch, participant):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        with graph.own_domain() as domain:
            # The DDSI-RTPS standard, 9.6.1.1: PB 7400, DG 250, PG 2, d1 10.
            listening.bind(("127.0.0.1", 7400 + 250 * domain + 10 + 2 * participant))
        monkeypatch.setattr(graph, "DOMAINS", (domain,))
        with pytest.raises(InputError, match="every ROS domain"), graph.own_domain():
            pass
