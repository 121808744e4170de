"""A terminal's keyboard as a stick, which has to guess when a key is let go."""

import os
import pty
import signal
import subprocess
import sys
import termios
from contextlib import suppress

import pytest
from conftest import Peer
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Joy

from msg_bridge.cockpit.keyboard import AGAIN, FIRST, Keyboard, keys
from sim_nodes.tasks.slung_load import SlungLoad

TASK = SlungLoad.description
REST = [0] * 5


@pytest.mark.parametrize(("sent", "meant"), [
    ("\x1b[D", ["left"]), ("\x1bOC", ["right"]), ("\x1b[A\x1b[B", ["up", "down"]),
    ("\x1b[1;5D", ["left"]), ("4K ", ["4", "k", " "]), ("\x1b[3~x", ["x"]), ("\x1b", []),
])  # fmt: skip
def test_keys_as_terminals_send_them(sent, meant):
    assert list(keys(sent)) == meant


@given(st.text())
def test_nothing_that_is_sent_breaks_it(text):
    keyboard = Keyboard(4)
    for key in keys(text):
        keyboard.press(key, 0.0)
    at = keyboard.at(0.0)
    assert all(-1.0 <= x <= 1.0 for x in at.axes)
    assert len(at.buttons) == 5


def test_a_tap_holds_as_long_as_a_terminal_waits_and_a_held_key_ends_soon():
    keyboard = Keyboard(4)
    keyboard.press("left", 0.0)
    assert keyboard.at(FIRST - 0.01).axes == (1.0, 0.0)
    assert keyboard.at(FIRST).axes == (0.0, 0.0)
    times = [10.0, *(10.5 + 0.04 * k for k in range(20))]  # held: a pause, then again and again
    for now in times:
        keyboard.press("left", now)
        assert keyboard.at(now).axes == (1.0, 0.0)
    assert keyboard.at(times[1] - 0.01).axes == (1.0, 0.0)
    assert keyboard.at(times[-1] + AGAIN - 0.01).axes == (1.0, 0.0)
    assert keyboard.at(times[-1] + AGAIN).axes == (0.0, 0.0)


def test_the_opposite_ends_it_and_naught_lets_go_of_all():
    keyboard = Keyboard(4)
    keyboard.press("left", 0.0)
    keyboard.press("right", 0.1)
    assert keyboard.at(0.1).axes == (-1.0, 0.0)
    keyboard.press("4", 0.2)
    keyboard.press("5", 0.2)  # there is none
    assert keyboard.at(0.2).buttons == (0, 0, 0, 1, 0)
    keyboard.press("0", 0.3)
    assert keyboard.at(0.3).axes == (0.0, 0.0)
    assert keyboard.at(0.3).buttons == (0,) * 5
    keyboard.press(" ", 0.4)
    assert keyboard.at(99.0).buttons[-1] == 1
    keyboard.press(" ", 100.0)
    assert keyboard.at(100.0).buttons[-1] == 0


def begin(file):
    command = [sys.executable, "-m", "iolspi_ros", "watch", "--stick"]
    return subprocess.Popen(
        command, stdin=file, stdout=file, stderr=file, env=os.environ | {"TERM": "xterm"}
    )


def test_keys_of_a_terminal_are_a_joystick_on_the_graph(ros):
    """In a terminal of its own, from the first key to Ctrl-C."""
    graph = Peer(ros)
    graph.listen("joy", Joy)
    kept = graph.be_vehicle(TASK)
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    process, heard = begin(theirs), graph.heard["joy"]
    seen = bytearray()

    def drained(ready):
        os.set_blocking(ours, False)

        def look():
            with suppress(BlockingIOError):
                seen.extend(os.read(ours, 65536))  # else the terminal is full, and it waits
            return ready()

        graph.until(look)

    def newest(x, buttons):
        return heard and heard[-1].axes[0] == x and list(heard[-1].buttons) == buttons

    try:
        drained(lambda: newest(0.0, REST))
        os.write(ours, b"\x1b[D")
        drained(lambda: newest(1.0, REST))
        drained(lambda: newest(0.0, REST))  # by itself
        os.write(ours, b"4")
        drained(lambda: newest(0.0, [0, 0, 0, 1, 0]))
        os.write(ours, b"0 ")
        drained(lambda: newest(0.0, [0, 0, 0, 0, 1]))
        os.write(ours, b"k")
        drained(lambda: b"there is no demonstrator" in seen)
        process.send_signal(signal.SIGINT)
        drained(lambda: process.poll() is not None)
        drained(lambda: newest(0.0, REST))  # centred at the end, the takeover let go
        assert process.returncode in (0, 130), seen[-500:]
        assert termios.tcgetattr(theirs) == before
    finally:
        process.kill()
        process.wait()
        os.close(ours)
        os.close(theirs)
    del kept


def test_without_a_terminal_it_says_so():
    command = [sys.executable, "-m", "iolspi_ros", "watch", "--stick"]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 2
    assert "--stick needs a keyboard" in done.stderr + done.stdout
    assert "Traceback" not in done.stderr
