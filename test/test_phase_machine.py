"""Which phase follows which: inputs in, decisions out."""

import numpy as np
import pytest
from motions import moved, moving

from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.flown import flown
from msg_bridge.mavlink.payload import PayloadReport
from msg_bridge.mavlink.phase_machine import Inputs, PhaseMachine
from msg_bridge.mavlink.phases import Command, Enter, Phase, Show, Tell
from msg_bridge.mavlink.settings import FlightSettings
from sim_nodes.tasks.slung_load import DUNK, RELEASE, SlungLoad

TASK = flown(SlungLoad(), FlightSettings())
BRIDGE = Inputs(0.0, Authority.BRIDGE)
UP = moving(height=5.0)


def machine(stream_first=True, **settings):
    return PhaseMachine(TASK, FlightSettings(**settings), stream_first=stream_first)


def commands(decisions):
    return [decision for decision in decisions if isinstance(decision, Command)]


def entered(decisions):
    return [decision.phase for decision in decisions if isinstance(decision, Enter)]


def shown(decisions):
    return [decision.observation for decision in decisions if isinstance(decision, Show)]


def told(decisions, level="info"):
    return [d.text for d in decisions if isinstance(d, Tell) and d.level == level]


def hovering(**settings):
    """On the way to the first start, at 10 s."""
    m = machine(**settings)
    m.begin(0.0)
    m.step(BRIDGE._replace(now=2.0))
    assert entered(m.step(BRIDGE._replace(now=10.0, motion=UP))) == [Phase.TRANSIT]
    return m


def there(m, now, **motion):
    return BRIDGE._replace(now=now, motion=moved(UP, x=m.target[0], **motion))


def flying(**settings):
    """In an episode that begins at 10.6 s."""
    m = hovering(**settings)
    m.step(there(m, 10.0))
    decisions = m.step(there(m, 10.6))
    assert entered(decisions) == [Phase.EPISODE]
    assert Command.START_EPISODE in decisions
    first = shown(decisions)[0]
    assert (first.episode, first.step, first.stamp) == (m.number, 0, 10_600_000_000)
    return m


def acting(m, now, **changed):
    seen = there(m, now)._replace(authority=Authority.ACTOR)
    return m.step(seen._replace(**changed))


# ------------------------------------------------------------ to the first episode


def test_mode_then_motors_are_asked_for_once_a_second_after_setpoints_have_come():
    m = machine()
    assert m.begin(5.0) == [Enter(Phase.ARMING)]
    waiting = BRIDGE._replace(armed=False, controlled=False)
    asked = []
    for now in np.arange(5.0, 9.9, 0.02):
        asked += [(now, c) for c in commands(m.step(waiting._replace(now=now)))]
    assert {c for _, c in asked} == {Command.SET_GROUND, Command.REQUEST_CONTROL}
    times = [now for now, c in asked if c is Command.REQUEST_CONTROL]
    assert times == pytest.approx([6.02, 7.04, 8.06, 9.08], abs=0.03)
    decisions = m.step(waiting._replace(now=11.0, controlled=True))
    assert commands(decisions) == [Command.SET_GROUND, Command.ARM]
    assert told(decisions, "delay") == ["the autopilot has not accepted arming"]
    assert entered(m.step(BRIDGE._replace(now=11.5))) == [Phase.TAKEOFF]


def test_in_the_air_the_ground_stays_where_it_was():
    m = machine()
    m.begin(0.0)
    assert commands(m.step(BRIDGE._replace(now=0.1, controlled=False))) == []


@pytest.mark.parametrize("stream_first", [True, False])
def test_a_climb_is_asked_for_where_the_autopilot_climbs_by_command(stream_first):
    m = machine(stream_first)
    m.begin(0.0)
    m.step(BRIDGE._replace(now=2.0))
    asked = [commands(m.step(BRIDGE._replace(now=t))) for t in (2.1, 5.2, 10.0, 10.2)]
    once = [] if stream_first else [Command.TAKE_OFF]
    assert asked == [once, [], [], once]
    off = BRIDGE._replace(now=19.0, motion=moving(height=0.6))
    assert commands(m.step(off)) == []  # it has left the ground
    for wrong in (moving(height=4.5), moving(height=5.5), moving(height=5.0, climb=0.6)):
        assert not entered(m.step(off._replace(motion=wrong)))
    assert entered(m.step(off._replace(motion=moving(height=4.7, climb=0.4)))) == [Phase.TRANSIT]


