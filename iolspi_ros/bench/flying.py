"""An embedded autopilot, a bridge and somebody who acts, all in one process."""

from __future__ import annotations

import queue
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.bench.worlds import FlightWorld, Stepped
from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink.arbiter import Authority, Timeouts
from msg_bridge.mavlink.envelope import Limits, violation
from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.memory import Memory
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.preflight import ChecklistItem, Preflight
from msg_bridge.mavlink.runner import Runner
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.status import AuthorityChange, Outputs
from msg_bridge.mavlink.telemetry import Telemetry
from sim_nodes.autopilot.autopilot import Autopilot
from sim_nodes.autopilot.firmware import WITH_GRIPPER
from sim_nodes.quadrotor.body import LOAD, POSITION, VELOCITY
from sim_nodes.tasks.slung_load import SlungLoad
from sim_nodes.tasks.slung_load.pilot import Perform
from sim_nodes.tasks.slung_load_3d import SlungLoad3D

Array = NDArray[np.float64]
Act = Callable[[Observation], int | None]
"""What somebody does with an observation; None for nothing."""

PATIENT = Timeouts(action_timeout=0.3, telemetry_timeout=0.6, round_trip_limit=0.5)
"""For clocks that run faster: delays of a machine with other work count as many times."""


def parameters(like: str, **changed: float) -> dict[str, float]:
    """What the embedded autopilot boots with, for a load that reports itself and can be let go."""
    known = {"SIM_LOAD_RATE": 20.0}
    return known | WITH_GRIPPER[like] | changed


HALL = Limits(box=(-5.0, 5.0, -5.0, 5.0), heights=(1.2, 5.8))
"""The envelope of the slung load in three dimensions: its walls, as config/slung_load_3d.yaml."""


def pilot(task: SlungLoad | SlungLoad3D) -> Act:
    """Who brings the load in and drops it; in the plane with more verve than the scripted pilot."""
    if isinstance(task, SlungLoad3D):
        performs = task.pilot("perform", np.random.default_rng(0))
        return lambda seen: performs.decide(seen.state, 0.0)
    law = Perform()
    law.swing, law.margin = 2.5, 1.3
    return lambda seen: law.decide(seen.state, 0.0)


