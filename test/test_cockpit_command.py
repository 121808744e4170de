"""`iolspi cockpit` and `iolspi watch`, from the outside."""

import os
import socket
import subprocess
import sys

import pytest

from iolspi_ros.cli.cockpit import from_page
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings
from iolspi_ros.task import Action


def iolspi(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-m", "iolspi_ros", *map(str, arguments)], capture_output=True, text=True,
        timeout=90, env=os.environ | environment, check=False,
    )  # fmt: skip


@pytest.mark.parametrize(("options", "words"), [
    (["--speed", 5], "--speed is 5.0; allowed: [0.1, 1.0]"),
    (["--task", "kite"], "kite"),
    (["--config", "not_there.yaml"], "not_there.yaml"),
])  # fmt: skip
def test_bad_input_is_said_in_a_line(tmp_path, options, words):
    ended = iolspi("cockpit", "--out", tmp_path / "out", *options)
    assert ended.returncode == 2
    assert words in ended.stderr
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("where", ["port", "host"])
def test_a_page_that_cannot_be_served_ends_the_command(tmp_path, where):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        options = {"port": ["--port", port], "host": ["--host", "0.0.0.0"]}[where]
        ended = iolspi("cockpit", "--out", tmp_path / "out", *options, IOLSPI_COCKPIT_TOKEN="")
    words = {"port": f"port {port}: Address already in use", "host": "IOLSPI_COCKPIT_TOKEN is"}
    assert ended.returncode == 2
    assert words[where] in ended.stderr
    assert "Traceback" not in ended.stderr


def test_without_its_library_the_page_says_what_is_missing(tmp_path, run_here, monkeypatch):
    monkeypatch.delitem(sys.modules, "msg_bridge.cockpit.page", raising=False)
    monkeypatch.setitem(sys.modules, "nicegui", None)
    status, said = run_here("cockpit")
    assert status == 2
    assert "the cockpit's page needs nicegui, which is not installed; allowed: make" in said


@pytest.mark.parametrize("n_actions", [2, 3, 4, 10])
def test_the_demonstrator_understands_the_page_s_stick(n_actions):
    """Each button is its action, the last the takeover, and left is the first action."""
    given = from_page(n_actions)
    settings = JoystickSettings(joy_axis=given["joy_axis"], joy_buttons=tuple(given["joy_buttons"]))
    stick = Joystick(settings, [Action("a")] * n_actions, 1, (given["takeover_button"],))
    for action in range(n_actions):
        stick.take([0.0, 0.0], [int(b == action) for b in range(n_actions + 1)])
        assert stick.action() == action
        assert not stick.pressed(given["takeover_button"])
    stick.take([0.0, 0.0], [0] * n_actions + [1])
    assert stick.pressed(given["takeover_button"])
    for x, action in ((1.0, 0), (-1.0, n_actions - 1)):
        stick.take([x, 0.0], [0] * (n_actions + 1))
        assert stick.action() == action


def test_a_graph_is_watched_in_lines_where_there_is_no_terminal(nodes, domain):
    nodes.start("simulator")
    nodes.wait_for("simulator", "actions are heard")
    ended = iolspi("watch", "--seconds", 6, ROS_DOMAIN_ID=str(domain))
    assert ended.returncode == 0, ended.stderr
    assert "pendulum; episode 0, step 0: nobody yet" in ended.stdout