@pytest.mark.parametrize(
    "wrong",
    [{"speed": 0.2}, {"across": 0.5}, {"height": 4.3}, {"height": 5.7}, {"swing": -0.09},
     {"swing_rate": 0.3}, {"x": 0.2}],
)  # fmt: skip
def test_an_episode_begins_at_rest_at_its_start(wrong):
    m = hovering()
    away = {name: value + (m.target[0] if name == "x" else 0.0) for name, value in wrong.items()}
    m.step(there(m, 10.0))
    m.step(BRIDGE._replace(now=10.4, motion=moved(there(m, 0.0).motion, **away)))
    assert not entered(m.step(there(m, 10.6)))  # the half second begins anew
    assert not entered(m.step(there(m, 10.8)))
    assert entered(m.step(there(m, 11.0))) == [Phase.EPISODE]


@pytest.mark.parametrize("order", ["sweep", "random"])
def test_starts_are_swept_or_drawn_again_the_same_after_a_reset(order):
    m, now, targets = hovering(order=order, seed=4), 10.0, []
    for n in range(6):
        targets.append(m.target[0])
        for _ in range(2):
            m.step(there(m, now))
            now += 1.0
        assert m.answer(m.number, 0, 1)
        acting(m, now, motion=UP._replace(x=9.0))  # into the wall: the end
        assert m.phase is Phase.BRAKE
        if n == 2:
            m.reset(now, TASK, m.settings)
        m.step(BRIDGE._replace(now=now + 1.0))
        now += 2.0
    assert targets[:3] == targets[3:]
    assert len(set(targets)) == 3
    if order == "sweep":
        assert targets == 2 * np.linspace(-6.0, 0.0, 13)[:3].tolist()


# ------------------------------------------------------------ an episode


def test_states_are_shown_at_their_times_and_the_last_one_ends_it():
    m = flying(episodes=1)
    assert m.answer(m.number, 0, 2)
    assert not shown(acting(m, 10.69))
    m.pass_time(0.1, 2)
    (second,) = shown(acting(m, 10.7))
    assert (second.step, second.action, second.last) == (1, 2, False)
    decisions = acting(m, 10.8, motion=UP._replace(x=9.0))
    (last,) = shown(decisions)
    assert (last.step, last.terminated) == (2, True)
    assert entered(decisions) == [Phase.BRAKE]
    assert (m.flown, m.abandoned) == (1, 0)
    assert not entered(m.step(BRIDGE._replace(now=10.95)))  # it may only seem to stand
    assert not entered(m.step(BRIDGE._replace(now=11.2, motion=moving(speed=0.4))))
    decisions = m.step(BRIDGE._replace(now=11.3))
    assert told(decisions) == ["land: 1 episodes flown"]
    assert entered(decisions) == [Phase.LANDING]


def test_only_answers_to_this_episode_count():
    m = flying()
    assert not m.answer(m.number + 1, 0, 1)
    assert not m.answer(m.number, 1, 1)
    assert m.answer(m.number, 0, 1)
    m.step(BRIDGE._replace(now=10.8, authority=Authority.HOLD))
    assert not m.answer(m.number, 0, 2)


def test_a_release_ends_with_the_reward_of_where_the_load_came_down():
    m = flying()
    m.answer(m.number, 0, RELEASE)
    state = moving(x=1.0, speed=2.0, height=5.0, swing=0.3, swing_rate=0.4)
    assert m.release(10.65, state) == [Command.RELEASE, Enter(Phase.RELEASE)]
    assert not m.answer(m.number, 0, 1)
    open_still = BRIDGE._replace(now=10.7, payload=PayloadReport(gone=True))
    assert m.step(open_still) == []
    decisions = m.step(open_still._replace(payload=PayloadReport(gone=True, reward=DUNK)))
    (end,) = shown(decisions)
    assert (end.reward, end.action, end.terminated) == (DUNK, RELEASE, True)
    assert end.state == pytest.approx([1.0, 2.0, 0.3, 0.4])
    assert (m.flown, m.phase) == (1, Phase.BRAKE)
    gone = BRIDGE._replace(now=11.0, payload=PayloadReport(gone=True))
    assert m.step(gone) == [Command.RELOAD, Enter(Phase.RELOAD)]
    lacking = gone._replace(payload=PayloadReport(gone=True, lacking="nobody comes"))
    assert told(m.step(lacking), "delay") == ["waiting for a load: nobody comes"]
    done = gone._replace(payload=PayloadReport(reloaded=True))
    assert entered(m.step(done)) == [Phase.TRANSIT]


def test_a_release_that_fails_breaks_the_episode_off():
    m = flying()
    m.answer(m.number, 0, RELEASE)
    m.release(10.65, UP)
    decisions = m.step(BRIDGE._replace(now=10.7, payload=PayloadReport(failure="stuck")))
    assert told(decisions, "warning") == ["stuck"]
    assert entered(decisions) == [Phase.BRAKE]
    assert not shown(decisions)
    assert (m.flown, m.abandoned) == (0, 1)


