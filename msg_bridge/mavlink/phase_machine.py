"""From take-off through episodes to landing: which phase follows which, and what is done in it.

Inputs go in, decisions come out: no link, no lock and no clock in here. Who commands is decided
before (`arbiter`), where to fly after (`guidance`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink.arbiter import Authority
from msg_bridge.mavlink.episode_clock import EpisodeClock
from msg_bridge.mavlink.flown import FlownTask
from msg_bridge.mavlink.motion import Motion, Vector
from msg_bridge.mavlink.payload import PayloadReport
from msg_bridge.mavlink.phases import Command, Decision, Enter, Level, Phase, Show, Tell
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.settling import Settling

_AGAIN = 1.0  # between two requests of the same [s]
_CLIMB_AGAIN = 8.0  # between two requests to take off: a lift-off takes seconds [s]
_STOPPED = 0.3  # a vehicle below this has stopped [m/s]
_STILL = 0.2  # so long after the end it does not begin to look for the next start [s]
_RESTLESS = 3  # starts one after the other without rest, and it lands
_PROBE = 1.0  # between two episodes that nobody has answered [s]


class Inputs(NamedTuple):
    """What a step of the machine goes by.

    Attributes
    ----------
    now : float
        Vehicle time [s].
    authority : Authority
        Who commands.
    reason : str
        Why, when it is not whoever acts.
    motion : Motion
    armed, controlled, landing : bool
        By the last heartbeat; in the mode in which it obeys setpoints; in that in which it lands.
    payload : PayloadReport
    """

    now: float
    authority: Authority
    reason: str = ""
    motion: Motion = Motion()
    armed: bool = True
    controlled: bool = True
    landing: bool = False
    payload: PayloadReport = PayloadReport()


class PhaseMachine:
    """Phases of one flight, and its episodes.

    Every method that may change the phase gives the decisions that come of it, in order.

    Parameters
    ----------
    task : FlownTask
    settings : FlightSettings
    stream_first : bool
        The autopilot climbs by setpoints, not by a command.
    """

    def __init__(self, task: FlownTask, settings: FlightSettings, *, stream_first: bool) -> None:
        self.task, self.settings, self._stream_first = task, settings, stream_first
        self.phase = Phase.IDLE
        self.episode: EpisodeClock | None = None
        self.number = -1
        self.flown = self.abandoned = 0
        self.target: Vector = (0.0, 0.0, settings.height)
        """x, y and height of the next initial condition [m]."""
        self.starts: tuple[tuple[float, float], ...] = ((-np.inf, np.inf),) * task.axes
        """Between which it is kept along each axis [m]: the task's own may be too near a wall."""
        self.landing_reason = ""
        self.unanswered = 0.0
        """For how long nobody has answered an episode [s]."""
        self.settling = Settling(settings, task.axes)
        self.waits_for = ""
        """What keeps the next episode from beginning, for people."""
        self._restless = 0
        self._since = self._asked = self._probe = 0.0
        self._begun = 0
        self._ours = False
        self._released = Motion()
        self._rng = np.random.default_rng([settings.seed, 3])
        self._decisions: list[Decision] = []
        self._handlers = {
            Phase.ARMING: self._arming,
            Phase.TAKEOFF: self._taking_off,
            Phase.TRANSIT: self._in_transit,
            Phase.EPISODE: self._in_episode,
            Phase.RELEASE: self._releasing,
            Phase.BRAKE: self._braking,
            Phase.RELOAD: self._reloading,
        }

    @property
    def in_flight(self) -> bool:
        """Whether the vehicle is ours to command."""
        return self.phase not in (Phase.IDLE, Phase.DOWN)

    # ------------------------------------------------------------ told from outside

    def reset(self, now: float, task: FlownTask, settings: FlightSettings) -> list[Decision]:
        """Count episodes and draw initial positions from the beginning."""
        self.task, self.settings = task, settings
        self._rng = np.random.default_rng([settings.seed, 3])
        self._begun = 0
        self._give_up(now)
        self._probe = 0.0
        return self._taken()

    def begin(self, now: float) -> list[Decision]:
        """Take off, as soon as the vehicle lets us."""
        self.unanswered = self._probe = 0.0
        self._restless = 0
        self._enter(Phase.ARMING, now)
        return self._taken()

    def land(self, now: float, why: str) -> list[Decision]:
        """End the flight, if there is one that does not end already."""
        if self.in_flight and self.phase is not Phase.LANDING:
            self._tell("info", f"land: {why}")
            self._land(now, why)
        return self._taken()

    def answer(self, number: int, step: int, action: int, source: int = -1) -> bool:
        """Take an action; False when it answers no state of this episode."""
        episode = self.episode
        if episode is None or number != episode.number or self.phase is not Phase.EPISODE:
            return False
        if not episode.answer(step, action, source):
            return False
        self.unanswered = 0.0
        return True

    def release(self, now: float, motion: Motion) -> list[Decision]:
        """Let the load go: the action in force says so."""
        self._released = motion
        self._decisions.append(Command.RELEASE)
        self._enter(Phase.RELEASE, now)
        return self._taken()

    # ------------------------------------------------------------ time passes

    def pass_time(self, dt: float, applied: int) -> None:
        """An action was in force for so long [s]."""
        if self.episode is not None and self.phase is Phase.EPISODE:
            self.episode.hold(applied, dt)
            if self.episode.answered < 0:
                self.unanswered += dt
        elif self._probe > 0.0 and self._ours and self.phase in (Phase.BRAKE, Phase.TRANSIT):
            self.unanswered += dt  # on the way to ask again

    def step(self, inputs: Inputs) -> list[Decision]:
        """Move on to the next phase when it is time."""
        now, authority = inputs.now, inputs.authority
        self._ours = authority is Authority.BRIDGE
        if self.phase is Phase.LANDING:
            self._landing(inputs)
        elif authority is Authority.LAND:
            self._land(now, inputs.reason)
        elif authority is Authority.OTHER and not inputs.armed:
            self._give_up(now)
            self._enter(Phase.DOWN, now)
            self._tell(
                "warning",
                "on the ground; activate the bridge again to fly on: iolspi manage bridge fly",
            )
        elif authority in (Authority.HOLD, Authority.OTHER, Authority.PILOT):
            self._give_up(now)
            if self.phase is Phase.TRANSIT and inputs.payload.gone:
                self._enter(Phase.BRAKE, now)  # and from there to the next load
        elif (handle := self._handlers.get(self.phase)) is not None:
            handle(inputs)
        return self._taken()

    # ------------------------------------------------------------ phases

    def _arming(self, i: Inputs) -> None:
        if not i.armed:
            self._decisions.append(Command.SET_GROUND)
        if i.armed and i.controlled:
            self._enter(Phase.TAKEOFF, i.now)
            return
        if i.now - self._since > _AGAIN and self._due(i.now):  # setpoints come first
            self._decisions.append(Command.ARM if i.controlled else Command.REQUEST_CONTROL)
        what = "arming" if i.controlled else "the mode"
        self._tell("delay", f"the autopilot has not accepted {what}")

    def _taking_off(self, i: Inputs) -> None:
        m, height = i.motion, self.settings.height
        if not self._stream_first and m.height < 0.5 and self._due(i.now, _CLIMB_AGAIN):
            self._decisions.append(Command.TAKE_OFF)
        if abs(m.height - height) < 0.4 and abs(m.climb) < 0.5:
            self._next_start(i.now)
        else:
            self._tell("delay", f"still climbing, at {m.height:.1f} m")

    def _in_transit(self, i: Inputs) -> None:
        settled = self.settling.see(i.now, self.target, i.motion)
        self.waits_for = settled.waits_for
        if settled.ready and i.now >= self._probe:
            self._restless = 0
            self._start(i)
        elif settled.expired and settled.waits_for:
            self._elsewhere(i.now)
        elif settled.waits_for:
            self._tell("delay", f"settling at {self._where}: {settled.waits_for}")

    def _elsewhere(self, now: float) -> None:
        """It does not come to rest here: try another start, and give up after some."""
        self._restless += 1
        why = f"no rest at {self._where} in {self.settings.settle_timeout:g} s"
        self._tell("warning", f"{why}: {self.waits_for}")
        if self._restless >= _RESTLESS:
            why = f"it did not come to rest at {_RESTLESS} starts; last: {self.waits_for}"
            self._tell("info", f"land: {why}")
            self._land(now, why)
            return
        self.target = self._draw()
        self._enter(Phase.TRANSIT, now)

    def _in_episode(self, i: Inputs) -> None:
        if self.episode is None or not self.episode.due(i.now):
            return
        observation = self.episode.advance(i.now, i.motion)
        self._show(observation, i.now)
        if observation.last:
            self._ended(i.now)

    def _releasing(self, i: Inputs) -> None:
        if i.payload.reward is not None and self.episode is not None:
            end = self.episode.landed(i.now, self._released, i.payload.reward)
            self._show(end, i.now)
            self._ended(i.now)
        elif i.payload.failure:
            self._tell("warning", i.payload.failure)
            self._give_up(i.now)

    def _braking(self, i: Inputs) -> None:
        if self._fast(i.motion) or i.now - self._since <= _STILL:
            return
        if i.payload.gone:
            self._decisions.append(Command.RELOAD)
            self._enter(Phase.RELOAD, i.now)
        else:
            self._next_start(i.now)

    def _reloading(self, i: Inputs) -> None:
        if i.payload.reloaded:
            self._next_start(i.now)
        elif i.payload.lacking:
            self._tell("delay", f"waiting for a load: {i.payload.lacking}")

    def _landing(self, i: Inputs) -> None:
        if not i.armed:
            self._enter(Phase.DOWN, i.now)
            self._tell("info", "landed")
        elif not i.landing and self._due(i.now):
            self._decisions.append(Command.REQUEST_LANDING)

    # ------------------------------------------------------------ from one to the next

    def _next_start(self, now: float) -> None:
        if self.settings.episodes and self._begun >= self.settings.episodes:
            why = f"{self.flown} episodes flown"
            self._tell("info", f"land: {why}")
            self._land(now, why)
            return
        if self._probe == 0.0:  # else the same again, until somebody answers there
            self.target = self._draw()
        self._enter(Phase.TRANSIT, now)

    def _draw(self) -> Vector:
        swept = self.settings.order == "sweep"
        x, y, height = self.task.sweep(self._begun) if swept else self.task.draw_start(self._rng)
        kept = [
            min(max(place, low), high)
            for place, (low, high) in zip((x, y), self.starts, strict=False)
        ]
        return kept[0], (kept[1] if len(kept) > 1 else y), height

    @property
    def _where(self) -> str:
        """The start that it flies to, in words."""
        names = zip(("x", "y"), self.target[: self.task.axes], strict=False)
        return ", ".join(f"{name} = {place:.1f} m" for name, place in names)

    def _fast(self, m: Motion) -> bool:
        """Whether it still moves along an axis of the task."""
        return math.hypot(*m.velocity[: self.task.axes]) >= _STOPPED

    def _start(self, i: Inputs) -> None:
        self.number += 1
        self._probe = 0.0
        self.episode = EpisodeClock(self.task, self.number, i.now, i.motion)
        self._decisions.append(Command.START_EPISODE)
        self._enter(Phase.EPISODE, i.now)
        self._show(self.episode.first(), i.now)

    def _ended(self, now: float) -> None:
        self.episode = None
        self.flown += 1
        self._begun += 1
        self._enter(Phase.BRAKE, now)

    def _give_up(self, now: float) -> None:
        """End an episode under way without a word: nobody learns from what comes now."""
        if self.episode is not None:
            self.abandoned += self.episode.answered >= 0
            self.episode = None
            self._probe = now + _PROBE
        if self.phase in (Phase.EPISODE, Phase.RELEASE):
            self._enter(Phase.BRAKE, now)

    def _land(self, now: float, why: str) -> None:
        self._give_up(now)
        self.landing_reason = why
        self._enter(Phase.LANDING, now)

    def _enter(self, phase: Phase, now: float) -> None:
        self.phase = phase
        self._since = now
        self.waits_for = ""
        if phase is Phase.TRANSIT:
            self.settling.begin(now)
        self._asked = -np.inf
        self._decisions.append(Enter(phase))

    # ------------------------------------------------------------ small things

    def _due(self, now: float, period: float = _AGAIN) -> bool:
        """Whether to ask the same again, and if so, that it is asked now."""
        due = bool(now - self._asked >= period)
        if due:
            self._asked = now
        return due

    def _tell(self, level: Level, text: str) -> None:
        self._decisions.append(Tell(level, text))

    def _show(self, observation: Observation, now: float) -> None:
        self._decisions.append(Show(observation._replace(stamp=round(now * 1e9))))

    def _taken(self) -> list[Decision]:
        taken, self._decisions = self._decisions, []
        return taken
