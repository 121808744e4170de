"""Phases of a demonstration by a person, and verdicts on what was flown."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.core.samples import Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings
from iolspi_ros.nodes.piloting import Flown, Piloting, PilotingSettings
from iolspi_ros.task import Action
from iolspi_ros.wire import Phase


class Scene:
    """A stick, a clock, and the phases that come of them."""

    def __init__(self, n_episodes=3, **settings):
        self.now = 0.0
        self.stick = Joystick(
            JoystickSettings(), [Action(name) for name in "abc"], 1, (), lambda: self.now
        )
        self.piloting = Piloting(
            PilotingSettings(**settings), n_episodes, self.stick, lambda: self.now
        )

    def hear(self, axis, seconds=0.1):
        self.now += seconds
        self.stick.take([axis], [])
        self.piloting.look()
        return self.piloting.phase

    def wait(self, seconds):
        self.now += seconds
        self.piloting.look()
        return self.piloting.phase

    def take_off(self):
        self.hear(0.0)
        self.hear(1.0)
        self.piloting.begin()


def flown(episode, marked=""):
    t = Transition(np.zeros(2), 1, 0.0, np.zeros(2))
    return Flown(episode, samples=[(Sample(episode, 7, 70, t, 2), b"")], marked=marked)


def test_it_begins_at_a_movement_after_a_countdown():
    scene = Scene(countdown=2.0)
    assert scene.wait(5.0) is Phase.NO_STICK
    assert scene.hear(0.6) is Phase.WAITING  # wherever it rests
    assert {scene.hear(0.62) for _ in range(100)} == {Phase.WAITING}
    assert not scene.piloting.holds
    assert scene.hear(0.0) is Phase.COUNTDOWN
    assert scene.piloting.holds
    for left in (1.5, 1.0, 0.5):
        scene.hear(0.0, 0.5)
        assert scene.piloting.countdown == pytest.approx(left)
        assert not scene.piloting.ready
    scene.hear(0.0, 0.5)
    assert scene.piloting.ready
    scene.piloting.begin()
    assert scene.piloting.phase is Phase.FLYING


def test_a_stick_lost_before_the_flight_begins_all_over():
    scene = Scene(countdown=5.0)
    scene.hear(0.0)
    assert scene.hear(1.0) is Phase.COUNTDOWN
    assert scene.wait(0.6) is Phase.NO_STICK
    assert scene.hear(1.0) is Phase.WAITING
    assert scene.hear(1.0) is Phase.WAITING  # where it is now is its rest
    assert scene.hear(0.5) is Phase.COUNTDOWN


def test_silence_in_flight_pauses_and_the_episode_is_not_kept_by_itself():
    scene = Scene(countdown=0.0)
    scene.take_off()
    assert scene.wait(0.6) is Phase.PAUSED
    assert scene.hear(1.0) is Phase.PAUSED  # until the episode has ended
    assert scene.piloting.landed(flown(0, "silent")) is False
    assert scene.piloting.phase is Phase.WAITING
    assert (scene.piloting.kept, scene.piloting.discarded) == (0, 1)
    assert scene.hear(-1.0) is Phase.COUNTDOWN


def test_it_ends_when_enough_is_kept():
    scene = Scene(n_episodes=2, countdown=0.0)
    scene.take_off()
    assert scene.piloting.landed(flown(0)) is True
    assert scene.piloting.phase is Phase.FLYING  # one after the other
    assert scene.piloting.landed(flown(1)) is True
    assert scene.piloting.phase is Phase.ENDED
    assert scene.hear(0.0) is Phase.ENDED


def test_one_that_was_broken_off_is_kept_and_does_not_count():
    scene = Scene(n_episodes=1, countdown=0.0)
    scene.take_off()
    assert scene.piloting.landed(flown(0), whole=False) is True
    assert (scene.piloting.phase, scene.piloting.kept) == (Phase.FLYING, 0)
    assert scene.piloting.landed(flown(1)) is True
    assert scene.piloting.phase is Phase.ENDED


def test_verdicts_and_taking_them_back():
    scene = Scene(review=True, countdown=0.0)
    piloting = scene.piloting
    for episode in (4, 5, 6):
        scene.hear(0.0)
        scene.hear(1.0)
        piloting.begin()
        assert piloting.landed(flown(episode)) is None
        assert piloting.phase is Phase.REVIEW
        assert piloting.judge(episode != 5).episode == episode
        assert piloting.phase is Phase.COUNTDOWN
    assert (piloting.kept, piloting.discarded) == (2, 1)
    assert [piloting.undo() for _ in range(2)] == [
        (piloting.undecided[0], True), (piloting.undecided[1], False)
    ]  # fmt: skip
    assert piloting.phase is Phase.REVIEW
    assert piloting.judge(True).episode == 5  # was discarded
    assert piloting.phase is Phase.REVIEW  # one is left
    assert piloting.judge(False).episode == 6
    assert [f.episode for f in piloting.finish()] == [4, 5]
    assert piloting.phase is Phase.ENDED
    for refused in (piloting.undo, piloting.finish, lambda: piloting.judge(True)):
        with pytest.raises(InputError, match="has ended"):
            refused()


def test_a_verdict_taken_back_in_flight_waits_for_the_landing():
    scene = Scene(review=True, countdown=0.0)
    scene.take_off()
    scene.piloting.landed(flown(0))
    scene.piloting.judge(True)
    scene.piloting.begin()
    scene.piloting.undo()
    assert scene.piloting.phase is Phase.FLYING
    scene.piloting.landed(flown(1))
    assert [scene.piloting.judge(True).episode for _ in range(2)] == [1, 0]


def test_verdicts_without_review_or_episode_are_refused():
    piloting = Scene().piloting
    with pytest.raises(InputError, match="review is false; allowed: review:=true"):
        piloting.judge(True)
    piloting = Scene(review=True).piloting
    with pytest.raises(InputError, match="no episode waits for a verdict"):
        piloting.judge(False)
    with pytest.raises(InputError, match="there was no verdict yet"):
        piloting.undo()
    with pytest.raises(InputError, match="no episode is kept"):
        piloting.finish()


@given(st.lists(st.sampled_from(["fly", "keep", "discard", "undo"]), max_size=60))
def test_each_episode_is_decided_once_whatever_is_pressed(presses):
    """Beside a list of verdicts by hand: a stack of those decided, one of those that are not."""
    scene = Scene(review=True, countdown=0.0)
    piloting, open_ones, verdicts, episode = scene.piloting, [], [], 0
    for press in presses:
        try:
            if press == "fly":
                piloting.landed(flown(episode))
                open_ones.append(episode)
                episode += 1
            elif press == "undo":
                piloting.undo()
                open_ones.append(verdicts.pop()[0])
            else:
                piloting.judge(press == "keep")
                verdicts.append((open_ones.pop(), press == "keep"))
        except InputError:
            assert not (verdicts if press == "undo" else open_ones)
    assert [(f.episode, kept) for f, kept in piloting.judged] == verdicts
    assert piloting.kept == sum(kept for _, kept in verdicts)
    assert piloting.discarded == len(verdicts) - piloting.kept
    assert [f.episode for f in piloting.undecided] == open_ones
    assert sorted(open_ones + [e for e, _ in verdicts]) == list(range(episode))
