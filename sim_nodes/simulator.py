"""The simulator node: any task as a vehicle on the graph, in lockstep or in real time."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime, wire
from iolspi_ros.core.learner import Source
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.seen import Seen
from iolspi_ros.settings import Settings, setting
from iolspi_ros.task import TaskDescription
from iolspi_ros.vehicle_topics import Answer, VehicleTopics
from iolspi_ros.vitals import SILENCE, Pulse, Report, Vitals
from sim_nodes.camera import Camera
from sim_nodes.markers import Markers
from sim_nodes.tasks import as_set, task_class
from sim_nodes.world import WorldMemory, WorldSettings, make_world


@dataclass(frozen=True)
class TaskChoice(Settings):
    """Which vehicle it is."""

    task: str = setting(
        "pendulum", "a registered task, module:Class, gymnasium:ID, or a file about one"
    )


@dataclass(frozen=True)
class SimulatorSettings(Settings):
    """How the simulator keeps time."""

    mode: str = setting(
        "lockstep", "wait for each action, or run on a timer", choices=("lockstep", "realtime")
    )
    real_time_factor: float = setting(
        1.0, "vehicle seconds per second in real time", low=0.0, high=100.0, low_open=True
    )
    resend_after: float = setting(
        0.05, "lockstep: repeat a state not answered for this long [s]", low=0.001, high=3600.0
    )
    publish_clock: str = setting(
        "auto", "publish vehicle time on /clock; auto for lockstep in the root namespace alone",
        choices=("auto", "always", "never"),
    )  # fmt: skip
    seed: int = setting(0, "of initial conditions and noise; used at the next reset", low=0)
    episodes: int = setting(0, "stop after so many episodes since the reset; 0 for never", low=0)


@dataclass(frozen=True)
class VehicleMemory:
    """Where a simulated vehicle is, for a checkpoint.

    Attributes
    ----------
    world : WorldMemory
    ticks, begun, answered : int
    done : bool
    seen : Seen
        The observation that is shown.
    """

    world: WorldMemory
    ticks: int
    begun: int
    answered: int
    done: bool
    seen: Seen


class Simulator(ManagedNode):
    """Publishes `task`, `state`, `reward`, `/clock` and pictures; takes `action`."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        super().__init__("simulator", arguments)
        name = parameters.declare(self, TaskChoice).task
        self._task_class = task_class(name)
        self._task_settings = (self._task_class,) if issubclass(self._task_class, Settings) else ()
        self.settings = parameters.declare(
            self, SimulatorSettings, ("seed", "episodes", "real_time_factor")
        )
        for cls in (*self._task_settings, WorldSettings):
            parameters.declare(self, cls, tuple(field.name for field in fields(cls)))
        parameters.check_changes(self, SimulatorSettings, *self._task_settings, WorldSettings)
        parameters.warn_unknown(self)
        self.add_post_set_parameters_callback(self._on_changed)
        self._ticks = 0
        self._episode = -1
        self._published = 0.0
        self._paused = self._done = False
        self._pulse = Pulse()

    def configure(self) -> None:
        """Make the world, and say what its task is."""
        self._restart()
        self._topics = VehicleTopics(self, self.task, self._handed)
        self._clock_out = (
            self.create_publisher(Clock, "/clock", qos.OUTGOING) if self._publishes_clock else None
        )
        self._clock_message = Clock()
        self._markers = Markers(self, self.world.task)
        self._camera = Camera(self, self.world.task)
        self._vitals = Vitals(self, "simulating", ("task", "state", "reward"), self._diagnose)
        self._kept = [
            self.create_subscription(
                Float64MultiArray, "action", self._on_action, qos.CONTROL, raw=True
            ),
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(SetBool, "~/pause", self._on_pause),
        ]
        self._keep_time()
        self.get_logger().info(
            f"{self.task.name} in {self.settings.mode}; actions are heard on "
            f"{self.resolve_topic_name('action')}"
        )

    def _keep_time(self) -> None:
        if self.settings.mode == "lockstep":
            period = min(self.settings.resend_after, runtime.LOOK)
            self._timer = runtime.wall_timer(self, period, self._look)
        else:
            self._timer = runtime.wall_timer(self, self._period, self._tick)

    @property
    def _period(self) -> float:
        """Seconds of wall time for a step in real time."""
        return self.task.sampling_time / self.settings.real_time_factor

    def activate(self) -> None:
        """Let the vehicle move."""
        if self._begun == 0:
            self._begin()

    def deactivate(self) -> None:
        """Stop the vehicle where it is."""

    def cleanup(self) -> None:
        """Leave the graph."""
        self._topics.close()
        self._vitals.close()
        self._markers.close()
        self._camera.close()
        if self._clock_out is not None:
            runtime.destroy_publishers(self, self._clock_out)
        self.destroy_timer(self._timer)
        subscription, *services = self._kept
        self.destroy_subscription(subscription)
        for service in services:
            self.destroy_service(service)

    def close(self) -> None:
        """Nothing to put away."""

    @property
    def task(self) -> TaskDescription:
        """What the vehicle is to do."""
        return self.world.task.description

    @property
    def _publishes_clock(self) -> bool:
        """Whether `/clock` is ours: one clock for all, so only one vehicle may give it."""
        if self.settings.publish_clock != "auto":
            return self.settings.publish_clock == "always"
        return self.settings.mode == "lockstep" and self.get_namespace() == "/"

    # ------------------------------------------------------------ episodes

    def _restart(self) -> None:
        """Make the world anew from the parameters as they are now."""
        self.settings = parameters.read(self, SimulatorSettings)
        task = as_set(
            parameters.read(self, self._task_class) if self._task_settings else self._task_class()
        )
        world = parameters.read(self, WorldSettings)
        self.world = make_world(task, world, np.random.default_rng([self.settings.seed, 0]))
        self._stamp_step = round(self.task.sampling_time * wire.NANOSECONDS)
        self._begun = 0
        self._done = False
        self._first = time.monotonic()  # of the first step

    def _begin(self) -> None:
        if self.settings.episodes and self._begun >= self.settings.episodes:
            if not self._done:
                self.get_logger().info(f"done: {self._begun} episodes{self._pace()}")
            self._done = True
            return
        self._begun += 1
        self._episode += 1
        self._action, self._source = self.task.neutral, int(Source.HOLD)
        self._answered = -1
        self._show(self.world.begin(self._episode))

    def _pace(self) -> str:
        took, steps = time.monotonic() - self._first, self.world.vehicle_steps
        return f", {steps} steps in {took:.3f} s, {steps / took:.1f} steps/s"

    def _advance(self, action: int, source: int) -> None:
        if self.world.vehicle_steps == 0:
            self._first = time.monotonic()
        if self._observation.last:
            self._begin()
        else:
            self._show(self.world.move(self._episode, action)._replace(source=source))

    def _show(self, observation: Observation) -> None:
        realtime = self.settings.mode == "realtime"
        self._pulse.beat(self._period if realtime else 0.0)
        self._ticks += 1  # also at the start of an episode: every state has a stamp of its own
        stamp = self._ticks * self._stamp_step
        self._observation = observation = observation._replace(stamp=stamp)
        self._topics.show(observation)
        self._publish()

    def _look(self) -> None:
        """What no answer brings about in lockstep: a neutral step, or the same again."""
        if self._moving and self._begun and self._without_pilot:
            self._advance(self.task.neutral, Source.HOLD)
        self._repeat()

    def _repeat(self) -> None:
        """Publish again what is waited on, when its time has come."""
        late = time.monotonic() - self._published > 0.9 * self.settings.resend_after
        if self._begun and late:
            self._publish()

    @property
    def _without_pilot(self) -> bool:
        """Whether the person who has the vehicle does nothing, once the episode is under way."""
        shown = self._observation
        return shown.step > 0 and self._topics.takeover.silent((shown.episode, shown.step))

    def _handed(self) -> None:
        """A person has taken the vehicle, or given it back: the present state is theirs."""
        if self._begun:
            self._answered = min(self._answered, self._observation.step - 1)
            if self.settings.mode == "lockstep":
                self._publish()

    def _publish(self) -> None:
        if not self._moving:
            return
        self._published = time.monotonic()
        if self._clock_out is not None and self._clock_out.get_subscription_count():
            now = self._clock_message.clock
            now.sec, now.nanosec = wire.split(self._observation.stamp)
            self._clock_out.publish(self._clock_message)
        self._topics.publish()
        self._markers.show(self._observation)
        self._camera.show(self.world.task, self._observation)

    # ------------------------------------------------------------ what comes in

    def _on_action(self, message: Any) -> None:
        answer = self._topics.read(message)
        if answer is not None:
            self._take(answer)

    def handed_over(self) -> Observation | None:
        """The observation to be answered by a learner in this process; each comes once.

        From the first call on the topics carry only what somebody listens to.
        """
        if not self.active:
            return None
        self._topics.local = True
        return self._topics.take_pending()

    Memory = VehicleMemory

    def memory(self) -> VehicleMemory | None:
        """Where the vehicle is, for a checkpoint; None for one that does not wait for answers."""
        if self.settings.mode != "lockstep" or not self._begun:
            return None
        return VehicleMemory(
            self.world.memory(), self._ticks, self._begun, self._answered, self._done,
            Seen.of(self._observation),
        )  # fmt: skip

    def recall(self, memory: VehicleMemory) -> None:
        """Go on from what `memory` gave.

        Raises
        ------
        InputError
            When it is of another vehicle.
        """
        if self.settings.mode != "lockstep":
            return
        self.world.recall(memory.world)
        self._ticks, self._begun, self._answered = memory.ticks, memory.begun, memory.answered
        self._done = memory.done and memory.begun >= self.settings.episodes > 0
        self._observation = memory.seen.observation()
        self._episode = self._observation.episode
        self._topics.show(self._observation)
        if self._done:
            self.get_logger().info(f"done: {self._begun} episodes, before this process")
        self._publish()

    def take(self, answer: Answer) -> None:
        """Take an action of a learner in this process, unless a person has the vehicle."""
        if self._topics.admits(answer):
            self._take(answer)

    def _take(self, answer: Answer) -> None:
        if not self._moving or answer.episode != self._episode:
            return
        if self.settings.mode == "lockstep":
            if answer.step == self._observation.step:
                self._advance(answer.action, answer.source)
        elif self._answered < answer.step <= self._observation.step:
            self._answered = int(answer.step)
            self._action, self._source = answer.action, answer.source

    def _tick(self) -> None:
        if not self._moving:
            return
        waits = self._observation.step == 0 and self._answered < 0
        if waits and self._topics.takeover.held:
            self._repeat()  # the answer may have come just before it was held anew
            return
        if self._without_pilot:
            self._action, self._source = self.task.neutral, Source.HOLD
        self._advance(self._action, self._source)

    def _on_changed(self, changed: Sequence[Any]) -> None:
        """Take another pace at once; what else may be set waits for the next reset."""
        for parameter in changed:
            if parameter.name == "real_time_factor":
                self.settings = replace(self.settings, real_time_factor=parameter.value)
                if self.settings.mode == "realtime" and self._ticks:
                    self.destroy_timer(self._timer)
                    self._keep_time()

    @property
    def _moving(self) -> bool:
        return self.active and not (self._paused or self._done)

    def _diagnose(self) -> Report:
        phase = "inactive" if not self.active else "done" if self._done else "running"
        report = Report("paused" if self._paused else phase)
        realtime = self.settings.mode == "realtime"
        factor = self.settings.real_time_factor if realtime else 1.0
        report.values |= {
            "task": self.task.name, "mode": self.settings.mode, "episode": self._episode,
            "steps per second": f"{self._pulse.rate():.1f}",
            "in real time they would be": f"{factor / self.task.sampling_time:.1f}",
            "steps late": self._pulse.late, "actions ignored": self._topics.ignored,
            "held by a person": "yes" if self._topics.takeover.held else "no",
            "taken over": self._topics.takeover.count,
        }  # fmt: skip
        if self._moving and not realtime and self._pulse.silence > SILENCE:
            report.worry(f"nobody has answered for {self._pulse.silence:.0f} s")
        return report

    def _on_reset(self, _: Any, response: Any) -> Any:
        try:
            self._restart()
            if self.active:
                self._begin()
        except InputError as error:
            response.success, response.message = False, str(error)
        else:
            response.success = True
            response.message = f"episode {self._episode}, seed {self.settings.seed}"
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        self._paused = request.data
        response.success, response.message = True, "paused" if self._paused else "running"
        return response


def main() -> int:
    """Run the simulator."""
    return runtime.main(Simulator, "simulator")
