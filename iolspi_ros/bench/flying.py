"""An embedded autopilot, a bridge and somebody who acts, all in one process."""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink.authority import Commander, Timeouts
from msg_bridge.mavlink.envelope import Limits, violation
from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.link import Link
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.preflight import Item, Preflight
from msg_bridge.mavlink.runner import Clock, Runner
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url
from msg_bridge.mavlink.voice import report
from sim_nodes.autopilot.dynamics import LOAD, POSITION, VELOCITY
from sim_nodes.autopilot.server import Sitl
from sim_nodes.pilots import SlungLoadPerform
from sim_nodes.tasks.slung_load import SlungLoad

Array = NDArray[np.float64]
Act = Callable[[Observation], int | None]
"""What somebody does with an observation; None for nothing."""

FACTOR = 4.0
"""Vehicle seconds per second."""
GRIPPER = {"GRIP_ENABLE": 1.0, "SERVO9_FUNCTION": 28.0}
"""What ArduCopter must have booted with to have a gripper."""
PATIENT = Timeouts(action_timeout=0.3, telemetry_timeout=0.6, round_trip_limit=0.5)
"""For clocks that run faster: delays of a machine with other work count as many times."""


def parameters(like: str, factor: float, **changed: float) -> dict[str, float]:
    """What the embedded autopilot boots with, for a load that reports itself and can be let go."""
    known = {"SIM_SPEEDUP": factor, "SIM_LOAD_RATE": 20.0}
    return known | (GRIPPER if like == "ardupilot" else {}) | changed


def pilot(task: SlungLoad) -> Act:
    """Who swings the load in and drops it, with more verve than the scripted pilot."""
    law = SlungLoadPerform(task, np.random.default_rng(0))
    law.swing, law.margin = 2.5, 1.3
    return lambda seen: law.decide(seen.state, 0.0)


