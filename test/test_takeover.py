"""Who may act, decided at the vehicle's side."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.core.learner import Source
from iolspi_ros.takeover import LOOK, Listening, Takeover

OTHERS = (Source.EXPLOIT, Source.EXPLORE, Source.SCRIPTED, Source.SHIELD, -1, 99)
SEEN, NEXT = (3, 7), (3, 8)


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def takeover(clock):
    return Takeover(clock)


def test_while_it_is_held_a_person_alone_acts(takeover, clock):
    assert all(takeover.takes(source, False, SEEN) for source in OTHERS)
    takeover.hear(True, SEEN)
    assert takeover.held
    assert takeover.takes(Source.HUMAN, False, SEEN)
    assert takeover.takes(Source.CORRUPTED, False, SEEN)
    assert not any(takeover.takes(source, neutral, SEEN) for source in OTHERS for neutral in (0, 1))
    assert takeover.takes(Source.HOLD, True, SEEN)
    assert not takeover.takes(Source.HOLD, False, SEEN)
    takeover.hear(False, SEEN)
    assert takeover.takes(Source.EXPLOIT, False, SEEN)


def test_who_is_silent_holds_nothing(takeover, clock):
    takeover.hear(True, SEEN)
    for _ in range(10):
        clock.now += 0.29
        assert takeover.held
        takeover.hear(True, SEEN)
    clock.now += 0.31
    assert not takeover.held
    assert takeover.takes(Source.EXPLORE, False, SEEN)
    assert not takeover.silent(NEXT)  # it is not held, so nobody's neutral action is due
    assert takeover.count == 1
    takeover.hear(True, SEEN)
    assert takeover.count == 2


def test_neutral_is_due_when_the_person_has_not_acted_for_so_long(takeover, clock):
    takeover.hear(True, SEEN)
    for _ in range(5):
        clock.now += 0.2
        takeover.hear(True, SEEN)
        assert not takeover.silent(NEXT)
        takeover.takes(Source.HUMAN, False, SEEN)
    clock.now += 0.2
    takeover.hear(True, SEEN)
    takeover.takes(Source.HOLD, True, SEEN)  # is nobody's
    clock.now += 0.11
    assert takeover.silent(NEXT)
    takeover.takes(Source.HUMAN, True, SEEN)
    assert not takeover.silent(NEXT)


def test_in_slow_motion_nobody_is_waited_for_who_has_answered_what_is_shown(takeover, clock):
    takeover.hear(True, SEEN)
    takeover.takes(Source.HUMAN, False, NEXT)
    for _ in range(20):
        clock.now += 0.2
        takeover.hear(True, SEEN)
        assert not takeover.silent(NEXT)
    assert takeover.silent((3, 9))  # shown after so long, and not answered yet


def test_who_acts_after_giving_back_has_it_before_the_word_is_heard(takeover, clock):
    """And what was on its way when they gave it back takes nothing."""
    assert takeover.takes(Source.HUMAN, False, (0, 0))  # whoever never says anything, too
    assert takeover.held
    takeover.hear(False, SEEN)
    for late in (SEEN, (3, 6), (2, 100)):
        assert takeover.takes(Source.HUMAN, False, late)
        assert not takeover.held
    assert takeover.takes(Source.HUMAN, False, (3, 8))
    assert not takeover.takes(Source.EXPLOIT, False, (3, 8))
    clock.now += 0.29
    takeover.takes(Source.HUMAN, False, (4, 0))  # as good as a word
    clock.now += 0.29
    assert takeover.held
    assert takeover.count == 2
    clock.now += 0.02
    assert not takeover.held


def test_a_script_with_corrupted_actions_holds_nothing(takeover):
    for step in range(9):
        source = (Source.SCRIPTED, Source.CORRUPTED)[step % 2]
        assert takeover.takes(source, False, (0, step))
        assert not takeover.held


@given(st.lists(st.tuples(st.floats(0.0, 0.5), st.sampled_from([True, False, None])), max_size=30))
def test_it_is_held_by_its_last_word_and_for_no_longer_than_that_is_fresh(words):
    clock = Clock()
    takeover, last, when = Takeover(clock), False, 0.0
    for wait, word in words:
        clock.now += wait
        if word is not None:
            takeover.hear(word, SEEN)
            last, when = word, clock.now
        assert takeover.held == (last and clock.now - when <= 0.3)


@given(st.floats(0.5, 100.0), st.floats(0.0, 0.1))
def test_who_could_not_be_heard_was_not_silent(computed, age):
    """The vehicle's process computed; what was said meanwhile still waits."""
    clock = Clock()
    listening = Listening(clock)
    takeover = Takeover(listening)
    takeover.hear(True, SEEN)
    clock.now += age
    listening.look()
    clock.now += computed
    assert takeover.held
    listening.look()
    assert takeover.held
    for _ in range(8):  # and then it is silent indeed
        clock.now += LOOK
        listening.look()
    assert not takeover.held
