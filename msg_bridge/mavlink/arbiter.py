"""Who commands the vehicle: one pure function of what is known, with its time-outs.

The ladder down is: a fresh action, else neutral, else brake and hold, else land.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

from iolspi_ros.settings import Settings, setting


class Authority(IntEnum):
    """Who commands the vehicle. The numbers are those on the topic `authority`."""

    NOBODY = 0
    """Nothing is sent but heartbeats: not flying."""
    BRIDGE = 1
    """Take-off, flight to the next initial condition, and what comes after an episode."""
    ACTOR = 2
    """Whoever answers on `action`."""
    NEUTRAL = 3
    """No fresh action: no acceleration along the track."""
    HOLD = 4
    """Brake, and stay there."""
    LAND = 5
    """The autopilot's own landing."""
    PILOT = 6
    """A person's stick."""
    OTHER = 7
    """The autopilot itself or another ground station; the bridge does not argue."""


@dataclass(frozen=True)
class Timeouts(Settings):
    """How long each step of the ladder is waited for. Vehicle times."""

    action_timeout: float = setting(
        0.15, "neutral when a state was not answered for this long [s]", low=0.01, high=10.0
    )
    neutral_time: float = setting(
        0.15, "brake and hold after so long without a fresh action [s]", low=0.0, high=10.0
    )
    land_after: float = setting(
        60.0, "land when nobody has answered for this long [s]", low=1.0, high=1e6
    )
    telemetry_timeout: float = setting(
        0.4, "hold when nothing, or no position, was heard for this long [s]", low=0.05, high=10.0
    )
    estimator_timeout: float = setting(
        1.0, "land when the autopilot has not known where it is for this long [s]",
        low=0.0, high=60.0,
    )  # fmt: skip
    load_timeout: float = setting(
        0.5, "hold when the load was not heard of for this long [s]", low=0.05, high=10.0
    )
    round_trip_limit: float = setting(
        0.4, "hold when the way to the autopilot and back takes longer [s]", low=0.01, high=10.0
    )
    joy_timeout: float = setting(
        0.5, "a stick that was not heard for this long [s] is not there", low=0.05, high=10.0
    )


class Situation(NamedTuple):
    """What is known. Ages in s; infinite for never.

    Attributes
    ----------
    silence : float
        Since the vehicle was heard at all.
    telemetry_age : float
        Since its last position.
    stalled : float
        For how long we ourselves did nothing, just now; zero when that was heard of since.
    armed, controlled : bool
        By its last heartbeat; in the mode in which it obeys setpoints.
    mode : str
        The mode's name, for people.
    failsafe : bool
        A failsafe of its own is acting.
    lost : float
        For how long the autopilot has not known where it is.
    round_trip : float
        To the autopilot and back.
    load_age : float
        Since the load was heard of; zero when its swing is estimated.
    load_doubt : str
        Why what is heard of cannot be the load; empty when it can.
    impossible : str
        Why the vehicle cannot be as it says; empty when it can.
    episode : bool
        One is running.
    action_age : float
        Since the state that the newest action answers.
    unanswered : float
        For how long nobody has answered at all.
    violation : str
        What is beyond the envelope; empty inside.
    pilot, deadman : bool
        A person has taken over; a person lets the learner fly.
    jumped : str
        How the autopilot's clock is not what it was; empty when it is.
    paused : bool
        A person has asked to wait.
    """

    silence: float = 0.0
    telemetry_age: float = 0.0
    stalled: float = 0.0
    armed: bool = True
    controlled: bool = True
    mode: str = ""
    failsafe: bool = False
    lost: float = 0.0
    round_trip: float = 0.0
    load_age: float = 0.0
    load_doubt: str = ""
    impossible: str = ""
    episode: bool = False
    action_age: float = 0.0
    unanswered: float = 0.0
    violation: str = ""
    pilot: bool = False
    deadman: bool = True
    jumped: str = ""
    paused: bool = False


class Ruling(NamedTuple):
    """Who commands, and why not the one above."""

    authority: Authority
    reason: str = ""


def arbitrate(s: Situation, timeouts: Timeouts) -> Ruling:
    """Who commands a vehicle in flight."""
    if s.stalled > timeouts.telemetry_timeout:
        return Ruling(Authority.HOLD, f"the bridge itself stood still for {s.stalled:.1f} s")
    if s.silence > timeouts.telemetry_timeout:
        return Ruling(Authority.HOLD, f"nothing heard for {timeouts.telemetry_timeout:g} s")
    if not s.armed:
        return Ruling(Authority.OTHER, "the vehicle was disarmed")
    if not s.controlled:
        who = "the autopilot's own failsafe" if s.failsafe else "somebody"
        return Ruling(Authority.OTHER, f"{who} changed the mode" + (s.mode and f" to {s.mode}"))
    if s.lost > timeouts.estimator_timeout:
        return Ruling(Authority.LAND, "the autopilot has lost its position estimate")
    if s.telemetry_age > timeouts.telemetry_timeout:
        return Ruling(Authority.HOLD, f"no position for {timeouts.telemetry_timeout:g} s")
    if s.pilot:
        return Ruling(Authority.PILOT, "a person has taken over")
    if s.impossible:
        return Ruling(Authority.LAND, f"what the autopilot says cannot be: {s.impossible}")
    if s.violation:
        return Ruling(Authority.HOLD, f"envelope: {s.violation}")
    if s.jumped:
        return Ruling(Authority.HOLD, s.jumped)
    if s.round_trip > timeouts.round_trip_limit:
        return Ruling(
            Authority.HOLD, f"the link is slow: over {timeouts.round_trip_limit:g} s there and back"
        )
    if s.paused:
        return Ruling(Authority.HOLD, "paused")
    if not s.deadman:
        return Ruling(Authority.HOLD, "the deadman's button was let go")
    if s.load_age > timeouts.load_timeout:
        return Ruling(Authority.HOLD, f"the load is not heard for {timeouts.load_timeout:g} s")
    if s.load_doubt:
        return Ruling(Authority.HOLD, f"what is heard of cannot be the load: {s.load_doubt}")
    if s.unanswered > timeouts.land_after:
        return Ruling(Authority.LAND, f"nobody has answered for {timeouts.land_after:g} s")
    if not s.episode:
        return Ruling(Authority.BRIDGE)
    return _actor(s, timeouts)


def _actor(s: Situation, timeouts: Timeouts) -> Ruling:
    """The ladder during an episode."""
    if s.action_age <= timeouts.action_timeout:
        return Ruling(Authority.ACTOR)
    if s.action_age <= timeouts.action_timeout + timeouts.neutral_time:
        return Ruling(Authority.NEUTRAL, f"no action for {timeouts.action_timeout:g} s")
    return Ruling(Authority.HOLD, "the learner is silent")
