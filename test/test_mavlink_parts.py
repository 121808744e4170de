"""Load, episodes, joystick and preflight of the bridge."""

import math
from dataclasses import replace

import numpy as np
import pytest
from motions import moving
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from iolspi_ros.bench.flying import Flying
from iolspi_ros.core.learner import Source
from iolspi_ros.errors import InputError
from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.episode_clock import EpisodeClock
from msg_bridge.mavlink.flown import flown
from msg_bridge.mavlink.joystick import SafetyPilotSettings, read_joystick
from msg_bridge.mavlink.load import Fall, LoadObserver
from msg_bridge.mavlink.motion import Motion
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.transit import Transit
from sim_nodes.quadrotor.airframe import AIRFRAMES, Payload
from sim_nodes.quadrotor.body import LOAD, POSITION, VELOCITY, hovering
from sim_nodes.quadrotor.control import ACCELERATION, MEMORY, Gains, begin
from sim_nodes.quadrotor.flight import fly_all
from sim_nodes.tasks.slung_load import SlungLoad

TASK = SlungLoad()


def swung(acceleration, seconds, start=(0.0, 0.0)):
    """T Eq. 18 by scipy: angles every 0.02 s."""

    def slope(t, y):
        return [y[1], -(math.cos(y[0]) * acceleration(t) + 9.81 * math.sin(y[0]))]

    times = np.arange(0.0, seconds, 0.02)
    return times, solve_ivp(slope, (0.0, seconds), start, t_eval=times, max_step=0.005).y


EAST = np.array([1.0, 0.0, 0.0])


def hung(angle):
    """From the vehicle to a load that swings along x [m]."""
    return np.array(moving(swing=angle).cable)


def seen(observer):
    """The angle along x, and its rate."""
    return Motion(cable=tuple(observer.direction), cable_rate=tuple(observer.rate)).plane(0)[2:]


def push(t):
    return 3.0 * math.copysign(1.0, math.sin(2.0 * t))


def test_the_swing_follows_from_accelerations_alone():
    observer = LoadObserver(1.0, damping=0.0)
    times, (angles, rates) = swung(push, 5.0)
    for t, angle, rate in zip(times, angles, rates, strict=True):
        assert seen(observer) == (
            pytest.approx(angle, abs=0.05), pytest.approx(rate, abs=0.2)
        )  # fmt: skip
        observer.move(push(t) * EAST, 0.02)


def test_a_feed_finds_a_swing_that_nobody_knew_of():
    rng = np.random.default_rng(0)
    observer = LoadObserver(1.0)
    times, (angles, rates) = swung(lambda t: 0.0, 5.0, (0.6, 1.0))
    for k, angle in enumerate(angles):
        if k % 5 == 0:  # 10 Hz
            observer.measure(hung(angle + 0.02 * rng.standard_normal()))
        cable, turning = observer.ahead(np.zeros(3), 0.02)
        if times[k] > 1.5 and k + 1 < len(angles):
            ahead = Motion(cable=tuple(cable), cable_rate=tuple(turning)).plane(0)
            assert ahead.swing == pytest.approx(angles[k + 1], abs=0.08)
            assert ahead.swing_rate == pytest.approx(rates[k + 1], abs=0.3)
        observer.move(np.zeros(3), 0.02)


def test_a_gust_is_found_also_after_a_minute_in_which_nothing_happened():
    observer = LoadObserver(1.0)
    for k in range(3000):
        if k % 5 == 0:
            observer.measure(hung(0.0))
        observer.move(np.zeros(3), 0.02)
    times, (angles, _) = swung(lambda t: 0.0, 3.0, (0.5, 0.0))
    for k, angle in enumerate(angles):
        if k % 5 == 0:
            observer.measure(hung(angle))
        if times[k] > 2.0:
            assert seen(observer)[0] == pytest.approx(angle, abs=0.15)
        observer.move(np.zeros(3), 0.02)


