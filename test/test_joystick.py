"""What a stick says, and when it cannot be trusted."""

import math
import subprocess
import sys

import numpy as np
import pytest
from conftest import Peer
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Joy

from iolspi_ros.errors import InputError
from iolspi_ros.nodes.calibration import Calibration
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings
from iolspi_ros.task import Action
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

ACTIONS = [Action(name) for name in "abcde"]


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def made(needed=(), **values):
    clock = Clock()
    return Joystick(JoystickSettings(**values), ACTIONS[:3], 1, needed, clock), clock


def test_a_motionless_stick_with_autorepeat_does_not_move():
    stick, clock = made()
    for noise in (0.0, 0.04, -0.05, 0.02) * 10:
        clock.now += 0.05
        stick.take([noise, 1.0], [0, 1])  # a trigger rests at 1, a switch is on
        assert not stick.moved
    stick.take([0.4, 1.0], [0, 1])
    assert stick.moved


@pytest.mark.parametrize(
    ("axes", "buttons", "moves"),
    [([0.2, 1.0], [0, 1], True), ([0.05, 1.0], [0, 1], False), ([0.0, -1.0], [0, 1], False),
     ([0.0, 1.0], [1, 1], True), ([0.0, 1.0], [0, 0], False)],
)  # fmt: skip
def test_its_axis_or_a_button_pressed_is_a_movement(axes, buttons, moves):
    stick, _ = made()
    stick.take([0.0, 1.0], [0, 1])
    stick.settle()
    stick.take(axes, buttons)
    assert stick.moved == moves


def test_a_button_that_was_down_may_be_pressed_anew():
    stick, _ = made()
    stick.take([0.0], [1])
    stick.settle()
    for button, moves in ((1, False), (0, False), (1, True)):
        stick.take([0.0], [button])
        assert stick.moved == moves


def test_what_the_device_does_not_have_is_named_and_it_does_not_act():
    stick, _ = made(joy_axis=5)
    stick.take([1.0, 1.0], [])
    assert stick.fault == "the joystick has no axis 5; allowed: 0 to 1"
    assert stick.silent
    assert stick.action() == 1
    stick, _ = made((7,), joy_buttons=(-1, 2))
    stick.take([1.0], [0, 1])
    assert stick.fault == "the joystick has no button 7; allowed: 0 to 1"
    stick.take([1.0], [0] * 8)  # the right one is plugged in
    assert not stick.fault
    assert not stick.silent
    stick.take([1.0], [0, 1])  # and another one in its place
    assert stick.silent
    buttons, _ = made(joy_axis=-1, joy_buttons=(0, 2))  # without any axis
    buttons.take([], [0, 1])
    assert buttons.action() == 2


@pytest.mark.parametrize("wrong", [math.nan, math.inf, -1.02, 3.0])
def test_what_is_no_position_is_dropped_and_counted(wrong):
    stick, clock = made(joy_inverted=False)
    stick.take([1.0], [])
    clock.now = 0.4
    stick.take([wrong], [])
    assert stick.dropped == 1
    assert stick.action() == 2  # as it was
    clock.now = 0.6
    assert stick.silent  # nor does it say that somebody is there
    assert stick.action() == 1


def test_of_two_sticks_the_first_counts_until_it_is_silent():
    stick, clock = made(joy_inverted=False, joy_timeout=0.5)
    for n in range(10):
        clock.now += 0.05
        stick.take([1.0], [], "page")
        stick.take([-1.0], [], "pad")
        assert (stick.action(), stick.others) == (2, n + 1)
    clock.now += 0.51
    stick.take([-1.0], [], "pad")
    stick.take([1.0], [], "page")
    assert (stick.action(), stick.others) == (0, 11)
    clock.now += 0.51
    for _ in range(3):  # what is no stick keeps nobody away
        stick.take([math.nan], [], "broken")
        stick.take([1.0], [], "page")
    assert stick.action() == 2


