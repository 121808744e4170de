"""When a vehicle counts as at rest: by its own noise, between bounds, and not for ever."""

import numpy as np
import pytest
from motions import moved, moving

from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.flown import flown
from msg_bridge.mavlink.phase_machine import Inputs, PhaseMachine
from msg_bridge.mavlink.phases import Phase, Tell
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.settling import Settling
from sim_nodes.tasks.slung_load import SlungLoad

SETTINGS = FlightSettings()
DT = 0.02
MIDDLE = (0.0, 0.0, 5.0)


def wander(deviation, seed=0, memory=1.0):
    """Slow noise of four numbers, standard deviations as given."""
    rng, value = np.random.default_rng(seed), np.zeros(4)
    keep = np.exp(-DT / memory)
    while True:
        value = keep * value + np.sqrt(1.0 - keep**2) * np.array(deviation) * rng.standard_normal(4)
        yield value


def hovering(settling, noise, seconds, target=-2.0, begin=0.0, off=0.0):
    """The time at which it counts as settled; None when it does not; and the last word."""
    settling.begin(begin)
    found = None
    for k in range(round(seconds / DT)):
        x, v, angle, rate = next(noise)
        motion = moving(x=target + x + off, speed=v, height=5.0, swing=angle, swing_rate=rate)
        found = settling.see(begin + k * DT, (target, 0.0, 5.0), motion)
        if found.ready:
            return k * DT, found
    return None, found


def test_without_noise_it_is_settled_after_the_settle_time():
    when, _ = hovering(Settling(SETTINGS), wander([0.0] * 4), 5.0)
    assert when == pytest.approx(SETTINGS.settle_time, abs=DT)


@pytest.mark.parametrize("seed", range(5))
def test_with_the_noise_of_a_real_estimate_it_settles_and_the_next_time_sooner(seed):
    """0.1 m and 0.1 m/s, as they were, do not come about; what is measured does."""
    noise = wander((0.12, 0.18, 0.03, 0.1), seed)
    settling = Settling(SETTINGS)
    first, _ = hovering(settling, noise, 60.0)
    for _ in range(10):
        hovering(settling, noise, 14.0)
    assert first < 20.0
    times = [hovering(settling, noise, 60.0, begin=100.0 * k)[0] for k in range(20)]
    assert max(times) < 16.0


def test_the_noise_that_is_measured_is_that_of_the_flight():
    deviation = np.array((0.12, 0.18, 0.03, 0.1))
    found = []
    for seed in range(8):
        settling = Settling(SETTINGS)
        settling.begin(0.0)
        noise = wander(deviation, seed, memory=0.5)
        for k in range(round(14.9 / DT)):
            x, v, angle, rate = next(noise)
            now = moving(x=x, speed=v, height=5.0, swing=angle, swing_rate=rate)
            settling.see(k * DT, MIDDLE, now)
        found.append(settling.noise)
    assert np.mean(found, axis=0) == pytest.approx(deviation, rel=0.35)


def test_one_outlier_is_no_noise():
    settling = Settling(SETTINGS)
    for k in range(500):
        off = 0.7 if k % 50 == 0 else 0.0
        settling.see(k * DT, MIDDLE, moving(x=off, height=5.0))
    assert settling.noise[0] < 0.04  # that changes no tolerance


def test_slow_creep_is_no_noise():
    settling = Settling(SETTINGS)
    for k in range(500):
        settling.see(k * DT, MIDDLE, moving(x=0.7 - 0.05 * k * DT, speed=-0.05, height=5.0))
    assert settling.noise[0] < 0.01


def test_noise_beyond_bounds_is_not_waited_for_for_ever_and_what_is_waited_for_is_said():
    when, found = hovering(Settling(SETTINGS), wander((1.5, 1.5, 0.0, 0.0)), 31.0)
    assert when is None
    assert found.expired
    assert "position" in found.waits_for
    assert "(tolerance 0.50)" in found.waits_for


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"x": 0.3}, "position 0.30 m (tolerance 0.10)"),
        ({"speed": -0.2}, "speed -0.20 m/s (tolerance 0.10)"),
        ({"swing": 0.1}, "swing 0.10 rad (tolerance 0.08)"),
        ({"swing_rate": 0.3}, "swing rate 0.30 rad/s (tolerance 0.24)"),
        ({"across": 0.5}, "distance from the track 0.50 m"),
        ({"height": 4.0}, "height -1.00 m off"),
    ],
)
def test_what_it_waits_for_is_said_with_value_and_tolerance(wrong, word):
    found = Settling(SETTINGS).see(0.0, MIDDLE, moved(moving(height=5.0), **wrong))
    assert found.waits_for.startswith(word)


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"across": 0.3}, "position in y 0.30 m (tolerance 0.10)"),
        ({"drift": -0.2}, "speed in y -0.20 m/s"),
        ({"cable": (0.0, 0.1, -0.995)}, "swing in y 0.10 rad"),
        ({"x": 0.3, "across": 0.3}, "position 0.30 m (tolerance 0.10), position in y 0.30 m"),
    ],
)
def test_of_two_axes_each_has_to_be_at_rest(wrong, word):
    found = Settling(SETTINGS, 2).see(0.0, MIDDLE, moved(moving(height=5.0), **wrong))
    assert found.waits_for.startswith(word)


def test_the_noise_of_two_axes_is_that_of_the_noisier():
    settling, noise = Settling(SETTINGS, 2), wander((0.12, 0.18, 0.0, 0.0), memory=0.5)
    settling.begin(0.0)
    for k in range(round(14.9 / DT)):
        _, speed, *_ = values = next(noise)
        settling.see(k * DT, MIDDLE, moving(across=values[0], drift=speed, height=5.0))
    assert settling.noise[:2] == pytest.approx([0.12, 0.18], rel=0.6)


def test_where_it_does_not_settle_another_start_is_flown_to_and_after_three_it_lands():
    machine = PhaseMachine(flown(SlungLoad(), SETTINGS), SETTINGS, stream_first=True)
    machine.begin(0.0)
    far = moving(x=50.0, height=5.0)
    told, targets, now = [], [], 0.0
    while machine.phase is not Phase.LANDING:
        assert now < 200.0
        decisions = machine.step(Inputs(now, Authority.BRIDGE, motion=far))
        told += [d.text for d in decisions if isinstance(d, Tell) and d.level == "warning"]
        if machine.phase is Phase.TRANSIT and machine.target not in targets:
            targets.append(machine.target)
        now += 0.1
    assert len(targets) == 3
    assert len(told) == 3
    assert all(
        f"no rest at x = {x:.1f} m in 30 s: position" in t
        for (x, _, _), t in zip(targets, told, strict=True)
    )
    assert "did not come to rest at 3 starts" in machine.landing_reason
    assert now == pytest.approx(90.0, abs=5.0)
