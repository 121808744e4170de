"""The simulator node: any task as a vehicle on the graph, in lockstep or in real time."""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.settings import Settings, setting
from iolspi_ros.vehicle_topics import VehicleTopics
from sim_nodes.markers import Markers
from sim_nodes.tasks import task_class
from sim_nodes.world import World, WorldSettings


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
    seed: int = setting(0, "of initial conditions and noise; used at the next reset", low=0)
    episodes: int = setting(0, "stop after so many episodes since the reset; 0 for never", low=0)


class Simulator(Node):
    """Publishes `state`, `reward`, `/clock`, `markers`; takes `action`: docs/interfaces.md."""

    def __init__(self) -> None:
        super().__init__("simulator")
        self.declare_parameter("task", "pendulum")
        self._task_class = task_class(str(self.get_parameter("task").value))
        changeable = tuple(field.name for field in fields(self._task_class))
        world = tuple(field.name for field in fields(WorldSettings))
        self.settings = parameters.declare(self, SimulatorSettings, ("seed", "episodes"))
        parameters.declare(self, self._task_class, changeable)
        parameters.declare(self, WorldSettings, world)
        parameters.check_changes(self, SimulatorSettings, self._task_class, WorldSettings)
        parameters.warn_unknown(self)
        self._topics = VehicleTopics(self)
        self._clock_out = self.create_publisher(Clock, "/clock", qos.OUTGOING)
        self._markers = Markers(self)
        self._clock_message = Clock()
        self._ticks = 0
        self._episode = -1
        self._paused = False
        self._restart()
        self.create_subscription(Float64MultiArray, "action", self._on_action, qos.CONTROL)
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.get_logger().info(
            f"{self.world.task.name} in {self.settings.mode}; actions are heard on "
            f"{self.resolve_topic_name('action')}"
        )
        if self.settings.mode == "lockstep":
            runtime.wall_timer(self, self.settings.resend_after, self._repeat)
        else:
            period = self.world.task.dt / self.settings.real_time_factor
            runtime.wall_timer(self, period, self._tick)

    def close(self) -> None:
        """Nothing to put away."""

    # ------------------------------------------------------------ episodes

    def _restart(self) -> None:
        """Make the world anew from the parameters as they are now."""
        self.settings = parameters.read(self, SimulatorSettings)
        task = parameters.read(self, self._task_class)
        world = parameters.read(self, WorldSettings)
        self.world = World(task, world, np.random.default_rng([self.settings.seed, 0]))
        self._stamp_step = round(task.dt * wire.NANOSECONDS)
        self._begun = 0
        self._done = False
        self._first = time.monotonic()  # of the first step
        self._begin()

    def _begin(self) -> None:
        if self.settings.episodes and self._begun >= self.settings.episodes:
            if not self._done:
                self.get_logger().info(f"done: {self._begun} episodes{self._pace()}")
            self._done = True
            return
        self._begun += 1
        self._episode += 1
        self._action = self.world.task.neutral
        self._answered = -1
        self._show(self.world.begin(self._episode))

    def _pace(self) -> str:
        took, steps = time.monotonic() - self._first, self.world.vehicle_steps
        return f", {steps} steps in {took:.3f} s, {steps / took:.1f} steps/s"

    def _advance(self, action: int) -> None:
        if self.world.vehicle_steps == 0:
            self._first = time.monotonic()
        if self._observation.last:
            self._begin()
        else:
            self._show(self.world.move(self._episode, action))

    def _show(self, observation: Observation) -> None:
        self._ticks += 1  # also at the start of an episode: every state has a stamp of its own
        stamp = self._ticks * self._stamp_step
        self._observation = observation = observation._replace(stamp=stamp)
        time_now = self._clock_message.clock
        time_now.sec, time_now.nanosec = wire.split(stamp)
        self._topics.show(self.world.task.joints, observation)
        self._publish()

    def _repeat(self) -> None:
        if time.monotonic() - self._published > 0.9 * self.settings.resend_after:
            self._publish()

    def _publish(self) -> None:
        if self._paused or self._done:
            return
        self._topics.publish()
        # Last: whoever answers is at work already.
        runtime.publish(self._clock_out, self._clock_message)
        self._published = time.monotonic()
        self._markers.show(self.world.task, self._observation)

    # ------------------------------------------------------------ what comes in

    def _on_action(self, message: Any) -> None:
        answer = self._topics.read(len(self.world.task.actions), message)
        if answer is None or self._paused or self._done or answer.episode != self._episode:
            return
        if self.settings.mode == "lockstep":
            if answer.step == self._observation.step:
                self._advance(answer.action)
        elif self._answered < answer.step <= self._observation.step:
            self._answered, self._action = int(answer.step), answer.action

    def _tick(self) -> None:
        if not (self._paused or self._done):
            self._advance(self._action)

    def _on_reset(self, _: Any, response: Any) -> Any:
        try:
            self._restart()
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
    return runtime.main(Simulator, "simulator", sys.argv)