@pytest.mark.parametrize("feed", [0, 5])
def test_the_swing_along_both_axes_is_that_of_the_true_body(feed):
    """Of six degrees of freedom, under its controller; known only by its accelerations or a feed.

    Without a feed the observer begins with the truth: it hears of nothing else.
    """
    frame, payload = AIRFRAMES["utility"], Payload(0.1, 1.0, 0.0)
    state, memory = hovering(frame, payload, (0.0, 0.0, 5.0), (0.3, -0.2)), np.zeros(MEMORY)
    begin(state, payload.mass / frame.mass, memory)
    observer, rng = LoadObserver(1.0, damping=0.0 if not feed else 0.05), np.random.default_rng(0)
    if not feed:
        observer.direction = state[LOAD] - state[POSITION]
    off, swung_by = [], []
    for k in range(400):
        sticks = np.array([[2.0 * math.sin(0.06 * k), 2.0 * math.cos(0.045 * k), 0.0, 0.0]])
        before = state[VELOCITY].copy()
        fly_all(state[None], memory[None], ACCELERATION, sticks, np.zeros(3), Gains(), frame,
                payload, 4)  # fmt: skip
        observer.move((state[VELOCITY] - before) / 0.02, 0.02)
        cable = (state[LOAD] - state[POSITION]) / payload.length
        if feed and k % feed == 0:
            observer.measure(cable + 0.02 * rng.standard_normal(3))
        if not feed or k > 75:
            off.append(observer.direction - cable)
        swung_by.append(np.abs(cable[:2]))
        assert np.linalg.norm(observer.direction) == pytest.approx(1.0, abs=1e-9)
        assert observer.rate @ observer.direction == pytest.approx(0.0, abs=1e-9)
    assert (np.max(swung_by, axis=0) > 0.25).all()
    assert np.abs(off).max() < 0.08


@pytest.mark.parametrize("wrong", [1.0, 0.7, 1.3])
def test_an_accelerometer_finds_a_swing_that_nobody_knew_of(wrong):
    """On the true body: with noise, an offset, drag that has to be learned, and a wrong mass.

    Where the mass is right, the covariance is honest: the normalised squared error is about 1.
    """
    frame, payload = AIRFRAMES["utility"]._replace(drag_across=0.8), Payload(0.3, 1.0, 0.02)
    rng, off, honest = np.random.default_rng(5), [], []
    for start in ((0.4, -0.3), (-0.5, 0.1)):
        state, memory = hovering(frame, payload, (0.0, 0.0, 5.0), start), np.zeros(MEMORY)
        begin(state, payload.mass / frame.mass, memory)
        observer = LoadObserver(1.0, wrong * payload.mass / frame.mass)
        for k in range(500):
            sticks = np.array([[2.0 * math.sin(0.06 * k), 2.0 * math.cos(0.045 * k), 0.0, 0.0]])
            before = state[VELOCITY].copy()
            fly_all(state[None], memory[None], ACCELERATION, sticks, np.zeros(3), Gains(), frame,
                    payload, 4)  # fmt: skip
            axes = Rotation.from_quat(state[6:10], scalar_first=True).as_matrix().T
            force = (state[VELOCITY] - before) / 0.02 + (0.0, 0.0, 9.81)
            force = force + axes[:2].T @ (0.1 * rng.standard_normal(2) + (0.1, 0.0))
            observer.move(force - (0.0, 0.0, 9.81), 0.02, 0.1)
            observer.feel(force, axes[:2], state[VELOCITY])
            cable = (state[LOAD] - state[POSITION]) / payload.length
            if k > 200:
                error = (observer.direction - cable)[:2]
                off.append(error)
                honest.append(error @ np.linalg.solve(observer.covariance[:2, :2], error) / 2.0)
    assert np.sqrt(np.mean(np.square(off))) < (0.06 if wrong == 1.0 else 0.12)
    assert wrong != 1.0 or 0.2 < np.mean(honest) < 2.0
    assert wrong != 1.0 or observer.drag == pytest.approx(0.8, abs=0.2)
    assert np.linalg.eigvalsh(observer.covariance).min() > -1e-9


def test_without_a_share_an_accelerometer_tells_nothing_of_the_load():
    observer = LoadObserver(1.0)
    observer.feel(np.array([3.0, 0.0, 9.81]), np.eye(3)[:2], np.zeros(3))
    assert observer.direction.tolist() == [0.0, 0.0, -1.0]


def test_a_feed_turns_the_cable_the_short_way():
    observer = LoadObserver(1.0, feed_noise=1e-6)
    for cable in ((0.6, -0.3, -0.74), (-0.2, 0.9, -0.39), (0.1, 0.2, 0.3)):
        observer.measure(2.0 * np.array(cable))
        exact = np.array(cable) / np.linalg.norm(cable)
        assert observer.direction == pytest.approx(exact, abs=1e-3)
        observer.still()


def test_angles_are_positive_to_the_right():
    def swing(cable, axis=0):
        return Motion(cable=cable).plane(axis).swing

    assert swing((0.0, 0.0, -1.0)) == 0.0
    assert swing((0.7, 0.2, -0.7)) == pytest.approx(math.pi / 4)
    assert swing((0.2, 0.7, -0.7), 1) == pytest.approx(math.pi / 4)
    assert swing((-1.0, 0.0, 0.0)) == pytest.approx(-math.pi / 2)


