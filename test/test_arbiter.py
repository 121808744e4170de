import math

import pytest

from msg_bridge.mavlink.arbiter import Authority, Situation, Timeouts, arbitrate

T = Timeouts()
FLYING = Situation(episode=True)


@pytest.mark.parametrize(
    ("changed", "authority"),
    [
        ({}, Authority.ACTOR),
        ({"action_age": 0.149}, Authority.ACTOR),
        ({"action_age": 0.151}, Authority.NEUTRAL),
        ({"action_age": 0.299}, Authority.NEUTRAL),
        ({"action_age": 0.301}, Authority.HOLD),
        ({"unanswered": 61.0}, Authority.LAND),
        ({"silence": 0.5}, Authority.HOLD),
        ({"telemetry_age": 0.5}, Authority.HOLD),
        ({"telemetry_age": math.inf}, Authority.HOLD),
        ({"load_age": 0.6}, Authority.HOLD),
        ({"round_trip": 0.6}, Authority.HOLD),
        ({"lost": 0.9}, Authority.ACTOR),
        ({"lost": 1.1}, Authority.LAND),
        ({"controlled": False}, Authority.OTHER),
        ({"armed": False}, Authority.OTHER),
        ({"violation": "x is 9"}, Authority.HOLD),
        ({"jumped": "the clock has jumped"}, Authority.HOLD),
        ({"stalled": 0.5}, Authority.HOLD),
        ({"paused": True}, Authority.HOLD),
        ({"deadman": False}, Authority.HOLD),
        ({"pilot": True}, Authority.PILOT),
        ({"episode": False}, Authority.BRIDGE),
        ({"episode": False, "action_age": math.inf}, Authority.BRIDGE),
        ({"episode": False, "deadman": False}, Authority.HOLD),
    ],
)
def test_each_cause_alone(changed, authority):
    assert arbitrate(FLYING._replace(**changed), T).authority is authority


@pytest.mark.parametrize("failsafe", [False, True])
def test_a_mode_that_the_autopilot_chose_is_not_put_down_to_somebody(failsafe):
    ruling = arbitrate(FLYING._replace(controlled=False, mode="HOLD", failsafe=failsafe), T)
    who = "the autopilot's own failsafe" if failsafe else "somebody"
    assert ruling.reason == f"{who} changed the mode to HOLD"


ABOVE = [
    ({"stalled": 9.0, "silence": 9.0}, Authority.HOLD),
    ({"silence": 9.0}, Authority.HOLD),
    ({"armed": False}, Authority.OTHER),
    ({"controlled": False}, Authority.OTHER),
    ({"lost": 9.0}, Authority.LAND),
    ({"telemetry_age": 9.0}, Authority.HOLD),
    ({"pilot": True}, Authority.PILOT),
    ({"violation": "x"}, Authority.HOLD),
    ({"unanswered": 99.0}, Authority.LAND),
    ({"action_age": 9.0}, Authority.HOLD),
]


@pytest.mark.parametrize("rank", range(len(ABOVE)))
def test_of_many_causes_the_highest_decides(rank):
    """Nothing is commanded blindly, nobody is argued with, and a person is above the envelope."""
    situation = FLYING
    for changed, _ in ABOVE[rank:]:
        situation = situation._replace(**changed)
    assert arbitrate(situation, T).authority is ABOVE[rank][1]


def test_whoever_does_not_command_is_told_why():
    for changed, authority in ABOVE:
        ruling = arbitrate(FLYING._replace(**changed), T)
        assert authority is ruling.authority
        assert ruling.reason