class Flying:
    """A vehicle that takes off; `act` answers its observations.

    Parameters
    ----------
    folder : Path
        For the log, and for the parameters as they were.
    like : str
        px4 or ardupilot.
    act : callable, optional
        A pilot who knows how by default.
    world : callable
        Makes the world: `Stepped`, or `RealTime` with a factor of its own.
    factor : float
        Vehicle seconds per second that the bridge expects.
    timeouts : Timeouts
    system : int
        Whom the bridge expects.
    keys : (bytes or None, bytes or None)
        Of the autopilot's and the bridge's signatures.
    initial : str
        Of the slung load in the plane.
    task : SlungLoad3D, optional
        In place of that, in the envelope `HALL`.
    patience : float
        Of the preflight [s].
    autopilot : dict of str to float, optional
        Parameters that the autopilot boots with.
    seed : int
        Of the world, and of the flight.
    **settings
        Of the flight.
    """

    def __init__(
        self,
        folder: Path,
        like: str,
        act: Act | None = None,
        *,
        world: Callable[..., FlightWorld] = Stepped,
        factor: float = 1.0,
        timeouts: Timeouts | None = None,
        system: int = 1,
        keys: tuple[bytes | None, bytes | None] = (None, None),
        initial: str = "wide",
        task: SlungLoad3D | None = None,
        patience: float = 20.0,
        autopilot: dict[str, float] | None = None,
        seed: int = 0,
        **settings: Any,
    ) -> None:
        self.task = task or SlungLoad(initial=initial)
        self.limits = HALL if task else Limits()
        settings = {"height": 2.8} | settings if task else settings
        self.world = world(like, parameters(like, **(autopilot or {})), seed, keys[0])
        self.clock = self.world.clock
        self.telemetry = Telemetry(system, 2)
        self.log = folder / "flight.tlog"
        self.link = AutopilotLink(self.world.connect(), self.telemetry, keys[1], self.log)
        self.settings = FlightSettings(real_time_factor=factor, seed=seed, **settings)
        self.checklist: list[ChecklistItem] = []
        self.said: list[tuple[float, str, str]] = []
        self.seen: list[tuple[float, Observation]] = []
        self.sent: list[tuple[float, Any]] = []
        self.changes: list[AuthorityChange] = []
        self.preflight = Preflight(
            self.link, LinkSettings(patience=patience), self.settings, self.clock,
            Memory(folder / "memory", folder), self.checklist.append,
        )  # fmt: skip
        self.act = act or pilot(self.task)
        self._timeouts = timeouts or Timeouts()
        self._queue: queue.SimpleQueue[Observation] = queue.SimpleQueue()

    def __enter__(self) -> Flying:
        self.world.open()
        try:
            self.profile = self.preflight.run()
        except BaseException:
            self.__exit__()
            raise
        send = self.link.send

        def tapped(message: Any) -> bool:
            self.sent.append((self.clock.now(), message))
            return send(message)

        self.link.send = tapped  # type: ignore[method-assign]
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.world.close()
        self.link.close()

    def start(self) -> None:
        """Begin to fly, as a bridge does that was just configured and activated."""
        self.flight = Flight(
            self.task, self.link, self.profile, self.settings, self.limits, self._timeouts,
            Outputs(self._show, self._say, self.changes.append), self.preflight.release.output,
        )  # fmt: skip
        self.runner = Runner(self.flight, self.clock, self._say)
        self.world.run(self.runner, self._answer)
        self.flight.begin(self.clock.now())

    def kill(self) -> None:
        """Let the bridge die."""
        self.runner.stop()
        self.world.run(None, lambda: False)

    # ------------------------------------------------------------ who is told

    def _show(self, observation: Observation) -> None:
        self.seen.append((self.clock.now(), observation))
        self._queue.put(observation)

    def _say(self, level: str, text: str) -> None:
        self.said.append((self.clock.now(), level, text))

    def _answer(self) -> bool:
        """Answer the next observation; False when there is none."""
        try:
            observation = self._queue.get_nowait()
        except queue.Empty:
            return False
        action = None if observation.last else self.act(observation)
        if action is not None:
            self.flight.act(observation.episode, observation.step, action, self.clock.now())
        return True

    # ------------------------------------------------------------ to wait and to look

    def until(self, ready: Callable[[], bool], deadline: float = 160.0) -> None:
        """Wait for something.

        Raises
        ------
        TimeoutError
            After `deadline` of vehicle time [s], with all that was said.
        """
        end = self.clock.now() + deadline
        while not ready():
            if self.clock.now() > end:
                raise TimeoutError(f"{self.flight.status()}\n{self.words()}")
            self.world.wait()

    def words(self) -> str:
        """All that was said to people."""
        return "\n".join(f"{when:.2f} {level}: {text}" for when, level, text in self.said)

    def heard(self, text: str) -> bool:
        """Whether somebody was told this."""
        return any(text in words for _, _, words in self.said)

    def wait(self, seconds: float) -> None:
        """Let vehicle time pass."""
        end = self.clock.now() + seconds
        self.until(lambda: self.clock.now() >= end - 1e-9, 2.0 * seconds + 60.0)

    @property
    def autopilot(self) -> Autopilot:
        """The embedded one."""
        return self.world.autopilot

    def change(self, name: str, value: float) -> None:
        """Set a parameter of the autopilot, or of the world around it."""
        with self.world.lock():
            self.autopilot.change(name, value)

    def body(self) -> Array:
        """The truth, ENU: position and velocity of the quadrotor, position of the load; (3, 3)."""
        with self.world.lock():
            state = self.autopilot.body.craft.copy()
        return np.array([state[POSITION], state[VELOCITY], state[LOAD]])

    @property
    def speed(self) -> float:
        """The truth, in the horizontal [m/s]."""
        return float(np.linalg.norm(self.body()[1][:2]))

    @property
    def broken(self) -> bool:
        """Whether the vehicle has hit the ground too fast."""
        return bool(self.autopilot.body.broken)

    @property
    def ends(self) -> list[Observation]:
        """Last observations of the episodes so far."""
        return [seen for _, seen in self.seen if seen.last]

    def episodes(self, n: int, deadline: float = 240.0) -> list[Observation]:
        """Wait until `n` more episodes have been flown; their ends."""
        until = len(self.ends) + n
        self.until(lambda: len(self.ends) >= until, deadline)
        return self.ends[-n:]

    def in_episode(self, step: int = 3) -> None:
        """Wait until somebody acts in the middle of an episode."""
        self.until(
            lambda: (
                self.flight.phase is Phase.EPISODE
                and self.flight.ruling.authority is Authority.ACTOR
                and self.flight.step >= step
            )
        )

    def in_air(self) -> None:
        """Wait until it is on the way to the first episode."""
        self.until(lambda: self.flight.phase is Phase.TRANSIT)

    def setpoints(self, since: float) -> list[tuple[float, Any]]:
        """Times and messages of the setpoints sent."""
        name = "SET_POSITION_TARGET_LOCAL_NED"
        return [(t, m) for t, m in list(self.sent) if t >= since and m.get_type() == name]

    def inside(self) -> bool:
        """Whether the truth is inside the envelope."""
        position, velocity, _ = self.body()
        motion = self.flight.motion._replace(
            x=position[0], speed=velocity[0], across=position[1], height=position[2],
            cable=(0.0, 0.0, -1.0),
        )  # fmt: skip
        return violation(self.limits, motion) == ""


class Dying:
    """Accelerates away, and falls silent after some answers; made `alive`, it flies well."""

    def __init__(self, task: SlungLoad | SlungLoad3D, answers: int) -> None:
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
    f.until(lambda: f.flight.ruling.authority is not Authority.ACTOR)
    begun = f.flight.answered_time or f.clock.now()
    f.until(lambda: f.flight.phase is not Phase.EPISODE)
    f.until(lambda: f.speed < 0.15)
    distance = float(np.linalg.norm(f.body()[0][:2] - start[:2]))
    deadline = begun + f.flight.timeouts.action_timeout
    neutral = next(t for t, m in f.setpoints(deadline) if not pushes(m))
    return neutral - deadline, distance