def test_where_a_releasing_load_crosses_the_rim():
    """A parabola seen ten times a second: the chord is near."""
    fall, rim = Fall(4.0, 1.3), None
    for t in np.arange(0.0, 1.0, 0.1):
        fall.see(np.array([2.0 * t, -t, 4.6 - 4.905 * t**2]), 5.6)
        assert fall.fell == (4.6 - 4.905 * t**2 < 4.3)
        rim = fall.landing if rim is None else rim
    assert rim is fall.landing  # the first crossing stays
    when = math.sqrt(0.6 / 4.905)
    assert rim == pytest.approx([2.0 * when, -when], abs=0.03)
    below = Fall(4.0, 1.3)
    below.see(np.array([0.0, 0.0, 3.9]), 4.9)
    below.see(np.array([0.0, 0.0, 3.0]), 4.9)
    assert below.landing is None


def episode():
    return EpisodeClock(flown(TASK, FlightSettings()), 4, 10.0, Motion())


def test_an_episode_says_which_action_was_in_force_longest():
    e = episode()
    assert e.answer(0, 2)
    e.hold(1, 0.02)
    e.hold(2, 0.08)
    assert not e.due(10.09)
    assert e.due(10.1)
    seen = e.advance(10.1, moving(x=-1.0))
    assert (seen.episode, seen.step, seen.action, seen.reward) == (4, 1, 2, 0.0)
    assert e.advance(10.2, Motion()).action == TASK.description.neutral  # nothing was held
    assert e.advance(10.3, Motion()).reward == 0.0


def test_an_episode_says_who_chose_what_was_in_force():
    """Nobody, where that was another action than the one answered."""
    e = episode()
    assert e.answer(0, 2, Source.HUMAN)
    e.hold(2, 0.1)
    seen = [e.advance(10.1, Motion())]
    assert e.answer(1, 0, Source.EXPLORE)
    e.hold(2, 0.06)  # the envelope's, or from before the answer
    e.hold(0, 0.04)
    seen.append(e.advance(10.2, Motion()))
    assert [o.source for o in seen] == [Source.HUMAN, Source.HOLD]


def test_only_answers_to_what_was_shown_count_and_never_backwards():
    e = episode()
    assert not e.answer(1, 2)
    assert e.answer(0, 2)
    assert not e.answer(0, 0)
    for k in range(1, 4):
        e.advance(10.0 + 0.1 * k, Motion())
    assert e.answer(2, 0)
    assert e.answered_time == pytest.approx(10.2)
    assert not e.answer(1, 0)


def test_a_late_state_leaves_a_number_out():
    e = episode()
    assert e.advance(10.13, Motion()).step == 1
    assert e.advance(10.31, Motion()).step == 3
    assert e.advance(10.4, Motion()).step == 4


def test_walls_cable_and_clock_end_it():
    assert episode().advance(10.1, moving(x=3.1)).reward == -150.0
    assert episode().advance(10.1, moving(swing=1.6)).reward == -50.0
    e = episode()
    cut = e.advance(15.0, Motion())
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


@pytest.mark.parametrize("aside", [0.0, -0.6])  # the wind, or an autopilot that leans askew
def test_transit_brings_a_swinging_load_to_rest_elsewhere(aside):
    transit = Transit(1.0, 0.4)
    x, v, a, angle, rate = 0.0, 0.0, 0.0, 0.8, 0.0
    for _ in range(round((18.0 if aside else 12.0) / 0.02)):
        now = moving(x=x, speed=v, swing=angle, swing_rate=rate).plane(0)
        a += (transit.along(-6.0, now, 0.02) - a) * 0.02 / 0.3
        x, v = x + v * 0.02, v + (a + aside) * 0.02
        rate -= (math.cos(angle) * (a + aside) + 9.81 * math.sin(angle)) * 0.02
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
    assert found.stick == (None if stick is None else pytest.approx((stick, 0.0)))


@pytest.mark.parametrize(
    ("axes", "stick"), [([0.2, 0.7], (0.7, 0.2)), ([9.0, -9.0], (-1.0, 1.0)), ([0.5], (0.0, 0.5))]
)
def test_a_stick_of_two_axes_gives_both_speeds(axes, stick):
    settings = SafetyPilotSettings(
        takeover_button=0, takeover_axis=1, takeover_inverted=False, takeover_left_axis=0
    )
    assert read_joystick(settings, [1], axes, fresh=True).stick == stick
    assert read_joystick(settings, [1], axes, fresh=False).stick == (0.0, 0.0)


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
