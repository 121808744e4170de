"""An embedded autopilot, a bridge and somebody who acts, all in this process."""

import contextlib
import queue
import threading
import time

import numpy as np

from msg_bridge.mavlink.authority import Commander, Timeouts
from msg_bridge.mavlink.envelope import Limits, violation
from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.link import Link
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.preflight import Preflight
from msg_bridge.mavlink.runner import Clock, Runner
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url
from sim_nodes.autopilot.dynamics import LOAD, POSITION, VELOCITY
from sim_nodes.autopilot.server import Sitl
from sim_nodes.pilots import SlungLoadPerform
from sim_nodes.tasks import SlungLoad

FACTOR = 4.0
"""Vehicle seconds per second: the machine that tests has other work, too."""
GRIPPER = {"GRIP_ENABLE": 1, "SERVO9_FUNCTION": 28}
TIMEOUTS = Timeouts(action_timeout=0.3, telemetry_timeout=0.6, round_trip_limit=0.5)
"""A little more patient than by default: the clock here runs four times as fast."""


def parameters(like, factor=FACTOR, **changed):
    known = {"SIM_SPEEDUP": factor, "SIM_LOAD_RATE": 20.0}
    return known | (GRIPPER if like == "ardupilot" else {}) | changed


def pilot(task):
    """Who swings the load in and drops it, with more verve than the scripted pilot."""
    law = SlungLoadPerform(task, np.random.default_rng(0))
    law.swing, law.margin = 2.5, 1.3
    return lambda seen: law.decide(seen.state, 0.0)


class Flying:
    """A vehicle ready to fly; `act` answers observations in a thread of its own."""

    def __init__(self, folder, like, act=None, *, timeouts=TIMEOUTS, limits=None, **options):
        factor = options.pop("factor", FACTOR)
        changed = options.pop("autopilot", {})
        keys = options.pop("keys", (None, None))
        self.task = SlungLoad(initial=options.pop("initial", "wide"))
        self.limits = limits or Limits()
        self.like = like
        self.sitl = Sitl(
            like, ["udpin:127.0.0.1:0", "udpin:127.0.0.1:0"], parameters(like, factor, **changed),
            ready_after=2.0, key=keys[0],
        )  # fmt: skip
        (host, port), self.other = self.sitl.addresses
        self.telemetry = Telemetry(options.pop("system", 1), 2)
        self.link = Link(
            open_url(f"udpout:{host}:{port}"), self.telemetry, keys[1], folder / "flight.tlog"
        )
        self.settings = FlightSettings(real_time_factor=factor, **options)
        self.clock = Clock(factor)
        self.checklist, self.said, self.seen, self.sent = [], [], [], []
        self.preflight = Preflight(
            self.link, LinkSettings(patience=20.0), self.settings, self.clock.now,
            folder / "before.json", self.checklist.append,
        )  # fmt: skip
        self.act = act or pilot(self.task)
        self._folder, self._timeouts = folder, timeouts
        self._queue = queue.SimpleQueue()
        self._stack = contextlib.ExitStack()

    def __enter__(self):
        self._stack.enter_context(self.sitl)
        try:
            self.profile = self.preflight.run()
        except BaseException:
            self._stack.close()
            self.link.close()
            raise
        self.flight = Flight(
            self.task, self.link, self.profile, self.settings, self.limits, self._timeouts,
            self._show, self._say,
        )  # fmt: skip
        send = self.link.send

        def tapped(message):
            self.sent.append((self.clock.now(), message))
            return send(message)

        self.link.send = tapped
        self.runner = Runner(self.flight, self.clock, self._say)
        self._actor = threading.Thread(target=self._answer, daemon=True)
        self._actor.start()
        self.flight.begin(self.clock.now())
        return self

    def __exit__(self, *_):
        self._queue.put(None)
        self._actor.join()
        self.runner.stop()
        self.link.close()
        self._stack.close()

    # ------------------------------------------------------------ who is told

    def _show(self, observation):
        self.seen.append((self.clock.now(), observation))
        self._queue.put(observation)

    def _say(self, level, text):
        self.said.append((self.clock.now(), level, text))

    def _answer(self):
        while (observation := self._queue.get()) is not None:
            action = None if observation.last else self.act(observation)
            if action is not None:
                self.flight.take(observation.episode, observation.step, action, self.clock.now())

    # ------------------------------------------------------------ for tests

    def until(self, ready, deadline=40.0):
        """Wait for something; `deadline` in seconds of the machine."""
        end = time.monotonic() + deadline
        while not ready():
            assert time.monotonic() < end, f"{self.flight.report()}\n{self.words()}"
            time.sleep(0.002)

    def words(self):
        return "\n".join(f"{when:.2f} {level}: {text}" for when, level, text in self.said)

    def heard(self, text):
        return any(text in words for _, _, words in self.said)

    def wait(self, seconds):
        """Let vehicle time pass."""
        end = self.clock.now() + seconds
        self.until(lambda: self.clock.now() >= end, 60.0)

    def change(self, name, value):
        with self.sitl.lock:
            self.sitl.autopilot.change(name, value)

    def body(self):
        """The truth: position and velocity of quadrotor and load, ENU; heights over the ground."""
        with self.sitl.lock:
            state = self.sitl.autopilot.body.state.copy()
        ned = np.array([state[POSITION], state[VELOCITY], state[LOAD]])
        return ned[:, [1, 0, 2]] * (1.0, 1.0, -1.0)

    @property
    def broken(self):
        return self.sitl.autopilot.body.broken

    @property
    def ends(self):
        """Last observations of the episodes so far."""
        return [seen for _, seen in self.seen if seen.last]

    def episodes(self, n, deadline=60.0):
        """Until `n` more episodes have been flown to their ends."""
        until = len(self.ends) + n
        self.until(lambda: len(self.ends) >= until, deadline)
        return self.ends[-n:]

    def in_episode(self, step=3):
        """Until somebody acts in the middle of an episode."""
        self.until(
            lambda: (
                self.flight.phase is Phase.EPISODE
                and self.flight.verdict.commander is Commander.ACTOR
                and self.flight.step >= step
            )
        )

    def setpoints(self, since):
        """Times and messages of the setpoints sent."""
        name = "SET_POSITION_TARGET_LOCAL_NED"
        return [(t, m) for t, m in list(self.sent) if t >= since and m.get_type() == name]

    def inside(self):
        """Whether the truth is inside the envelope."""
        position, velocity, _ = self.body()
        motion = self.flight.motion._replace(
            x=position[0], speed=velocity[0], across=position[1], height=position[2], swing=0.0
        )
        return violation(self.limits, motion) == ""
