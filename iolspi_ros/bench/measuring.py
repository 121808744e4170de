"""Flies an autopilot's simulator and measures what our imitation says of it, row by row."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.bench.stand import HEIGHT, Stand
from msg_bridge.mavlink import profiles
from msg_bridge.mavlink.parameters import ParameterClient
from msg_bridge.mavlink.setpoints import AccelerationSetpoint, Setpoint, VelocitySetpoint
from sim_nodes.autopilot.figures import Figure

Samples = dict[str, list[float]]
"""What was measured, by the name of its row; a row that could not be has no samples."""

PUSH = 3.0
"""Acceleration that is asked for [m/s²]."""
PERIOD = 0.3
"""After which the fast square wave changes its sign [s]."""
SLOW, FAST = 1.75, 2.4
"""Speeds at which setpoints stop [m/s]: coasting, and while accelerating."""
CRUISE = 2.0
"""Velocity that is asked for [m/s]."""
REPEATED = 3
"""How often what is over soon is flown."""

_UNASKED = 10.0  # of listening [s]
_HOVER = 25.0  # of hovering [s]
_HIGH = 15.0  # to lose height from [m]
_AT_REST = 0.25  # [m/s]
_ARRIVED = 4.6  # height at which a take-off is over [m]
_HOLD = {"ardupilot": 5, "px4": profiles.px4_mode(4, 3)}  # LOITER, HOLD
_ARM, _GRIPPER = dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_DO_GRIPPER
_SERVOS = dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW


def measure(stand: Stand, tell: Callable[[str], None], repeated: int = REPEATED) -> Samples:
    """Everything, on a vehicle that stands on the ground; it takes off, flies and lands.

    Parameters
    ----------
    stand : Stand
        To a simulator that was just started.
    tell : callable
        Takes what is done now.
    repeated : int
        How often each short flight is flown.

    Raises
    ------
    InputError
        When the autopilot cannot be flown; its parameters have been given back.
    """
    found: Samples = {}

    def add(rows: dict[str, float]) -> None:
        for name, value in rows.items():
            if math.isfinite(value):
                found.setdefault(name, []).append(value)

    tell("who is there")
    stand.until(lambda: stand.ears.autopilot is not None, 30.0, "heartbeat")
    stand.profile = profiles.of_autopilot(stand.ears.autopilot or 0)
    tell("messages that come unasked")
    add(unasked(stand))
    _ask(stand)
    tell("parameters")
    client = ParameterClient(stand.link, stand.profile, stand.clock, lambda: stand.listen(0.02))
    before = _change(client)
    try:
        tell("gripper, on the ground")
        add(gripper(stand))
        tell("until it can be armed")
        add(arm(stand))
        tell("take-off")
        add(take_off(stand))
        stand.back()
        tell("hovering")
        add(hover(stand))
        for name, flight in _FLIGHTS.items():
            for _ in range(repeated):
                tell(name)
                add(flight(stand))
                stand.back()
        tell("holding, in the mode for it")
        add(hold(stand))
        stand.back()
        tell("landing")
        add(land(stand))
    finally:
        for name, value in before.items():
            client.set(name, value)
    return found


# ---------------------------------------------------------------- on the ground


def unasked(stand: Stand) -> dict[str, float]:
    """Rates of all messages that come without being asked [Hz].

    Nobody has asked for anything on this link since it was switched on, or the rates mean nothing.
    """
    first, start = len(stand.ears.heard), stand.clock.now()
    stand.until(lambda: stand.clock.now() - start > _UNASKED, 2.0 * _UNASKED, "end")
    times: dict[str, list[float]] = {}
    for now, message in stand.ears.heard[first:]:
        times.setdefault(message.get_type(), []).append(now)
    # What comes once, or as an answer, is no rate.
    skipped = {"TIMESYNC", "STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE"}
    return {
        f"unasked {name}": (len(when) - 1) / (when[-1] - when[0])
        for name, when in sorted(times.items()) if len(when) > 2 and name not in skipped
    }  # fmt: skip


def _ask(stand: Stand) -> None:
    stand.link.ask_rates(stand.profile)
    for message, rate in ((dialect.MAVLINK_MSG_ID_ATTITUDE, 50.0), (_SERVOS, 50.0),
                          (dialect.MAVLINK_MSG_ID_SYS_STATUS, 10.0)):  # fmt: skip
        stand.interval(message, rate)


def gripper(stand: Stand) -> dict[str, float]:
    """Let go on the ground: after how long [s] it answers, moves and speaks. Shuts it again."""
    rows: dict[str, float] = {}
    for action in (1.0, 0.0):
        stand.listen_for(1.0)
        first, start = len(stand.ears.heard), stand.clock.now()
        pulses = _pulses(stand)
        stand.link.command(_GRIPPER, 1.0, action)
        stand.listen_for(5.0)
        if action == 0.0:
            rows = _released(stand, first, start, pulses)
    stand.link.command(_GRIPPER, 1.0, 1.0)
    stand.listen_for(1.0)
    return rows


def _pulses(stand: Stand) -> tuple[int, ...]:
    last = [m for _, m in stand.of("SERVO_OUTPUT_RAW")]
    return tuple(getattr(last[-1], f"servo{i}_raw") for i in range(5, 17)) if last else ()


def _released(stand: Stand, first: int, start: float, pulses: tuple[int, ...]) -> dict[str, float]:
    answers = [
        (now, m.result) for now, m in stand.of("COMMAND_ACK", first) if m.command == _GRIPPER
    ]
    moved = [
        now for now, m in stand.of("SERVO_OUTPUT_RAW", first)
        if pulses and tuple(getattr(m, f"servo{i}_raw") for i in range(5, 17)) != pulses
    ]  # fmt: skip
    said = [now for now, m in stand.of("STATUSTEXT", first) if "released" in m.text]
    done = [now for now, result in answers if result != dialect.MAV_RESULT_IN_PROGRESS]
    return {
        "gripper first result": float(answers[0][1]) if answers else math.nan,
        "gripper last result": float(answers[-1][1]) if answers else math.nan,
        "gripper answers": done[-1] - start if done else math.nan,
        "gripper moves": moved[0] - start if moved else math.nan,
        "gripper speaks": said[0] - start if said else math.nan,
    }


def arm(stand: Stand) -> dict[str, float]:
    """Arm it in the mode for setpoints; from switching on until that can be done [s].

    Not known when it could be from the first: it had been on for longer.
    """
    tries = 0

    def ask() -> None:
        nonlocal tries
        tries += 1
        stand.link.ask_mode(stand.profile, stand.profile.controlled)
        stand.link.arm(True)

    setpoint = stand.stay() if stand.profile.stream_first else None
    if setpoint is not None:
        stand.fly(1.0, setpoint)

    def taken() -> bool:
        return stand.ears.acks.get(_ARM, (0.0, -1))[1] == 0 and stand.controlled

    stand.until(taken, stand.patience, "arming", setpoint, ask)
    refused = tries > 1 and not stand.profile.stream_first
    return {"armable": _boot_time(stand) if refused else _armable(stand)}


def _boot_time(stand: Stand) -> float:
    """Since it was switched on, by its latest stamp [s]."""
    stamps = (m.time_boot_ms for _, m in reversed(stand.ears.heard) if hasattr(m, "time_boot_ms"))
    return next(stamps, math.nan) * 1e-3


def _armable(stand: Stand) -> float:
    """When it began to call itself healthy, if it did not from the first [s]."""
    stamp, waited = math.nan, False
    for _, message in stand.ears.heard:
        stamp = getattr(message, "time_boot_ms", stamp)
        if message.get_type() == "SYS_STATUS":
            if not message.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_PREARM_CHECK:
                waited = True
            elif waited:
                return stamp * 1e-3
            else:
                return math.nan
    return math.nan


# ---------------------------------------------------------------- in the air


def take_off(stand: Stand) -> dict[str, float]:
    """Time from the command, or from arming where setpoints are all it needs, to 4.6 m [s]."""
    if stand.profile.stream_first:
        start, setpoint = stand.ears.acks[_ARM][0], stand.stay()
    else:
        start, setpoint = stand.clock.now(), None
        stand.link.take_off(HEIGHT)
    stand.until(lambda: stand.ears.position[2] > _ARRIVED, 40.0, "height", setpoint)
    took = stand.clock.now() - start
    if setpoint is None:
        stand.listen_for(4.0)
    return {"take-off": took}


def hover(stand: Stand) -> dict[str, float]:
    """How far its estimate strays while it holds a place: horizontal standard deviations."""
    seen = stand.fly(_HOVER, stand.stay())
    return {
        "estimate position": float(np.hypot(*seen.position[:, :2].std(axis=0))),
        "estimate velocity": float(np.hypot(*seen.velocity[:, :2].std(axis=0))),
        "estimate height": float(seen.position[:, 2].std()),
    }


def _push(size: float) -> Callable[[float], Setpoint]:
    return lambda _: AccelerationSetpoint(size, 0.0, 0.0, HEIGHT)


def push(stand: Stand) -> dict[str, float]:
    """3 m/s² eastwards from rest for 2 s: when it leans, and how fast it is after 1 and 2 s."""
    seen = stand.fly(2.2, _push(PUSH))
    lean = float(np.median(seen.tilt[(seen.tilt_time > 0.7) & (seen.tilt_time < 1.2)]))
    rows = {
        f"push {share} %": _first(seen.tilt_time, seen.tilt >= 0.01 * share * lean)
        for share in (50, 90)
    }
    begun = seen.speed(-0.1, 0.1)
    rows["push 1 s"] = seen.speed(0.95, 1.05) - begun
    rows["push 2 s"] = seen.speed(1.95, 2.05) - begun
    return rows


def _first(times: np.ndarray, holds: np.ndarray) -> float:
    return float(times[int(np.argmax(holds))]) if holds.any() else math.nan


def square(stand: Stand) -> dict[str, float]:
    """±3 m/s², changing every 0.3 s for 6 s: the highest speed [m/s]."""

    def sign(t: float) -> Setpoint:
        size = PUSH if int(t / PERIOD) % 2 == 0 else -PUSH
        return AccelerationSetpoint(size, 0.0, 0.0, HEIGHT)

    seen = stand.fly(6.0, sign)
    return {"square wave": float(np.abs(_smooth(seen.velocity[:, 0])).max())}


def _smooth(values: np.ndarray, n: int = 5) -> np.ndarray:
    return np.convolve(values, np.ones(n) / n, mode="valid")


def coast(stand: Stand) -> dict[str, float]:
    """How fast its speed dies out after a push, with an acceleration of zero [1/s]."""
    stand.fly(1.2, _push(PUSH))
    seen = stand.fly(3.0, _push(0.0))
    fast = (seen.time > 0.6) & (seen.time < 2.6) & (seen.velocity[:, 0] > 0.3)
    rate = np.polyfit(seen.time[fast], np.log(seen.velocity[fast, 0]), 1)[0]
    return {"drag": -float(rate)}


def cruise(stand: Stand) -> dict[str, float]:
    """2 m/s eastwards: after how long it begins, how fast it rises, what it comes to."""
    seen = stand.fly(6.0, lambda _: VelocitySetpoint(CRUISE, 0.0, 0.0))
    steady = seen.speed(4.0, 6.0)
    speed, time = _smooth(seen.velocity[:, 0]), seen.time[2:-2]
    begun = _first(time, speed > 0.1 * steady)
    return {
        "cruise": steady,
        "cruise begins": begun,
        "cruise rises": _first(time, speed > 0.9 * steady) - begun,
    }


def stop_slow(stand: Stand) -> dict[str, float]:
    """Setpoints stop while it coasts at 1.75 m/s."""
    reach(stand, SLOW)
    stand.fly(0.3, _push(0.0))
    return _silence(stand, "slow stop")


def stop_fast(stand: Stand) -> dict[str, float]:
    """Setpoints stop while it accelerates by 3 m/s², at 2.4 m/s."""
    reach(stand, FAST)
    return _silence(stand, "fast stop")


def reach(stand: Stand, speed: float) -> None:
    """Accelerate to a speed [m/s]."""
    stand.until(lambda: stand.ears.velocity[0] >= speed, 6.0, f"{speed:g} m/s", _push(PUSH))


def _silence(stand: Stand, name: str) -> dict[str, float]:
    """How far it flies on until it rests [m], how fast [m/s], and when it has begun to brake [s].

    At rest is below 0.25 m/s: an estimate that strays moves the vehicle for ever.
    """
    begun = stand.ears.position[0]
    seen = stand.fly(7.0, None)
    speed, time = _smooth(seen.velocity[:, 0]), seen.time[2:-2]
    top = int(speed.argmax())
    rest = top + int(np.argmax(speed[top:] < _AT_REST))
    braked = top + int(np.argmax(speed[top:] < 0.9 * speed[top]))
    return {
        f"{name} way": float(seen.position[2:-2][rest, 0] - begun),
        f"{name} peak": float(speed[top]),
        f"{name} brakes": float(time[braked]),
    }


_FLIGHTS: dict[str, Callable[[Stand], dict[str, float]]] = {
    "push": push, "square wave": square, "coasting": coast, "cruise": cruise,
    "setpoints stop, coasting": stop_slow, "setpoints stop, accelerating": stop_fast,
}  # fmt: skip


def hold(stand: Stand) -> dict[str, float]:
    """How fast it sinks in the mode that holds, with the sticks as the simulator has them [m/s]."""
    stand.back(_HIGH)
    _enter(stand, _HOLD[stand.profile.name])
    seen = stand.fly(4.0, None)
    sinks = -float(seen.velocity[seen.time > 3.0, 2].mean())
    _enter(stand, stand.profile.controlled, stand.stay(_HIGH))
    return {"hold sinks": sinks}


def _enter(stand: Stand, mode: int, setpoint: Callable[[float], Setpoint] | None = None) -> None:
    stand.until(
        lambda: stand.ears.mode == mode, 10.0, f"mode {stand.profile.mode_name(mode)}", setpoint,
        lambda: stand.link.ask_mode(stand.profile, mode),
    )  # fmt: skip


def land(stand: Stand) -> dict[str, float]:
    """LAND from 5 m until it is disarmed [s], and the custom mode that it shows then."""
    start = stand.clock.now()
    _enter(stand, stand.profile.landing)
    stand.until(lambda: not stand.ears.armed, 60.0, "landing")
    took = stand.clock.now() - start
    stand.listen_for(3.0)
    mode = stand.ears.mode
    known = {stand.profile.controlled: 1.0, stand.profile.landing: 2.0}
    return {"landing": took, "mode after landing": known.get(mode, 0.0)}


# ---------------------------------------------------------------- parameters


def _change(client: ParameterClient) -> dict[str, float]:
    """Set what the bridge sets while it flies; the values that were, by the names they have."""
    before: dict[str, float] = {}
    for change in client.profile.changes:
        name, before_it = client.first(change.names)
        before[name] = before_it
        client.set(name, change.value)
    return before


# ---------------------------------------------------------------- what it comes to


@dataclass(frozen=True)
class Line:
    """One row of the comparison.

    Attributes
    ----------
    name : str
    samples : tuple of float
        What was measured; empty for nothing.
    figure : Figure, optional
        What the table says; None where it has no such row.
    """

    name: str
    samples: tuple[float, ...]
    figure: Figure | None

    @property
    def median(self) -> float:
        """Of the samples; NaN for none."""
        return float(np.median(self.samples)) if self.samples else math.nan

    @property
    def holds(self) -> bool | None:
        """Whether both agree; None where one is missing."""
        if self.figure is None or not self.samples:
            return None
        return self.figure.holds(self.median)

    def cells(self) -> tuple[str, ...]:
        """Name, measured, its spread, the table's, and a verdict, as text."""
        spread = ""
        if len(self.samples) > 1:
            spread = f"{min(self.samples):.3g} to {max(self.samples):.3g}"
        measured = f"{self.median:.3g}" if self.samples else "-"
        if self.figure is None:
            return self.name, measured, spread, "-", "not in the table"
        table = f"{self.figure.value:.3g} {self.figure.unit} ± {self.figure.margin:.2g}"
        verdict = {None: "not measured", True: "agrees", False: "DIFFERS"}[self.holds]
        return self.name, measured, spread, table, verdict


def compare(found: Samples, table: Mapping[str, Figure]) -> list[Line]:
    """What was measured beside what the table says: its rows first, then those it has not."""
    names = [*table, *(name for name in found if name not in table)]
    return [Line(name, tuple(found.get(name, ())), table.get(name)) for name in names]


def markdown(lines: list[Line]) -> str:
    """The comparison as a table."""
    head = [("row", "measured", "spread", "table", ""), ("---",) * 5]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in [*head, *(x.cells() for x in lines)])
