import math

import pytest

from msg_bridge.mavlink.authority import Commander, Situation, Timeouts, decide

T = Timeouts()
FLYING = Situation(episode=True)


@pytest.mark.parametrize(
    ("changed", "commander"),
    [
        ({}, Commander.ACTOR),
        ({"action_age": 0.149}, Commander.ACTOR),
        ({"action_age": 0.151}, Commander.NEUTRAL),
        ({"action_age": 0.299}, Commander.NEUTRAL),
        ({"action_age": 0.301}, Commander.HOLD),
        ({"alone": 61.0}, Commander.LAND),
        ({"silence": 0.5}, Commander.HOLD),
        ({"telemetry_age": 0.5}, Commander.HOLD),
        ({"telemetry_age": math.inf}, Commander.HOLD),
        ({"load_age": 0.6}, Commander.HOLD),
        ({"round_trip": 0.6}, Commander.HOLD),
        ({"lost": 0.9}, Commander.ACTOR),
        ({"lost": 1.1}, Commander.LAND),
        ({"controlled": False}, Commander.OTHER),
        ({"armed": False}, Commander.OTHER),
        ({"violation": "x is 9"}, Commander.HOLD),
        ({"jumped": True}, Commander.HOLD),
        ({"paused": True}, Commander.HOLD),
        ({"deadman": False}, Commander.HOLD),
        ({"pilot": True}, Commander.PILOT),
        ({"episode": False}, Commander.BRIDGE),
        ({"episode": False, "action_age": math.inf}, Commander.BRIDGE),
        ({"episode": False, "deadman": False}, Commander.HOLD),
    ],
)
def test_each_cause_alone(changed, commander):
    assert decide(FLYING._replace(**changed), T).commander is commander


ABOVE = [
    ({"silence": 9.0}, Commander.HOLD),
    ({"armed": False}, Commander.OTHER),
    ({"controlled": False}, Commander.OTHER),
    ({"lost": 9.0}, Commander.LAND),
    ({"telemetry_age": 9.0}, Commander.HOLD),
    ({"pilot": True}, Commander.PILOT),
    ({"violation": "x"}, Commander.HOLD),
    ({"alone": 99.0}, Commander.LAND),
    ({"action_age": 9.0}, Commander.HOLD),
]


@pytest.mark.parametrize("rank", range(len(ABOVE)))
def test_of_many_causes_the_highest_decides(rank):
    """Nothing is commanded blindly, nobody is argued with, and a person is above the envelope."""
    situation = FLYING
    for changed, _ in ABOVE[rank:]:
        situation = situation._replace(**changed)
    assert decide(situation, T).commander is ABOVE[rank][1]


def test_whoever_does_not_command_is_told_why():
    for changed, commander in ABOVE:
        verdict = decide(FLYING._replace(**changed), T)
        assert commander is verdict.commander
        assert verdict.reason
