"""Load, episodes, joystick and preflight of the bridge."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iolspi_ros.bench.flying import Flying
from iolspi_ros.core.learner import Source
from iolspi_ros.errors import InputError
from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.envelope import Motion
from msg_bridge.mavlink.episode_clock import EpisodeClock
from msg_bridge.mavlink.joystick import SafetyPilotSettings, read_joystick
from msg_bridge.mavlink.load import Fall, LoadObserver, swing
from msg_bridge.mavlink.transit import Transit
from sim_nodes.tasks.slung_load import SlungLoad

TASK = SlungLoad()


def swung(acceleration, seconds, start=(0.0, 0.0)):
    """T Eq. 18 by scipy: angles every 0.02 s."""

    def slope(t, y):
        return [y[1], -(math.cos(y[0]) * acceleration(t) + 9.81 * math.sin(y[0]))]

    times = np.arange(0.0, seconds, 0.02)
    return times, solve_ivp(slope, (0.0, seconds), start, t_eval=times, max_step=0.005).y


def push(t):
    return 3.0 * math.copysign(1.0, math.sin(2.0 * t))


def test_the_swing_follows_from_accelerations_alone():
    observer = LoadObserver(1.0, damping=0.0)
    times, (angles, rates) = swung(push, 5.0)
    for t, angle, rate in zip(times, angles, rates, strict=True):
        assert observer.angle == pytest.approx(angle, abs=0.05)
        assert observer.rate == pytest.approx(rate, abs=0.2)
        observer.move(push(t), 0.02)


def test_a_feed_finds_a_swing_that_nobody_knew_of():
    rng = np.random.default_rng(0)
    observer = LoadObserver(1.0)
    times, (angles, rates) = swung(lambda t: 0.0, 5.0, (0.6, 1.0))
    for k, angle in enumerate(angles):
        if k % 5 == 0:  # 10 Hz
            observer.measure(angle + 0.02 * rng.standard_normal())
        ahead = observer.ahead(0.0, 0.02)
        if times[k] > 1.5 and k + 1 < len(angles):
            assert ahead[0] == pytest.approx(angles[k + 1], abs=0.08)
            assert ahead[1] == pytest.approx(rates[k + 1], abs=0.3)
        observer.move(0.0, 0.02)


def test_a_gust_is_found_also_after_a_minute_in_which_nothing_happened():
    observer = LoadObserver(1.0)
    for k in range(3000):
        if k % 5 == 0:
            observer.measure(0.0)
        observer.move(0.0, 0.02)
    times, (angles, _) = swung(lambda t: 0.0, 3.0, (0.5, 0.0))
    for k, angle in enumerate(angles):
        if k % 5 == 0:
            observer.measure(angle)
        if times[k] > 2.0:
            assert observer.angle == pytest.approx(angle, abs=0.15)
        observer.move(0.0, 0.02)


def test_angles_are_positive_to_the_right():
    assert swing(np.array([0.0, 0.0, -1.0])) == 0.0
    assert swing(np.array([1.0, 0.3, -1.0])) == pytest.approx(math.pi / 4)
    assert swing(np.array([-1.0, 0.0, 0.0])) == pytest.approx(-math.pi / 2)


def test_where_a_releasing_load_crosses_the_rim():
    """A parabola seen ten times a second: the chord is near."""
    fall, rim = Fall(4.0), None
    for t in np.arange(0.0, 1.0, 0.1):
        fall.see(2.0 * t, 4.6 - 4.905 * t**2)
        rim = fall.landing if rim is None else rim
    assert rim == fall.landing  # the first crossing stays
    assert rim == pytest.approx(2.0 * math.sqrt(0.6 / 4.905), abs=0.03)
    below = Fall(4.0)
    below.see(0.0, 3.9)
    below.see(0.0, 3.0)
    assert below.landing is None


def episode():
    return EpisodeClock(TASK, 4, 10.0, np.zeros(4))


def test_an_episode_says_which_action_was_in_force_longest():
    e = episode()
    assert e.answer(0, 2)
    e.hold(1, 0.02)
    e.hold(2, 0.08)
    assert not e.due(10.09)
    assert e.due(10.1)
    seen = e.advance(10.1, np.array([-1.0, 0, 0, 0]))
    assert (seen.episode, seen.step, seen.action, seen.reward) == (4, 1, 2, 0.0)
    assert e.advance(10.2, np.zeros(4)).action == TASK.description.neutral  # nothing was held
    assert e.advance(10.3, np.zeros(4)).reward == 0.0


def test_an_episode_says_who_chose_what_was_in_force():
    """Nobody, where that was another action than the one answered."""
    e = episode()
    assert e.answer(0, 2, Source.HUMAN)
    e.hold(2, 0.1)
    seen = [e.advance(10.1, np.zeros(4))]
    assert e.answer(1, 0, Source.EXPLORE)
    e.hold(2, 0.06)  # the envelope's, or from before the answer
    e.hold(0, 0.04)
    seen.append(e.advance(10.2, np.zeros(4)))
    assert [o.source for o in seen] == [Source.HUMAN, Source.HOLD]


def test_only_answers_to_what_was_shown_count_and_never_backwards():
    e = episode()
    assert not e.answer(1, 2)
    assert e.answer(0, 2)
    assert not e.answer(0, 0)
    for k in range(1, 4):
        e.advance(10.0 + 0.1 * k, np.zeros(4))
    assert e.answer(2, 0)
    assert e.answered_time == pytest.approx(10.2)
    assert not e.answer(1, 0)


def test_a_late_state_leaves_a_number_out():
    e = episode()
    assert e.advance(10.13, np.zeros(4)).step == 1
    assert e.advance(10.31, np.zeros(4)).step == 3
    assert e.advance(10.4, np.zeros(4)).step == 4


def test_walls_cable_and_clock_end_it():
    assert episode().advance(10.1, np.array([3.1, 0, 0, 0])).reward == -150.0
    assert episode().advance(10.1, np.array([0, 0, 1.6, 0])).reward == -50.0
    e = episode()
    cut = e.advance(15.0, np.zeros(4))
    assert (cut.step, cut.terminated, cut.truncated) == (50, False, True)


@pytest.mark.parametrize("landing", [None, -1.6, -1.4, 0.0, 1.4, 1.6])
def test_a_drop_is_judged_where_it_landed(landing):
    inside = landing is not None and abs(landing) < 1.5
    assert TASK.landed(landing) == (100.0 if inside else -10.0)


def test_judging_what_was_flown_is_what_the_task_says():
    rng = np.random.default_rng(0)
    for _ in range(200):
        state = rng.uniform(TASK.description.low, TASK.description.high)
        action = int(rng.integers(3))
        following, reward, terminated = TASK.step(state, action)
        assert TASK.judge(state, following) == (reward, bool(terminated))


def test_transit_brings_a_swinging_load_to_rest_elsewhere():
    transit = Transit(1.0, 0.4)
    x, v, a, angle, rate = 0.0, 0.0, 0.0, 0.8, 0.0
    for _ in range(round(12.0 / 0.02)):
        motion = Motion(x=x, speed=v, swing=angle, swing_rate=rate)
        a += (transit.along(-6.0, motion, 0.02) - a) * 0.02 / 0.3
        x, v = x + v * 0.02, v + a * 0.02
        rate -= (math.cos(angle) * a + 9.81 * math.sin(angle)) * 0.02
        angle += rate * 0.02
        assert abs(v) < 3.0
    assert x == pytest.approx(-6.0, abs=0.1)
    assert max(abs(v), abs(angle), abs(rate)) < 0.1


PERSON = SafetyPilotSettings(deadman_button=0, takeover_button=1)


@pytest.mark.parametrize(
    ("buttons", "axes", "fresh", "deadman", "stick"),
    [
        ([1, 0], [0.5], True, True, None),
        ([0, 0], [0.5], True, False, None),
        ([], [], True, False, None),
        ([1, 0], [0.5], False, False, None),
        ([1, 1], [1.0], True, True, -1.0),
        ([1, 1], [-0.5], True, True, 0.5),
        ([1, 1], [7.0], True, True, -1.0),
        ([1, 1], [math.nan], True, True, 0.0),
        ([1, 1], [], True, True, 0.0),
        ([1, 1], [1.0], False, False, 0.0),  # who flew and fell silent keeps the vehicle, at rest
    ],
)
def test_what_a_person_at_the_joystick_does(buttons, axes, fresh, deadman, stick):
    found = read_joystick(PERSON, buttons, axes, fresh=fresh)
    assert found.deadman is deadman
    assert found.stick == (None if stick is None else pytest.approx(stick))


def test_without_buttons_nobody_is_waited_for():
    assert read_joystick(SafetyPilotSettings(), [], [], fresh=False) == (True, None, False)


def test_an_autopilot_nobody_knows_is_refused():
    with pytest.raises(InputError, match="12 \\(px4\\)"):
        profiles.of_autopilot(99)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"system": 7}, "heard system 1, 2, not 7|heard system 1, not 7"),
        ({"keys": (None, bytes(range(32)))}, "unsigned or wrongly signed"),
        ({"autopilot": {"SIM_LOAD_RATE": 0.0}}, "position of the load"),
        ({"autopilot": {"SIM_SPEEDUP": 2.0}}, "clock goes 2.0"),
    ],
)
def test_a_preflight_that_fails_says_why(tmp_path, options, why):
    flying = Flying(tmp_path, "ardupilot", patience=6.0, **options)
    with pytest.raises(InputError, match=why), flying:
        pass


@pytest.mark.parametrize("like", ["px4", "ardupilot"])
def test_without_its_parameters_nothing_flies(tmp_path, like, monkeypatch):
    profile = profiles.PROFILES[like]
    changes = (*profile.changes, profiles.ParameterChange(("NOT_THERE",), 1.0, "to see"))
    monkeypatch.setitem(profiles.PROFILES, like, replace(profile, changes=changes))
    flying = Flying(tmp_path, like)
    with pytest.raises(InputError, match=r"NOT_THERE .*cannot be read; without it nothing"), flying:
        pass


def test_what_a_killed_bridge_had_changed_the_next_one_gives_back(tmp_path):
    with Flying(tmp_path, "px4") as killed:
        values = killed.autopilot.parameters
        assert values["COM_OF_LOSS_T"] == 0.5
        killed.preflight.run()  # another bridge, on the same vehicle and the same memory
        assert not killed.preflight.restore()
        assert values["COM_OF_LOSS_T"] == 1.0
        assert values["COM_OBL_RC_ACT"] == 0