# ------------------------------------------------------------ what breaks it off


@pytest.mark.parametrize("authority", [Authority.HOLD, Authority.PILOT, Authority.OTHER])
def test_whoever_takes_over_ends_the_episode_without_a_word(authority):
    m = flying()
    m.answer(m.number, 0, 1)
    decisions = acting(m, 10.65, authority=authority)
    assert decisions == [Enter(Phase.BRAKE)]
    assert (m.flown, m.abandoned) == (0, 1)
    assert m.step(BRIDGE._replace(now=10.7, authority=authority)) == []


def test_nobody_is_waited_for_at_the_same_start_with_a_new_episode_a_second():
    m = flying(seed=1)
    target, numbers = m.target, [m.number]
    now = 10.6
    while now < 20.0:
        now += 0.02
        silent = m.phase is Phase.EPISODE and now - m.episode.start > 0.3
        authority = Authority.HOLD if silent else Authority.BRIDGE
        m.pass_time(0.02, 1)
        m.step(there(m, now)._replace(authority=authority))
        if m.number != numbers[-1]:
            numbers.append(m.number)
    assert m.target == target
    assert m.abandoned == 0  # nobody had begun
    assert len(numbers) == pytest.approx(9.4 / 1.3, abs=1.0)
    assert m.unanswered == pytest.approx(now - 10.6, rel=0.1)
    m.step(there(m, now + 2.0))
    assert m.answer(m.number, 0, 1)
    assert m.unanswered == 0.0


def test_who_holds_the_vehicle_is_not_taken_for_nobody():
    m = flying()
    for k in range(100):
        m.step(BRIDGE._replace(now=10.6 + k, authority=Authority.PILOT))
        m.pass_time(1.0, 1)
    assert m.unanswered <= 1.0


def test_who_is_waited_for_with_a_load_is_not_taken_for_nobody():
    m = flying()
    m.answer(m.number, 0, RELEASE)
    m.release(10.65, UP)
    gone = PayloadReport(gone=True)
    m.step(BRIDGE._replace(now=10.7, payload=gone._replace(failure="no answer")))
    assert entered(m.step(BRIDGE._replace(now=11.0, payload=gone))) == [Phase.RELOAD]
    for k in range(100):
        m.pass_time(1.0, 1)
        m.step(BRIDGE._replace(now=12.0 + k, payload=gone))
    assert m.unanswered <= 1.0
    assert entered(m.step(BRIDGE._replace(now=200.0, payload=gone._replace(reloaded=True))))


def test_on_the_ground_by_somebody_elses_hand_a_person_decides():
    m = flying()
    decisions = acting(m, 10.7, authority=Authority.OTHER, armed=False)
    assert entered(decisions)[-1] is Phase.DOWN
    assert "activate the bridge again" in told(decisions, "warning")[0]
    assert not m.in_flight
    assert m.land(11.0, "late") == []


def test_begun_again_nobody_has_been_waited_for():
    m = flying()
    m.pass_time(61.0, 1)
    assert m.unanswered == 61.0
    acting(m, 80.0, authority=Authority.LAND, reason="nobody")
    m.step(BRIDGE._replace(now=90.0, authority=Authority.LAND, armed=False))
    assert m.begin(100.0) == [Enter(Phase.ARMING)]
    assert m.unanswered == 0.0


def test_landing_is_asked_for_until_it_is_down():
    m = flying()
    decisions = m.land(10.7, "enough")
    assert entered(decisions) == [Phase.BRAKE, Phase.LANDING]
    assert told(decisions) == ["land: enough"]
    assert m.landing_reason == "enough"
    assert m.land(10.8, "again") == []
    ask = BRIDGE._replace(authority=Authority.LAND)
    asked = [commands(m.step(ask._replace(now=now))) for now in (11.0, 11.5, 12.1)]
    assert asked == [[Command.REQUEST_LANDING], [], [Command.REQUEST_LANDING]]
    assert commands(m.step(ask._replace(now=14.0, landing=True))) == []
    decisions = m.step(ask._replace(now=15.0, landing=True, armed=False))
    assert (entered(decisions), told(decisions)) == ([Phase.DOWN], ["landed"])


def test_the_arbiter_may_land_it_too():
    m = flying()
    decisions = acting(m, 10.7, authority=Authority.LAND, reason="lost")
    assert entered(decisions) == [Phase.BRAKE, Phase.LANDING]
    assert m.landing_reason == "lost"