def test_silence_is_neutral_and_nothing_is_pressed():
    stick, clock = made((1,), joy_timeout=0.5)
    assert stick.silent
    stick.take([1.0], [0, 1])
    assert stick.pressed(1)
    clock.now = 0.51
    assert (stick.silent, stick.action(), stick.pressed(1), stick.moved) == (True, 1, False, False)


IN_SPACE = {"joy_axes": (1, 0), "joy_buttons": (9,)}


def in_space(vertical=False, **values):
    task = SlungLoad3D(vertical=vertical).description
    settings = JoystickSettings(**(IN_SPACE | values))
    return task.actions, Joystick(settings, task.actions, task.neutral, (), Clock())


@given(st.floats(0.0, 1.0), st.floats(0.0, math.tau))
def test_two_axes_reach_nine_actions_and_no_release(far, angle):
    """Forward is +x and left is +y, as a pilot looks along +x (REP-103)."""
    actions, stick = in_space()
    left, forward = far * math.sin(angle), far * math.cos(angle)
    stick.take([left, forward], [0])
    whole = [
        0.0 if abs(v) < 0.5 else math.copysign(3.0, v)
        for v in (forward, left)
        if abs(abs(v) - 0.5) > 1e-6
    ]
    if len(whole) == 2:
        assert actions[stick.action()].value == tuple(whole)
    assert actions[stick.action()].name != "release"
    stick.take([left, forward], [1])
    assert actions[stick.action()].name == "release"


def test_a_third_axis_climbs():
    actions, stick = in_space(vertical=True, joy_axes=(1, 0, 3), joy_buttons=(-1,))
    for up, name in ((1.0, "up 0.8 m/s"), (-1.0, "down 0.8 m/s"), (0.05, "0 0 0")):
        stick.take([0.0, 0.0, -1.0, up], [0])
        assert stick.moved == (abs(up) > 0.1)
        assert actions[stick.action()].name in (name, "0 0")


@pytest.mark.parametrize("axes", [(0,), (1, 0, 3)])
def test_axes_that_the_actions_have_no_numbers_for_are_refused(axes):
    with pytest.raises(InputError, match=f"joy_axes has {len(axes)} entries, and .* have 2 num"):
        in_space(joy_axes=axes)


def test_an_axis_that_the_device_does_not_have_is_said():
    _, stick = in_space(joy_axes=(5, 0))
    stick.take([0.0, 0.0], [0] * 10)
    assert stick.fault == "the joystick has no axis 5; allowed: 0 to 1"


def test_a_button_for_an_action_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="joy_buttons has 3; allowed: -1, or an action, 0 to 2"):
        made(joy_buttons=(0, 3))


@given(st.floats(-1.0, 1.0), st.floats(0.0, 0.9))
def test_without_calibration_the_axis_is_what_it_says_outside_its_dead_zone(raw, zone):
    value = JoystickSettings(joy_dead_zone=(zone,)).travel(0, raw)
    assert value == (0.0 if abs(raw) <= zone else raw)


def test_calibration_is_of_each_axis_and_the_last_is_for_those_behind():
    ends = {"joy_low": (-1.0, -0.8), "joy_center": (0.0, 0.2), "joy_high": (1.0, 0.7)}
    for axis in (1, 4):
        settings = JoystickSettings(joy_axis=axis, joy_dead_zone=(0.5, 0.0), **ends)
        travelled = [settings.travel(axis, raw) for raw in (-1.0, -0.8, -0.3, 0.2, 0.45, 0.7, 1.0)]
        assert travelled == pytest.approx([-1.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.0])
    first = JoystickSettings(joy_dead_zone=(0.5, 0.0), **ends)
    assert (first.travel(0, 0.5), first.travel(0, 0.6)) == (0.0, 0.6)


