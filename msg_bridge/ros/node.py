"""The vehicle node: a robot that a YAML file describes takes the simulator's place."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Joy
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger

from iolspi_ros import parameters, qos, runtime, wire
from iolspi_ros.core.samples import Observation
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.settings import Settings, setting
from iolspi_ros.vehicle_topics import VehicleTopics
from iolspi_ros.vitals import diagnostics
from msg_bridge.ros.description import Robot, read_robot
from msg_bridge.ros.drive import Drive, Phase
from msg_bridge.ros.wiring import Wiring


@dataclass(frozen=True)
class VehicleSettings(Settings):
    """Which robot it is."""

    task: str = setting("", "YAML file of the robot: its task, and its topics")


class Vehicle(ManagedNode):
    """Publishes `task`, `state`, `reward`; takes `action`; speaks the robot's own topics."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        super().__init__("vehicle", arguments)
        self.settings = parameters.declare(self, VehicleSettings)
        parameters.warn_unknown(self)
        self._kept: list[Any] = []
        self._drive: Drive | None = None

    # ------------------------------------------------------------ managed

    def configure(self) -> None:
        """Read the file, listen to the robot, and say what its task is."""
        if not self.settings.task:
            raise InputError("parameter task is empty; allowed: a YAML file of a robot")
        self.robot = read_robot(Path(self.settings.task).expanduser())
        self._wiring = Wiring(self, self.robot, self._heard)
        self._topics = VehicleTopics(self, self.robot.task)
        self._drive = Drive(self.robot, self)
        self._asked = self._pressed = False
        self._reset_at = 0.0
        self._diagnostics_out = self.create_publisher(DiagnosticArray, "/diagnostics", qos.OUTGOING)
        self._subscribe(Float64MultiArray, "action", self._on_action, qos.CONTROL, raw=True)
        if self.robot.reset.button >= 0:
            self._subscribe(Joy, "joy", self._on_joy, qos.CONTROL)
        self._kept = [
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(SetBool, "~/pause", self._on_pause),
        ]
        self._timers_ = [runtime.wall_timer(self, 1.0, self._look_around)]
        self._keep_time(self.robot)
        self.get_logger().info(
            f"{self.robot.task.name}: actions are heard on {self.resolve_topic_name('action')}, "
            f"and become {', '.join(output.topic for output in self.robot.outputs)}"
        )

    def _subscribe(self, kind: Any, topic: str, callback: Any, profile: Any, **more: Any) -> None:
        self._heard_on = [*getattr(self, "_heard_on", [])]
        self._heard_on.append(self.create_subscription(kind, topic, callback, profile, **more))

    def _keep_time(self, robot: Robot) -> None:
        """Tick every T_s: of the graph's clock where there is one, else of the machine's."""
        self._check_due = self._next = 0
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        if self._simulated:
            self._now = 0
            self._subscribe(Clock, "/clock", self._on_clock, qos.CONTROL)
            return
        dt = robot.task.sampling_time
        self._checking = runtime.wall_timer(self, robot.answer_within, self._check)
        self._checking.cancel()
        self._timers_ += [runtime.wall_timer(self, dt, self._tick), self._checking]

    def activate(self) -> None:
        """Let episodes begin."""
        assert self._drive is not None
        self._drive.begin()

    def deactivate(self) -> None:
        """Stop the robot with its neutral action."""
        if self._drive is not None:
            self._drive.stop()

    def cleanup(self) -> None:
        """Leave the graph."""
        self._topics.close()
        self._wiring.close()
        runtime.destroy_publishers(self, self._diagnostics_out)
        for timer in self._timers_:
            self.destroy_timer(timer)
        for subscription in self._heard_on:
            self.destroy_subscription(subscription)
        for service in self._kept:
            self.destroy_service(service)
        self._drive, self._heard_on = None, []

    def close(self) -> None:
        """The robot's last command is the neutral one."""
        if self._drive is not None:
            self._drive.stop()
            self._wiring.flush(Duration(seconds=0.3))

    # ------------------------------------------------------------ time

    @property
    def now(self) -> int:
        """The vehicle's time [ns]."""
        return self._now if self._simulated else time.monotonic_ns()

    def _tick(self) -> None:
        assert self._drive is not None
        if self._drive.phase is Phase.RESETTING:
            self._try_reset()
        self._drive.tick(self.now)
        if not self._simulated:
            self._checking.reset()

    def _check(self) -> None:
        if not self._simulated:
            self._checking.cancel()
        assert self._drive is not None
        self._drive.check()

    def _on_clock(self, message: Clock) -> None:
        now = message.clock.sec * wire.NANOSECONDS + message.clock.nanosec
        step = round(self.robot.task.sampling_time * wire.NANOSECONDS)
        back, self._now = now < self._now, now
        if 0 < self._check_due <= now:
            self._check_due = 0
            self._check()
        if back or now >= self._next:
            self._next = self._next + step if 0 <= now - self._next < step else now + step
            self._tick()
            self._check_due = now + round(self.robot.answer_within * wire.NANOSECONDS)

    # ------------------------------------------------------------ the robot

    def command(self, action: int) -> None:
        """Publish what an action means."""
        self._wiring.command(action)

    def show(self, observation: Observation) -> None:
        """Publish a state and its reward."""
        self._topics.show(observation)
        self._topics.publish()

    def say(self, text: str) -> None:
        """Tell a person, not too often."""
        self.get_logger().warning(text, throttle_duration_sec=5.0)

    def reset(self) -> None:
        """Ask for the robot to be put at a start."""
        self._asked, self._reset_at = False, 0.0
        if self.robot.reset.button >= 0:
            self.get_logger().info(
                f"put the robot where it is to start, then press button {self.robot.reset.button}"
            )
        self._try_reset()

    def _try_reset(self) -> None:
        if self._asked or time.monotonic() < self._reset_at or self.robot.reset.button >= 0:
            return
        assert self._drive is not None
        if self._wiring.put_at_start(self._placed):
            self._asked = True
        else:
            self._reset_at = time.monotonic() + 0.2
            self._drive.trouble = f"service {self.robot.reset.service} is not there"
            self.say(f"waiting: {self._drive.trouble}")

    def _placed(self, refused: str) -> None:
        assert self._drive is not None
        if refused:
            self._asked, self._reset_at = False, time.monotonic() + 1.0
            self.say(f"the reset was refused: {refused}; it is asked for again")
            return
        self._drive.placed(self.now)

    def _heard(self, topic: str, message: Any) -> None:
        if self._drive is not None:
            self._drive.hear(topic, message, self.now)

    def _on_joy(self, message: Joy) -> None:
        button, held = self.robot.reset.button, False
        if button < len(message.buttons):
            held = bool(message.buttons[button])
        if held and not self._pressed and self._drive is not None:
            self._drive.placed(self.now)
        self._pressed = held

    # ------------------------------------------------------------ the graph

    def _on_action(self, message: Any) -> None:
        answer = self._topics.read(message)
        if answer is not None and self.active and self._drive is not None:
            self._drive.answer(*answer)

    def _on_reset(self, _: Any, response: Any) -> Any:
        assert self._drive is not None
        response.success = self.active
        response.message = "a new episode" if self.active else "not active"
        if self.active:
            self._drive.begin()
        return response

    def _on_pause(self, request: Any, response: Any) -> Any:
        assert self._drive is not None
        if request.data:
            self._drive.stop()
        elif self.active and self._drive.phase is Phase.IDLE:
            self._drive.begin()
        response.success, response.message = True, str(self._drive.phase)
        return response

    def _look_around(self) -> None:
        """Say how it is; end when a topic can never be heard."""
        assert self._drive is not None
        try:
            self._wiring.check()
        except InputError as error:
            self._drive.stop()
            self.fail(error)
        trouble = self._drive.trouble
        level = DiagnosticStatus.OK if not trouble else DiagnosticStatus.WARN
        if self._drive.phase is Phase.STOPPED:
            level = DiagnosticStatus.ERROR
        values = {"phase": str(self._drive.phase), "episode": self._drive.episode}
        message = diagnostics(
            self,
            "robot",
            level,
            trouble or str(self._drive.phase),
            {**values, **self._drive.counts},
        )
        self._diagnostics_out.publish(message)


def main() -> int:
    """Run the vehicle."""
    return runtime.main(Vehicle, "vehicle")
