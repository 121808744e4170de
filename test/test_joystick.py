"""What a stick says, and when it cannot be trusted."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.errors import InputError
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


def made(needed=(), **values):
    clock = Clock()
    return Joystick(JoystickSettings(**values), 3, 1, needed, clock), clock


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


def test_silence_is_neutral_and_nothing_is_pressed():
    stick, clock = made((1,), joy_timeout=0.5)
    assert stick.silent
    stick.take([1.0], [0, 1])
    assert stick.pressed(1)
    clock.now = 0.51
    assert (stick.silent, stick.action(), stick.pressed(1), stick.moved) == (True, 1, False, False)


def test_a_button_for_an_action_that_there_is_not_is_refused():
    with pytest.raises(InputError, match="joy_buttons has 3; allowed: -1, or an action, 0 to 2"):
        made(joy_buttons=(0, 3))


@given(st.floats(-1.0, 1.0), st.floats(0.0, 0.9))
def test_without_calibration_the_axis_is_what_it_says_outside_its_dead_zone(raw, zone):
    value = JoystickSettings(joy_dead_zone=(zone,)).travel(raw)
    assert value == (0.0 if abs(raw) <= zone else raw)


def test_calibration_is_of_each_axis_and_the_last_is_for_those_behind():
    ends = {"joy_low": (-1.0, -0.8), "joy_center": (0.0, 0.2), "joy_high": (1.0, 0.7)}
    for axis in (1, 4):
        settings = JoystickSettings(joy_axis=axis, joy_dead_zone=(0.5, 0.0), **ends)
        travelled = [settings.travel(raw) for raw in (-1.0, -0.8, -0.3, 0.2, 0.45, 0.7, 1.0)]
        assert travelled == pytest.approx([-1.0, -1.0, -0.5, 0.0, 0.5, 1.0, 1.0])
    first = JoystickSettings(joy_dead_zone=(0.5, 0.0), **ends)
    assert (first.travel(0.5), first.travel(0.6)) == (0.0, 0.6)


def test_a_trigger_rests_at_its_end_when_it_is_told_so():
    settings = JoystickSettings(joy_center=(1.0,), joy_inverted=False)
    stick = Joystick(settings, 3, 1, (), Clock())
    chosen = []
    for raw in (1.0, 0.5, 0.1, -0.2, -1.0):
        stick.take([raw], [])
        chosen.append(stick.action())
    assert chosen == [1, 1, 1, 0, 0]


@pytest.mark.parametrize(("low", "center", "high"), [(0.5, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_ends_that_cannot_be_are_refused(low, center, high):
    with pytest.raises(InputError, match="in this order, and the ends apart"):
        JoystickSettings(joy_low=(low,), joy_center=(center,), joy_high=(high,))
