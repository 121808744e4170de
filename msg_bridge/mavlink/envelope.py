"""What the vehicle may do, whatever the learner wants: accelerations limited, violations seen.

Pure functions of what is wanted and what is measured. Each limit bounds the acceleration so that
within the response time nothing is exceeded; of two that contradict each other the later in the
list wins: jerk, acceleration, swing, speed, box.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from msg_bridge.mavlink.motion import Motion
from sim_nodes.tasks.base import G
from sim_nodes.tasks.slung_load import SlungLoad

_BEYOND = 0.3  # the box, so far, is no violation yet [m]
_NOISES = 3.0  # deviations of where it is held that the margin grows by
_MOST = 1.5  # it grows to [m]
_HOLD = 1.0  # how far aside a position is held for each m/s that the speed is wrong [s]
_REST = 0.1  # beyond the margin, where a vehicle at rest is left alone [m]
_SWING_SHARE = 0.6  # of the greatest angle, that pumping may reach: braking at the box adds to it


@dataclass(frozen=True)
class Limits(Settings):
    """The envelope. Beyond it the bridge takes over."""

    box: tuple[float, ...] = setting(
        SlungLoad.walls, "least and greatest x, and for a task of two axes least and greatest y "
        "besides [m]: the walls"
    )  # fmt: skip
    corridor: float = setting(
        2.0, "of one axis: greatest distance from the track [m]", low=0.1, high=1e3
    )
    heights: tuple[float, ...] = setting((2.0, 9.0), "least and greatest height [m]")
    speed: float = setting(6.0, "greatest speed along each axis [m/s]", low=0.1, high=50.0)
    acceleration: float = setting(
        3.0, "greatest acceleration along each axis [m/s^2]", low=0.1, high=20.0
    )
    braking: float = setting(
        5.0, "deceleration counted on at the box [m/s^2], where the autopilot has no less",
        low=0.1, high=20.0,
    )  # fmt: skip
    tilt: float = setting(0.8, "greatest tilt [rad]", low=0.05, high=1.5)
    swing: float = setting(1.45, "greatest angle of the cable [rad]", low=0.05, high=1.57)
    jerk: float = setting(80.0, "greatest change of acceleration [m/s^3]", low=1.0, high=1e4)
    margin: float = setting(
        0.3, "left between the walls and where it comes to rest [m], without noise; with noise of "
        "position and speed up to 1.5", low=0.0, high=5.0,
    )  # fmt: skip
    response: float = setting(
        0.4, "how late an acceleration follows its setpoint [s]", low=0.01, high=5.0
    )
    held: float = setting(
        0.0, "how long the last acceleration goes on when setpoints stop [s], if that is longer "
        "than what is known of the autopilot", low=0.0, high=10.0,
    )  # fmt: skip
    leaning: float = setting(
        0.0, "how long braking takes to begin then [s], if that is longer", low=0.0, high=10.0
    )
    cable: float = setting(SlungLoad.length, "length of the cable [m]", low=0.05, high=100.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.box) not in (2, 4) or not all(low < high for low, high in self.sides):
            raise InputError(
                f"box is {list(self.box)}; allowed: least and greatest x [m], and for a task of "
                "two axes least and greatest y besides; of each pair the least first"
            )
        if len(self.heights) != 2 or not self.heights[0] < self.heights[1]:
            raise InputError(
                f"heights is {list(self.heights)}; allowed: two numbers, the least first"
            )

    @property
    def axes(self) -> int:
        """Horizontal axes of the box: 1 or 2."""
        return len(self.box) // 2

    @property
    def sides(self) -> tuple[tuple[float, float], ...]:
        """Least and greatest place along each axis [m]."""
        return tuple(zip(self.box[::2], self.box[1::2], strict=False))


def widened(limits: Limits, noise: float, speed_noise: float) -> Limits:
    """Limits with more room to the walls, as what is wrong with the autopilot's estimate asks.

    Who holds a position by a speed that is wrong holds it aside: with the usual gain of 1/s, of PX4
    (MPC_XY_P 0.95) as of ArduPilot (PSC_POSXY_P 1), by a metre for each m/s.

    Parameters
    ----------
    limits : Limits
    noise, speed_noise : float
        Standard deviations of position [m] and speed [m/s].
    """
    margin = limits.margin + _NOISES * math.hypot(noise, _HOLD * speed_noise)
    return replace(limits, margin=max(limits.margin, min(margin, _MOST)))


def starts(limits: Limits, axis: int = 0) -> tuple[float, float]:
    """Least and greatest place along an axis [m] at which an episode may begin at rest."""
    room, (low, high) = limits.margin + _REST, limits.sides[axis]
    return low + room, high - room


class Limited(NamedTuple):
    """What may be flown, and which limits changed it."""

    acceleration: float
    reasons: tuple[str, ...]


def limit(
    limits: Limits, wanted: float, motion: Motion, before: float, dt: float, axis: int = 0,
    creep: float = 0.0,
) -> Limited:  # fmt: skip
    """Acceleration along an axis that keeps the vehicle inside.

    Parameters
    ----------
    limits : Limits
    wanted : float
        [m/s²]; one that is not finite counts as none.
    motion : Motion
    before : float
        The setpoint before this one [m/s²].
    dt : float
        Time since that one [s].
    axis : int
        0 along the track, 1 across.
    creep : float
        Of the axis, as a `Creep` finds it [m/s].

    Returns
    -------
    Limited
        Always finite when `motion` and `before` are.
    """
    reasons = []
    value = wanted
    if not math.isfinite(wanted):
        value = 0.0
        reasons.append("not finite")
    step = limits.jerk * dt
    # Of a box too narrow, or left already, both bounds may contradict: the lower one wins then.
    for name, low, high in (
        ("jerk", before - step, before + step),
        ("acceleration", -limits.acceleration, limits.acceleration),
        ("swing", *_swing_bounds(limits, motion, axis)),
        ("speed", *_speed_bounds(limits, motion.velocity[axis])),
        ("box", *_box_bounds(limits, motion, axis, creep)),
    ):
        allowed = max(low, min(value, high))
        if abs(allowed - value) > 1e-9:
            reasons.append(name)
            value = allowed
    return Limited(value, tuple(reasons))


def violation(limits: Limits, motion: Motion) -> str:
    """What is beyond the envelope, in words; empty inside. NaN is beyond it."""
    checks: list[tuple[str, float, float, float, str]] = []
    for name, place, speed, (low, high) in zip(
        ("x", "y"), motion.place, motion.velocity, limits.sides, strict=False
    ):
        which = "speed" if name == "x" else f"speed in {name}"
        checks.append((name, place, low - _BEYOND, high + _BEYOND, "m"))
        checks.append((which, abs(speed), 0.0, 1.15 * limits.speed, "m/s"))
    if limits.axes == 1:
        away = abs(motion.across)
        checks.append(("distance from the track", away, 0.0, limits.corridor, "m"))
    checks += [
        ("height", motion.height, limits.heights[0], limits.heights[1], "m"),
        ("tilt", motion.tilt, 0.0, limits.tilt, "rad"),
        ("swing", motion.swing, 0.0, limits.swing, "rad"),
    ]
    for name, value, least, most, unit in checks:
        if not least <= value <= most:
            return f"{name} is {value:.2f} {unit}; allowed: {least:g} to {most:g}"
    return ""


def _clip(limits: Limits, value: float) -> float:
    return max(-limits.acceleration, min(value, limits.acceleration))


def _speed_bounds(limits: Limits, speed: float) -> tuple[float, float]:
    """So that the speed is within its limit after the response time."""
    low = (-limits.speed - speed) / limits.response
    high = (limits.speed - speed) / limits.response
    return _clip(limits, low), _clip(limits, high)


def _box_bounds(
    limits: Limits, motion: Motion, axis: int, creep: float
) -> tuple[float, float]:  # fmt: skip
    """So that the vehicle comes to rest inside the box, whoever stops sending, and when.

    Of the speed that is told and that with which the position moves, the worse for each wall.
    """
    (low, high), place, speed = limits.sides[axis], motion.place[axis], motion.velocity[axis]
    upper = _stopping_bound(limits, high - limits.margin - place, speed + max(creep, 0.0))
    lower = -_stopping_bound(limits, place - low - limits.margin, -speed - min(creep, 0.0))
    return lower, upper


def _stopping_bound(limits: Limits, room: float, speed: float) -> float:
    """Greatest acceleration towards a wall `room` ahead, approached with `speed`.

    It is held for τ, the response time or as long as the autopilot holds it when setpoints stop;
    then the vehicle leans back within T, and brakes with b. With v' = v + a τ and
    x' = v τ + a τ²/2, it must hold that x' + T v' + v'²/(2 b) <= room: a quadratic in a, whose
    larger root is the bound.
    """
    tau, late, b = max(limits.response, limits.held), limits.leaning, limits.braking
    if speed > 0.0 and 0.5 * speed * tau > room:  # it has to stand before τ is over
        return _clip(limits, -0.5 * speed**2 / room) if room > 0.0 else -limits.acceleration
    square = tau**2 / (2.0 * b)
    linear = 0.5 * tau**2 + late * tau + speed * tau / b
    constant = speed * (tau + late) + speed**2 / (2.0 * b) - room
    discriminant = linear**2 - 4.0 * square * constant
    if discriminant < 0.0:
        return -limits.acceleration
    return _clip(limits, (-linear + math.sqrt(discriminant)) / (2.0 * square))


def stick_bounds(
    limits: Limits, motion: Motion, axis: int = 0, creep: float = 0.0
) -> tuple[float, float]:
    """Least and greatest velocity [m/s] from which the vehicle comes to rest inside the box."""
    (low, high), place = limits.sides[axis], motion.place[axis]
    way, b = max(limits.response, limits.held) + limits.leaning, limits.braking

    def towards(room: float) -> float:  # v (τ + T) + v²/(2 b) = room
        return -b * way + math.sqrt((b * way) ** 2 + 2.0 * b * max(room, 0.0))

    slow, fast = towards(place - low - limits.margin), towards(high - limits.margin - place)
    return -slow - min(creep, 0.0), fast - max(creep, 0.0)


def _swing_bounds(limits: Limits, motion: Motion, axis: int) -> tuple[float, float]:
    """So that the load's energy after the response time is below that at the greatest angle.

    With u where the cable points to, E = |u̇|²/2 + g/L (1 + u_z) changes with -a · u̇ / L; in one
    plane that is -a ω cos θ / L. Of what is left of it each axis has its share.
    """
    gravity = G / limits.cable
    energy = 0.5 * sum(rate**2 for rate in motion.cable_rate) + gravity * (1.0 + motion.cable[2])
    most = gravity * (1.0 - math.cos(_SWING_SHARE * limits.swing))
    gain = -motion.cable_rate[axis] / limits.cable
    room = (most - energy) / limits.response / limits.axes
    if abs(gain) < 1e-6:
        return -limits.acceleration, limits.acceleration
    bound = _clip(limits, room / gain)
    return (-limits.acceleration, bound) if gain > 0.0 else (bound, limits.acceleration)
