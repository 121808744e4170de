"""A flight: take-off, episodes one after the other, landing; no ROS and no thread in here.

`tick` is called at a fixed rate, `take` whenever an action comes. Who commands is decided by
`authority.decide`; this class does what the commander says, and keeps the phases.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink import setpoints
from msg_bridge.mavlink.authority import Commander, Situation, Timeouts, Verdict, decide
from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.drop import Drop
from msg_bridge.mavlink.envelope import Limits, Motion, violation
from msg_bridge.mavlink.episode import Episode
from msg_bridge.mavlink.link import Link
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.profiles import Profile
from msg_bridge.mavlink.setpoints import Push, Stay, Wish
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.sight import Sight
from msg_bridge.mavlink.steering import Steering
from msg_bridge.mavlink.voice import Say, Voice, where
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad

Array = NDArray[np.float64]
_AGAIN = 1.0  # between two requests of the same [s]
_SLOW = 0.3  # a vehicle below this has stopped [m/s]
_JUMPED = 1.0  # so long after a jump of the clock its stamps are not trusted [s]
_STILL = 0.2  # so long after the end it does not begin to look for the next start [s]
_PROBE = 1.0  # between two episodes that nobody has answered [s]


class Flight:
    """One vehicle in the air, with a task.

    Parameters
    ----------
    task : SlungLoad
    link : Link
    profile : Profile
    settings : FlightSettings
    limits : Limits
    timeouts : Timeouts
    show : callable
        Takes each observation of the task.
    say : callable
        Takes words for people.
    """

    def __init__(
        self,
        task: SlungLoad,
        link: Link,
        profile: Profile,
        settings: FlightSettings,
        limits: Limits,
        timeouts: Timeouts,
        show: Callable[[Observation], None],
        say: Say,
    ) -> None:
        self.task, self.link, self.profile, self.settings = task, link, profile, settings
        self.limits, self.timeouts = limits, timeouts
        self._show, self._voice = show, Voice(link.telemetry, say)
        self._track = Track((settings.origin[0], settings.origin[1]), settings.heading)
        self.sight = Sight(
            link.telemetry, self._track, limits.cable, feed=settings.load_source == "feed"
        )
        self._drop = Drop(task, link, profile, settings, self.sight)
        self._steering = Steering(task, profile, settings, limits, self.sight)
        self._lock = threading.RLock()
        self.phase, self.verdict = Phase.IDLE, Verdict(Commander.NOBODY, "not begun")
        self.motion = Motion()
        self.episode: Episode | None = None
        self.flown = self.abandoned = self.violations = 0
        self.paused, self.deadman = False, True
        self.stick: float | None = None
        """Of a person who has taken over, from -1 to 1."""
        self.number = -1
        self._since = self._last = self._asked = self._settled = self._probe = 0.0
        self._alone = 0.0
        self._target = 0.0
        self._begun = 0
        self._rng = np.random.default_rng([settings.seed, 3])
        self._told = (Phase.IDLE, Commander.NOBODY)
        self.on_news: Callable[[Phase, Commander], None] = lambda phase, commander: None
        """Told of each change of who commands, and in which phase."""

    @property
    def step(self) -> int:
        """Of the newest state; -1 between episodes."""
        return -1 if self.episode is None else self.episode.step

    @property
    def interventions(self) -> dict[str, int]:
        """How often each limit of the envelope has changed a setpoint."""
        return dict(self._steering.interventions)

    # ------------------------------------------------------------ told from outside

    def reset(self, now: float, task: SlungLoad, settings: FlightSettings) -> None:
        """Count episodes and draw initial positions from the beginning."""
        with self._lock:
            self.task, self.settings = task, settings
            self._rng = np.random.default_rng([settings.seed, 3])
            self._begun = 0
            self._give_up(now)

    def begin(self, now: float) -> None:
        """Take off, as soon as the vehicle lets us."""
        with self._lock:
            self._last = now
            self._voice.pass_on(now)
            self._alone = 0.0
            self._enter(Phase.GROUND, now)

    def land(self, now: float, why: str) -> None:
        """End the flight."""
        with self._lock:
            if self.phase not in (Phase.IDLE, Phase.DOWN, Phase.LANDING):
                self._give_up(now)
                self.verdict = Verdict(Commander.LAND, why)
                self._voice.say("info", f"land: {why}")
                self._enter(Phase.LANDING, now)

    def take(self, number: int, step: int, action: int, now: float) -> bool:
        """Take an action and fly it at once; False when it answers no state of this episode."""
        with self._lock:
            episode = self.episode
            if episode is None or number != episode.number or self.phase is not Phase.EPISODE:
                return False
            if not episode.answer(step, action):
                return False
            self._alone = 0.0
            if action == RELEASE and self._decide(now).commander is Commander.ACTOR:
                self._drop.begin(self._state(), self.motion, now)
                self._enter(Phase.FALL, now)
            self._fly(now)
            return True

    # ------------------------------------------------------------ every tick

    def listen(self, now: float) -> None:
        """Take what has come."""
        with self._lock:
            self.link.poll(now)

    def tick(self, now: float) -> None:
        """Take what has come, decide, move on, and send a setpoint."""
        with self._lock:
            self.link.poll(now)
            self._voice.pass_on(now)
            self._fly(now)

    def _fly(self, now: float) -> None:
        dt = now - self._last
        self._last = now
        if self.episode is not None and self.phase is Phase.EPISODE:
            self.episode.hold(self._steering.applied, dt)
            if self.episode.answered < 0:
                self._alone += dt
        elif self.phase is Phase.FERRY and self._probe > 0.0:
            self._alone += dt
        self.motion = self.sight.motion(now)
        before, self.verdict = self.verdict, self._decide(now)
        if self.verdict != before:
            self.violations += self.verdict.reason.startswith("envelope")
            # Of who has not begun to answer there is no news: it is asked every second.
            if self.episode is None or self.episode.answered >= 0:
                self._voice.verdict(before, self.verdict)
        self._tell()
        self._go_on(now)
        self._tell()
        wish = self._steering.wish(
            self.verdict.commander, self.phase, self.motion, wanted=self._wanted(),
            target=self._target, stick=self.stick or 0.0, dt=max(dt, 1e-3),
        )  # fmt: skip
        if wish is not None:
            self._send(wish, now)

    def _decide(self, now: float) -> Verdict:
        if self.phase in (Phase.IDLE, Phase.DOWN):
            return Verdict(Commander.NOBODY, "not flying")
        if self.phase is Phase.LANDING:
            return Verdict(Commander.LAND, self.verdict.reason)
        if self.phase is Phase.GROUND:
            return Verdict(Commander.BRIDGE)
        return decide(self._situation(now), self.timeouts)

    def _situation(self, now: float) -> Situation:
        t, episode = self.link.telemetry, self.phase is Phase.EPISODE
        hanging = self.phase in (Phase.FERRY, Phase.EPISODE)
        answered = self.episode.answered_time if self.episode is not None else now
        return Situation(
            silence=now - t.heard_time,
            telemetry_age=now - t.position_time,
            armed=t.armed,
            controlled=t.mode == self.profile.controlled,
            lost=max(now - t.lost_time, 0.0),
            round_trip=t.round_trip,
            load_age=self.sight.load_age(now) if hanging else 0.0,
            episode=episode,
            action_age=now - answered,
            alone=self._alone,
            violation=violation(self.limits, self.motion) if episode else "",
            pilot=self.stick is not None,
            deadman=self.deadman or self.phase is Phase.CLIMB,
            jumped=now - t.jump_time < _JUMPED,
            paused=self.paused,
        )

    def _tell(self) -> None:
        """Tell who commands in which phase, when that has changed."""
        news = (self.phase, self.verdict.commander)
        if news != self._told:
            self._told = news
            self.on_news(*news)

    # ------------------------------------------------------------ phases

    def _enter(self, phase: Phase, now: float) -> None:
        self.phase, self._since = phase, now
        self._settled = now
        self._voice.begin(now)
        self._asked = -_AGAIN
        self._steering.begin()

    def _go_on(self, now: float) -> None:
        """Move on to the next phase when it is time."""
        commander = self.verdict.commander
        if self.phase is Phase.LANDING:
            self._landing(now)
        elif commander is Commander.LAND:
            self._give_up(now)
            self._enter(Phase.LANDING, now)
        elif commander is Commander.OTHER and not self.link.telemetry.armed:
            self._give_up(now)
            self._enter(Phase.DOWN, now)
            self._voice.say("warning", "on the ground; activate the bridge again to fly on")
        elif commander in (Commander.HOLD, Commander.OTHER, Commander.PILOT):
            self._give_up(now)
        elif (handle := _HANDLERS.get(self.phase)) is not None:
            handle(self, now)

    def _give_up(self, now: float) -> None:
        """End an episode under way without a word: nobody learns from what comes now."""
        if self.episode is not None:
            self.abandoned += self.episode.answered >= 0
            self.episode = None
            self._probe = now + _PROBE
        if self.phase in (Phase.EPISODE, Phase.FALL):
            self._enter(Phase.BRAKE, now)

    def _ground(self, now: float) -> None:
        t = self.link.telemetry
        if not t.armed:
            self.sight.stand()
        if t.armed and t.mode == self.profile.controlled:
            self._enter(Phase.CLIMB, now)
            return
        if now - self._asked >= _AGAIN and now - self._since > _AGAIN:  # setpoints come first
            self._asked = now
            if t.mode != self.profile.controlled:
                self.link.ask_mode(self.profile, self.profile.controlled)
            elif not t.armed:
                self.link.arm(True)
        what = "the mode" if t.mode != self.profile.controlled else "arming"
        self._voice.complain(now, f"the autopilot has not accepted {what}")

    def _climb(self, now: float) -> None:
        if not self.profile.stream_first and now - self._asked >= 3.0 and self.motion.height < 0.5:
            self._asked = now
            self.link.take_off(self.settings.height)
        if abs(self.motion.height - self.settings.height) < 0.4 and abs(self.motion.climb) < 0.5:
            self._next_start(now)
            return
        self._voice.complain(now, f"still climbing, at {self.motion.height:.1f} m")

    def _next_start(self, now: float) -> None:
        if self.settings.episodes and self._begun >= self.settings.episodes:
            self.land(now, f"{self.flown} episodes flown")
            return
        starts = self.task.initial_states()
        if self.settings.order == "sweep":
            places = np.unique(starts[:, 0])
            self._target = float(places[self._begun % len(places)])
        else:
            self._target = float(self.task.draw_initial(self._rng)[0])
        self._probe = 0.0
        self._enter(Phase.FERRY, now)

    def _ferrying(self, now: float) -> None:
        m, swing = self.motion, self.settings.settle_swing
        there = (
            abs(m.x - self._target) < 0.1 and abs(m.speed) < 0.1 and abs(m.across) < 0.4
            and abs(m.height - self.settings.height) < 0.6
            and abs(m.swing) < swing and abs(m.swing_rate) < 3.0 * swing
        )  # fmt: skip
        if not there:
            self._settled = now
            self._voice.complain(now, f"settling at x = {self._target:.1f} m, {where(m)}")
        elif now - self._settled >= self.settings.settle_time and now >= self._probe:
            self._start(now)

    def _start(self, now: float) -> None:
        self.number += 1
        state = self._state()
        self.episode = Episode(self.task, self.number, now, state)
        self._steering.rest()
        self._enter(Phase.EPISODE, now)
        self._show(self._stamped(self.episode.first(), now))

    def _flying(self, now: float) -> None:
        episode = self.episode
        if episode is None or not episode.due(now):
            return
        observation = self._stamped(episode.advance(now, self._state()), now)
        self._show(observation)
        if observation.last:
            self._ended(now)

    def _ended(self, now: float) -> None:
        self.episode = None
        self.flown += 1
        self._begun += 1
        self._enter(Phase.BRAKE, now)

    def _falling(self, now: float) -> None:
        reward = self._drop.reward(now)
        if reward is not None and self.episode is not None:
            observation = self.episode.dropped(now, self._drop.state, RELEASE, reward)
            self._show(self._stamped(observation, now))
            self._ended(now)
        elif failure := self._drop.failure(now):
            self._voice.say("warning", failure)
            self._give_up(now)

    def _braking(self, now: float) -> None:
        if abs(self.motion.speed) < _SLOW and now - self._since > _STILL:
            if self._drop.needed:
                self._drop.reload(now)
                self._enter(Phase.RELOAD, now)
            else:
                self._next_start(now)

    def _reloading(self, now: float) -> None:
        if self._drop.reloaded(now):
            self._next_start(now)
        elif lacking := self._drop.lacking(now):
            self._voice.complain(now, f"waiting for a load: {lacking}")

    def _landing(self, now: float) -> None:
        t = self.link.telemetry
        if not t.armed:
            self._enter(Phase.DOWN, now)
            self._voice.say("info", "landed")
        elif t.mode != self.profile.landing and now - self._asked >= _AGAIN:
            self._asked = now
            self.link.ask_mode(self.profile, self.profile.landing)

    # ------------------------------------------------------------ setpoints

    def _wanted(self) -> float:
        """Acceleration of the action in force [m/s²]."""
        action = self.task.neutral if self.episode is None else self.episode.action
        return float(self.task.actions[action])

    def _send(self, wish: Wish, now: float) -> None:
        if isinstance(wish, Push | Stay):
            wish = wish._replace(height=self.sight.up(wish.height))
        try:
            message = setpoints.packet(wish, self.profile, self._track, self.link.target, now)
        except ValueError as error:
            self._voice.say("warning", f"not sent: {error}")
            return
        self.link.send(message)

    # ------------------------------------------------------------ small things

    def _state(self) -> Array:
        m = self.motion
        return np.array([m.x, m.speed, m.swing, m.swing_rate])

    def _stamped(self, observation: Observation, now: float) -> Observation:
        return observation._replace(stamp=round(now * 1e9))


_HANDLERS: dict[Phase, Callable[[Flight, float], None]] = {
    Phase.GROUND: Flight._ground,
    Phase.CLIMB: Flight._climb,
    Phase.FERRY: Flight._ferrying,
    Phase.EPISODE: Flight._flying,
    Phase.FALL: Flight._falling,
    Phase.BRAKE: Flight._braking,
    Phase.RELOAD: Flight._reloading,
}