class Flying:
    """A vehicle that takes off; `act` answers its observations in a thread of its own.

    Parameters
    ----------
    folder : Path
        For the log, and for the parameters as they were.
    like : str
        px4 or ardupilot.
    act : callable, optional
        A pilot who knows how by default.
    factor : float
        Vehicle seconds per second.
    timeouts : Timeouts
    system : int
        Whom the bridge expects.
    keys : (bytes or None, bytes or None)
        Of the autopilot's and the bridge's signatures.
    initial : str
        Of the task.
    autopilot : dict of str to float, optional
        Parameters that the autopilot boots with.
    **settings
        Of the flight.
    """

    def __init__(
        self,
        folder: Path,
        like: str,
        act: Act | None = None,
        *,
        factor: float = FACTOR,
        timeouts: Timeouts = PATIENT,
        system: int = 1,
        keys: tuple[bytes | None, bytes | None] = (None, None),
        initial: str = "wide",
        autopilot: dict[str, float] | None = None,
        **settings: Any,
    ) -> None:
        self.task, self.limits = SlungLoad(initial=initial), Limits()
        self.sitl = Sitl(
            like, ["udpin:127.0.0.1:0", "udpin:127.0.0.1:0"],
            parameters(like, factor, **(autopilot or {})), ready_after=2.0, key=keys[0],
        )  # fmt: skip
        (host, port), self.other = self.sitl.addresses
        self.telemetry = Telemetry(system, 2)
        log = folder / "flight.tlog"
        self.link = Link(open_url(f"udpout:{host}:{port}"), self.telemetry, keys[1], log)
        self.settings = FlightSettings(real_time_factor=factor, **settings)
        self.clock = Clock(factor)
        self.checklist: list[Item] = []
        self.said: list[tuple[float, str, str]] = []
        self.seen: list[tuple[float, Observation]] = []
        self.sent: list[tuple[float, Any]] = []
        self.preflight = Preflight(
            self.link, LinkSettings(patience=20.0), self.settings, self.clock.now,
            folder / "before.json", self.checklist.append,
        )  # fmt: skip
        self.act = act or pilot(self.task)
        self._timeouts = timeouts
        self._queue: queue.SimpleQueue[Observation | None] = queue.SimpleQueue()
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Flying:
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

        def tapped(message: Any) -> bool:
            self.sent.append((self.clock.now(), message))
            return send(message)

        self.link.send = tapped  # type: ignore[method-assign]
        self.runner = Runner(self.flight, self.clock, self._say)
        self._actor = threading.Thread(target=self._answer, daemon=True)
        self._actor.start()
        self.flight.begin(self.clock.now())
        return self

    def __exit__(self, *_: object) -> None:
        self._queue.put(None)
        self._actor.join()
        self.runner.stop()
        self.link.close()
        self._stack.close()

    # ------------------------------------------------------------ who is told

    def _show(self, observation: Observation) -> None:
        self.seen.append((self.clock.now(), observation))
        self._queue.put(observation)

    def _say(self, level: str, text: str) -> None:
        self.said.append((self.clock.now(), level, text))

    def _answer(self) -> None:
        while (observation := self._queue.get()) is not None:
            action = None if observation.last else self.act(observation)
            if action is not None:
                self.flight.take(observation.episode, observation.step, action, self.clock.now())

    # ------------------------------------------------------------ to wait and to look

    def until(self, ready: Callable[[], bool], deadline: float = 40.0) -> None:
        """Wait for something.

        Raises
        ------
        TimeoutError
            After `deadline` seconds of the machine, with all that was said.
        """
        end = time.monotonic() + deadline
        while not ready():
            if time.monotonic() > end:
                raise TimeoutError(f"{report(self.flight)}\n{self.words()}")
            time.sleep(0.002)

    def words(self) -> str:
        """All that was said to people."""
        return "\n".join(f"{when:.2f} {level}: {text}" for when, level, text in self.said)

    def heard(self, text: str) -> bool:
        """Whether somebody was told this."""
        return any(text in words for _, _, words in self.said)

    def wait(self, seconds: float) -> None:
        """Let vehicle time pass."""
        end = self.clock.now() + seconds
        self.until(lambda: self.clock.now() >= end, 60.0)

    def change(self, name: str, value: float) -> None:
        """Set a parameter of the autopilot, or of the world around it."""
        with self.sitl.lock:
            self.sitl.autopilot.change(name, value)

    def body(self) -> Array:
        """The truth, ENU: position and velocity of the quadrotor, position of the load; (3, 3)."""
        with self.sitl.lock:
            state = self.sitl.autopilot.body.state.copy()
        ned = np.array([state[POSITION], state[VELOCITY], state[LOAD]])
        swapped: Array = ned[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
        return swapped

    @property
    def speed(self) -> float:
        """The truth, in the horizontal [m/s]."""
        return float(np.linalg.norm(self.body()[1][:2]))

    @property
    def broken(self) -> bool:
        """Whether the vehicle has hit the ground too fast."""
        return bool(self.sitl.autopilot.body.broken)

    @property
    def ends(self) -> list[Observation]:
        """Last observations of the episodes so far."""
        return [seen for _, seen in self.seen if seen.last]

    def episodes(self, n: int, deadline: float = 60.0) -> list[Observation]:
        """Wait until `n` more episodes have been flown; their ends."""
        until = len(self.ends) + n
        self.until(lambda: len(self.ends) >= until, deadline)
        return self.ends[-n:]

    def in_episode(self, step: int = 3) -> None:
        """Wait until somebody acts in the middle of an episode."""
        self.until(
            lambda: (
                self.flight.phase is Phase.EPISODE
                and self.flight.verdict.commander is Commander.ACTOR
                and self.flight.step >= step
            )
        )

    def setpoints(self, since: float) -> list[tuple[float, Any]]:
        """Times and messages of the setpoints sent."""
        name = "SET_POSITION_TARGET_LOCAL_NED"
        return [(t, m) for t, m in list(self.sent) if t >= since and m.get_type() == name]

    def inside(self) -> bool:
        """Whether the truth is inside the envelope."""
        position, velocity, _ = self.body()
        motion = self.flight.motion._replace(
            x=position[0], speed=velocity[0], across=position[1], height=position[2], swing=0.0
        )
        return violation(self.limits, motion) == ""


class Dying:
    """Accelerates away, and falls silent after some answers; made `alive`, it flies well."""

    def __init__(self, task: SlungLoad, answers: int) -> None:
        self.left, self.alive = answers, False
        self._pilot = pilot(task)

    def __call__(self, seen: Observation) -> int | None:
        """Full acceleration to the right, or nothing any more."""
        if self.alive:
            return self._pilot(seen)
        self.left -= 1
        return 2 if self.left >= 0 else None


def pushes(message: Any) -> bool:
    """Whether a setpoint accelerates along a track to the east."""
    return not message.type_mask & (1 << 7) and abs(message.afy) > 0.01


def lost(flying: Flying, dying: Dying) -> tuple[float, float]:
    """What happens once somebody has fallen silent.

    Returns
    -------
    late : float
        From the deadline of the next action to the first neutral setpoint [s].
    distance : float
        From the last action to rest [m].
    """
    f = flying
    f.until(lambda: dying.left <= 0)
    start = f.body()[0]
    f.until(lambda: f.flight.verdict.commander is not Commander.ACTOR)
    episode = f.flight.episode
    begun = f.clock.now() if episode is None else episode.answered_time
    f.until(lambda: f.flight.phase is not Phase.EPISODE)
    f.until(lambda: f.speed < 0.15)
    distance = float(np.linalg.norm(f.body()[0][:2] - start[:2]))
    deadline = begun + f.flight.timeouts.action_timeout
    neutral = next(t for t, m in f.setpoints(deadline) if not pushes(m))
    return neutral - deadline, distance
