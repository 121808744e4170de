"""A flight: take-off, episodes one after the other, landing; no ROS and no thread in here.

`tick` is called at a fixed rate, `act` whenever an action comes, from any thread. Who commands is
decided by `arbiter`, which phase follows by `PhaseMachine`; this class measures, lets them decide,
and does it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from dataclasses import replace
from math import sqrt
from typing import Any

from iolspi_ros.errors import InputError
from msg_bridge.mavlink import setpoints
from msg_bridge.mavlink.arbiter import Authority, Ruling, Situation, Timeouts, arbitrate
from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.envelope import Limits, starts, violation, widened
from msg_bridge.mavlink.estimator import StateEstimator
from msg_bridge.mavlink.flown import check_room, flown
from msg_bridge.mavlink.guidance import Guidance
from msg_bridge.mavlink.joystick import SafetyPilot
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.motion import Motion
from msg_bridge.mavlink.payload import Payload
from msg_bridge.mavlink.phase_machine import Inputs, PhaseMachine
from msg_bridge.mavlink.phases import Command, Decision, Enter, Phase, Show
from msg_bridge.mavlink.plausibility import VehicleCheck
from msg_bridge.mavlink.prediction import chance
from msg_bridge.mavlink.profiles import AutopilotProfile
from msg_bridge.mavlink.setpoints import AccelerationSetpoint, PositionSetpoint, Setpoint
from msg_bridge.mavlink.settings import FlightSettings
from msg_bridge.mavlink.settling import NOISE
from msg_bridge.mavlink.status import AuthorityChange, Outputs, StatusReporter
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

_CHECKED = (Phase.TAKEOFF, Phase.TRANSIT, Phase.EPISODE, Phase.RELEASE, Phase.BRAKE, Phase.RELOAD)
_NEWS = 10.0  # between two words that it was restarted [s]
_BEATS = 3.0  # an autopilot with nothing but heartbeats was heard so lately [s]
_NO_POSITION = 2.0  # without one, and between two times that messages are asked for again [s]
_JUMPED = 1.0  # so long after a jump of the clock its stamps are not trusted [s]


class Flight:
    """One vehicle in the air, with a task.

    Parameters
    ----------
    task : SlungLoad or SlungLoad3D
    link : AutopilotLink
    profile : AutopilotProfile
    settings : FlightSettings
    limits : Limits
    timeouts : Timeouts
    outputs : Outputs
    release_output : int, optional
        Which output of the autopilot lets the load go: see `Payload`.

    Raises
    ------
    InputError
        When the task does not fit into the envelope.
    """

    def __init__(
        self,
        task: SlungLoad | SlungLoad3D,
        link: AutopilotLink,
        profile: AutopilotProfile,
        settings: FlightSettings,
        limits: Limits,
        timeouts: Timeouts,
        outputs: Outputs,
        release_output: int | None = None,
    ) -> None:
        self.link, self.profile = link, profile
        known = flown(task, settings)
        # What the learner may do leaves room for a bridge that dies at the worst moment. What the
        # vehicle brakes with is shared by the axes, when it flies fast along both.
        limits = replace(
            limits,
            held=max(limits.held, profile.held),
            leaning=max(limits.leaning, profile.leaning),
            braking=min(limits.braking, profile.stopping) / sqrt(known.axes),
        )
        check_room(known, settings, widened(limits, profile.noise, profile.speed_noise))
        self.limits, self.timeouts = limits, timeouts
        self.rate = settings.rate
        self._outputs = outputs
        self._reporter = StatusReporter(link.telemetry, outputs.say)
        self._track = Track((settings.origin[0], settings.origin[1]), settings.heading)
        self._estimator = StateEstimator(
            link.telemetry, self._track, limits.cable, feed=settings.load_source == "feed",
            share=settings.load_share,
        )  # fmt: skip
        self._estimator.unsteady(profile.speed_noise)
        self._felt = settings.load_share > 0.0
        self._machine = PhaseMachine(known, settings, stream_first=profile.stream_first)
        self._payload = Payload(known, link, profile, settings, self._estimator, release_output)
        self._guidance = Guidance(known, profile, settings, limits, self._estimator)
        self._widen()
        self._check = VehicleCheck()
        self._lock = threading.RLock()
        self._ruling = Ruling(Authority.NOBODY, "not begun")
        self._motion = Motion()
        self._pilot = SafetyPilot()
        self._violations = 0
        self._chances: list[float] = []
        self._last = self._asked = self._stalled = 0.0
        self._restarts, self._restarted = link.telemetry.restarts, -_NEWS
        self._told = (Phase.IDLE, Authority.NOBODY)
        self._commands: dict[Command, Callable[[float], object]] = {
            Command.REQUEST_CONTROL: lambda _: link.ask_mode(profile, profile.controlled),
            Command.REQUEST_LANDING: lambda _: link.ask_mode(profile, profile.landing),
            Command.ARM: lambda _: link.arm(True),
            Command.TAKE_OFF: lambda _: link.take_off(settings.height),
            Command.SET_GROUND: lambda _: self._estimator.stand(),
            Command.START_EPISODE: lambda _: self._start_episode(),
            Command.RELEASE: self._release,
            Command.RELOAD: lambda now: self._payload.reload(now),
        }

    # ------------------------------------------------------------ how it stands

    @property
    def phase(self) -> Phase:
        """Where it is."""
        return self._machine.phase

    @property
    def in_flight(self) -> bool:
        """Whether the vehicle is ours to command."""
        return self._machine.in_flight

    @property
    def ruling(self) -> Ruling:
        """Who commands, and why."""
        return self._ruling

    @property
    def motion(self) -> Motion:
        """Where everything was at the last tick."""
        return self._motion

    @property
    def step(self) -> int:
        """Of the newest state; -1 between episodes."""
        episode = self._machine.episode
        return -1 if episode is None else episode.step

    @property
    def answered_time(self) -> float | None:
        """Of the newest state that was answered [s]; None between episodes."""
        episode = self._machine.episode
        return None if episode is None else episode.answered_time

    @property
    def flown(self) -> int:
        """Episodes that came to an end."""
        return self._machine.flown

    @property
    def abandoned(self) -> int:
        """Episodes that were broken off."""
        return self._machine.abandoned

    @property
    def violations(self) -> int:
        """How often the envelope was left."""
        return self._violations

    def status(self) -> dict[str, Any]:
        """How it stands, for people."""
        with self._lock:
            t, machine = self.link.telemetry, self._machine
            mode = self.profile.mode_name(t.mode)
            return {
                "phase": machine.phase.name.lower(),
                "authority": self._ruling.authority.name.lower(),
                "reason": self._ruling.reason,
                "waiting for": machine.waits_for,
                "noise at rest": dict(zip(NOISE, machine.settling.noise.round(3), strict=True)),
                "margin [m]": round(self._guidance.limits.margin, 3),
                "autopilot": f"{self.profile.name}, {mode}, {'armed' if t.armed else 'disarmed'}",
                "load": "reported by its own system" if self._estimator.feed else "estimated",
                "round trip [s]": round(t.round_trip, 4),
                "episodes flown": machine.flown,
                "episodes abandoned": machine.abandoned,
                "releases": {str(seen): n for seen, n in self._payload.releases.items()},
                "last chance": f"{self._chances[-1]:.0%}" if self._chances else "",
                "chances": f"{sum(self._chances):.1f} of {len(self._chances)}",
                "envelope left": self._violations,
                "envelope interventions": dict(self._guidance.interventions),
                "packets rejected": self.link.codec.rejected,
                "packets played back": self.link.codec.stale,
                "packets not believed": dict(self.link.sources.others),
                "datagrams unread": self.link.unread,
                "other systems heard": dict(t.strangers),
            }

    # ------------------------------------------------------------ told from outside

    def check(self) -> None:
        """What only a flight can tell before it begins.

        Raises
        ------
        InputError
            Why it should not.
        """
        with self._lock:
            self._estimator.check_feed()
            if not self.link.telemetry.armed:
                self._check_place()

    def _check_place(self) -> None:
        """Refuse to take off outside the box.

        Raises
        ------
        InputError
            Where it stands, and what is allowed.
        """
        limits, wide = self.limits, self.limits.corridor
        sides = (*limits.sides, (-wide, wide))[:2]  # of one axis the corridor is the other
        for name, place, (low, high) in zip("xy", self._estimator.place(), sides, strict=False):
            if not low <= place <= high:
                raise InputError(
                    f"it stands at {name} = {place:.1f} m, outside the box of {low:g} to "
                    f"{high:g} m; allowed: inside, or another origin (--bridge origin=[east,north])"
                )

    def reset(self, now: float, task: SlungLoad | SlungLoad3D, settings: FlightSettings) -> None:
        """Count episodes and draw initial positions from the beginning."""
        with self._lock:
            self._do(self._machine.reset(now, flown(task, settings), settings), now)

    def begin(self, now: float) -> None:
        """Take off, as soon as the vehicle lets us."""
        with self._lock:
            self._last = now
            self._reporter.relay()
            self._do(self._machine.begin(now), now)

    def land(self, now: float, why: str) -> None:
        """End the flight."""
        with self._lock:
            self._do(self._machine.land(now, why), now)

    def supervise(self, **changes: Any) -> None:
        """Take what the safety pilot does: fields of `SafetyPilot`, as far as they change."""
        with self._lock:
            self._pilot = self._pilot._replace(**changes)

    def act(self, number: int, step: int, action: int, now: float, source: int = -1) -> bool:
        """Take an action and fly it at once; False when it answers no state of this episode."""
        with self._lock:
            if not self._machine.answer(number, step, action, source):
                return False
            released = action == self._machine.task.release
            if released and self._arbitrate(now).authority is Authority.ACTOR:
                self._do(self._machine.release(now, self._motion), now)
            self._fly(now)
            return True

    # ------------------------------------------------------------ every tick

    def listen(self, now: float, more: Callable[[], bool] = lambda: True) -> bool:
        """Take what has come while there is time for `more`; whether that was all."""
        with self._lock:
            done = self.link.poll(now, more)
            self.link.telemetry.behind &= not done
            return done

    def tick(self, now: float) -> None:
        """Decide, move on, and send a setpoint."""
        with self._lock:
            self._reporter.relay()
            self._reporter.line(self.link)
            self._ask_again(now)
            self._fly(now)

    def _ask_again(self, now: float) -> None:
        """Ask for messages once more of who is heard, but not with them: it was restarted."""
        t = self.link.telemetry
        if t.restarts > self._restarts:
            self._restarts = t.restarts
            if now - self._restarted > _NEWS:
                self._restarted = now
                self._outputs.say("warning", "the autopilot was restarted")
        heard, asked = now - t.heard_time < _BEATS, now - self._asked
        if heard and now - t.position_time > _NO_POSITION and asked > _NO_POSITION:
            self._asked = now
            self.link.ask_rates(self.profile, felt=self._felt)

    def _fly(self, now: float) -> None:
        dt = now - self._last
        self._last = now
        self._stalled = dt
        if dt > self.timeouts.telemetry_timeout:  # what was last heard is where it was long ago
            self.link.telemetry.behind = True
            self.link.telemetry.behind = not self.link.poll(now)
        self._machine.pass_time(dt, self._guidance.applied)
        self._motion = self._estimator.motion(now)
        self._look(now)
        self._judge(now)
        self._tell_change(now)
        self._do(self._machine.step(self._inputs(now)), now)
        self._tell_change(now)
        wanted = self._guidance.setpoint(
            self._ruling.authority, self._machine.phase, self._motion, wanted=self._wanted(),
            target=self._machine.target, stick=self._pilot.stick or (0.0, 0.0), dt=max(dt, 1e-3),
        )  # fmt: skip
        if isinstance(wanted, AccelerationSetpoint):
            axes = self._machine.task.axes
            self._check.ask(now, wanted[:axes], self._motion.velocity[:axes])
        else:
            self._check.asked_nothing()
        if wanted is not None:
            self._send(wanted, now)

    def _look(self, now: float) -> None:
        """Let it be checked whether what was heard is possible, whoever commands it in the air."""
        t = self.link.telemetry
        if self._machine.phase in _CHECKED:
            self._check.see(now, t.boot, t.position, t.velocity)
        else:
            self._check.forget()

    def _impossible(self) -> str:
        """Why what was heard cannot be: as it rises, what stands still and does not obey can."""
        check = self._check
        rises = self._machine.phase is Phase.TAKEOFF
        return check.strayed() if rises else check.impossible()

    def _judge(self, now: float) -> None:
        """Let it be decided who commands, and say so when that has changed."""
        before, self._ruling = self._ruling, self._arbitrate(now)
        if self._ruling != before:
            self._violations += self._ruling.reason.startswith("envelope")
            # Of who has not begun to answer there is no news: it is asked every second.
            episode, lands = self._machine.episode, self._ruling.authority is Authority.LAND
            if lands or episode is None or episode.answered >= 0:
                self._reporter.ruling(before, self._ruling)

    def _arbitrate(self, now: float) -> Ruling:
        machine = self._machine
        if not machine.in_flight:
            return Ruling(Authority.NOBODY, "not flying")
        if machine.phase is Phase.LANDING:
            return Ruling(Authority.LAND, machine.landing_reason)
        if machine.phase is Phase.ARMING:
            return Ruling(Authority.BRIDGE)
        return arbitrate(self._situation(now), self.timeouts)

    def _situation(self, now: float) -> Situation:
        t, machine = self.link.telemetry, self._machine
        in_episode = machine.phase is Phase.EPISODE
        hanging = machine.phase in (Phase.TRANSIT, Phase.EPISODE)
        answered = now if machine.episode is None else machine.episode.answered_time
        return Situation(
            silence=now - t.heard_time,
            telemetry_age=now - t.position_time,
            stalled=self._stalled,
            armed=t.armed,
            controlled=t.mode == self.profile.controlled,
            mode=self.profile.mode_name(t.mode),
            failsafe=t.failsafe,
            lost=max(now - t.lost_time, 0.0),
            round_trip=t.round_trip,
            load_age=self._estimator.load_age(now) if hanging else 0.0,
            load_doubt=self._estimator.load_doubt(now) if hanging else "",
            impossible=self._impossible(),
            episode=in_episode,
            action_age=now - answered,
            unanswered=machine.unanswered,
            violation=violation(self.limits, self._motion) if in_episode else "",
            pilot=self._pilot.stick is not None,
            deadman=self._pilot.deadman or machine.phase is Phase.TAKEOFF,
            jumped=t.jump if now - t.jump_time < _JUMPED else "",
            paused=self._pilot.paused,
        )

    def _inputs(self, now: float) -> Inputs:
        t, profile = self.link.telemetry, self.profile
        return Inputs(
            now, self._ruling.authority, self._ruling.reason, self._motion, t.armed,
            controlled=t.mode == profile.controlled, landing=t.mode == profile.landing,
            payload=self._payload.report(self._machine.phase, now),
        )  # fmt: skip

    # ------------------------------------------------------------ what was decided

    def _do(self, decisions: Iterable[Decision], now: float) -> None:
        for decision in decisions:
            if isinstance(decision, Command):
                self._commands[decision](now)
            elif isinstance(decision, Enter):
                self._reporter.begin(now)
                self._guidance.begin()
                if decision.phase is Phase.LANDING:
                    self._ruling = Ruling(Authority.LAND, self._machine.landing_reason)
            elif isinstance(decision, Show):
                self._outputs.show(decision.observation)
            elif decision.level == "delay":
                self._reporter.delay(now, decision.text)
            else:
                self._outputs.say(decision.level, decision.text)

    def _tell_change(self, now: float) -> None:
        """Tell who commands in which phase, when that has changed."""
        news = (self._machine.phase, self._ruling.authority)
        if news != self._told:
            self._told = news
            self._outputs.change(AuthorityChange(self._machine.number, self.step, now, *news))

    def _release(self, now: float) -> None:
        """Let the load go, and say how likely that is right, as well as it is known where it is."""
        self._payload.release(self._motion, now)
        spread = self._estimator.load.covariance[:6, :6]
        likely = chance(self._machine.task, self._motion, spread, self._noise)
        self._chances.append(likely)
        text = f"episode {self._machine.number}: let go; it falls inside with a chance of"
        self._outputs.say("info", f"{text} {likely:.0%}")

    @property
    def _noise(self) -> tuple[float, float]:
        """Of the position [m] and the speed [m/s]: measured at rest, or what is counted on."""
        position, speed = self._machine.settling.noise[:2].tolist()
        return max(self.profile.noise, position), max(self.profile.speed_noise, speed)

    def _start_episode(self) -> None:
        self._widen()
        self._guidance.rest()

    def _widen(self) -> None:
        """Leave as much room to the walls as the noise asks for."""
        self._guidance.limits = widened(self.limits, *self._noise)
        limits = self._guidance.limits
        self._machine.starts = tuple(starts(limits, axis) for axis in range(limits.axes))

    def _wanted(self) -> tuple[float, ...]:
        """Accelerations of the action in force [m/s²]."""
        task, episode = self._machine.task.description, self._machine.episode
        return task.actions[task.neutral if episode is None else episode.action].value

    def _send(self, setpoint: Setpoint, now: float) -> None:
        if isinstance(setpoint, AccelerationSetpoint | PositionSetpoint):
            setpoint = setpoint._replace(height=self._estimator.up(setpoint.height))
        try:
            message = setpoints.packet(setpoint, self.profile, self._track, self.link.target, now)
        except ValueError as error:
            self._outputs.say("warning", f"not sent: {error}")
            return
        self.link.send(message)