def test_a_trigger_rests_at_its_end_when_it_is_told_so():
    settings = JoystickSettings(joy_center=(1.0,), joy_inverted=False)
    stick = Joystick(settings, ACTIONS[:3], 1, (), Clock())
    chosen = []
    for raw in (1.0, 0.5, 0.1, -0.2, -1.0):
        stick.take([raw], [])
        chosen.append(stick.action())
    assert chosen == [1, 1, 1, 0, 0]


@pytest.mark.parametrize(("low", "center", "high"), [(0.5, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_ends_that_cannot_be_are_refused(low, center, high):
    with pytest.raises(InputError, match="in this order, and the ends apart"):
        JoystickSettings(joy_low=(low,), joy_center=(center,), joy_high=(high,))


class Device:
    """A stick on axis 2 of four, noisy and a little off; a trigger rests at 1; eight buttons."""

    def __init__(self, first=-0.93, last=0.88):
        self.rng = np.random.default_rng(1)
        self.answers = {
            "let go": (0.05, None), "first action": (first, None), "last action": (last, None),
            "action 3": (0.05, 6), "action 4": (0.05, 2), "takes over": (0.05, 5),
        }  # fmt: skip

    def where(self, question):
        stick, button = next(a for words, a in self.answers.items() if words in question)
        axes = self.rng.uniform(-0.01, 0.01, 4) + np.array([0.0, 0.0, stick, 0.99])
        return [float(axis) for axis in axes], [int(n == button) for n in range(8)]


@pytest.mark.parametrize(("first", "last"), [(-0.93, 0.88), (0.9, -1.0)])
def test_a_stick_is_known_by_how_it_moves(first, last):
    device, calibration = Device(first, last), Calibration((3, 4), takeover=True)
    heard = 0
    while calibration.question:
        calibration.take(*device.where(calibration.question))
        heard += 1
        assert heard < 200
    found = calibration.parameters()
    assert (found["joy_axis"], found["takeover_button"]) == (2, 5)
    assert found["joy_buttons"] == [-1, -1, 4, -1, -1, -1, 3]
    del found["takeover_button"]
    settings = JoystickSettings(
        joy_actions=3, **{k: tuple(v) if isinstance(v, list) else v for k, v in found.items()}
    )
    stick = Joystick(settings, ACTIONS, 1, (5,), Clock())
    chosen = []
    for question in device.answers:
        stick.take(*device.where(question))
        chosen.append(stick.action())
    assert chosen == [1, 0, 2, 3, 4, 1]


def test_what_is_no_answer_is_waited_out():
    calibration = Calibration()
    for k in range(50):
        calibration.take([math.sin(k), math.nan if k % 2 else 0.0], [1])
    assert calibration.question == "let go of everything"


@pytest.mark.parametrize("there", [False, True])
def test_the_command_writes_what_the_demonstrator_takes(nodes, ros, tmp_path, there):
    out, log = tmp_path / "stick.yaml", tmp_path / "said"
    if there:
        out.write_text("mine")
    command = [sys.executable, "-m", "iolspi_ros", "joystick", "--out", str(out), "--takeover"]
    with log.open("w") as said:
        process = subprocess.Popen(command, env=nodes.env, stdout=said, stderr=said)
    nodes.processes["joystick"] = process
    peer, device = Peer(ros), Device()
    joy = peer.publisher("joy", Joy)

    def answered():
        lines = [line for line in log.read_text().splitlines() if "Now " in line]
        if lines:
            axes, buttons = device.where(lines[-1])
            joy.publish(Joy(axes=axes, buttons=buttons))
        return process.poll() is not None

    peer.until(answered)
    if there:
        assert process.returncode == 2
        assert "exists already" in log.read_text()
        assert out.read_text() == "mine"
        return
    assert process.returncode == 0, log.read_text()
    nodes.start("simulator")
    nodes.start("demonstrator", "--params-file", str(out))
    nodes.wait_for("demonstrator", "waiting for a joystick")
    assert "does nothing" not in nodes.log("demonstrator")
