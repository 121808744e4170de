"""The person at a demonstrator: their joystick, their verdicts, and what they take over."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from sensor_msgs.msg import Joy
from std_srvs.srv import Trigger

from iolspi_ros import parameters, qos
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.hand import HandFlight
from iolspi_ros.nodes.joystick import Joystick, JoystickSettings
from iolspi_ros.nodes.override import Override, TakeoverSettings
from iolspi_ros.nodes.pilot_topics import PilotTopics
from iolspi_ros.nodes.piloting import PilotingSettings
from iolspi_ros.nodes.samples_out import SamplesOut
from iolspi_ros.nodes.teleop import TeleopSettings
from iolspi_ros.vitals import Report
from iolspi_ros.wire import Phase

VERDICTS: dict[str, Callable[[HandFlight], str]] = {
    "keep": HandFlight.keep,
    "discard": HandFlight.discard,
    "undo": HandFlight.undo,
    "finish": HandFlight.finish,
}
"""Services, and what each does."""


class Person:
    """Hears a joystick; flies with it while demonstrating, and takes over afterwards.

    Parameters
    ----------
    node : SamplesOut
    settings : TeleopSettings
    """

    def __init__(self, node: SamplesOut, settings: TeleopSettings) -> None:
        self._node, self._settings = node, settings
        self._joystick = parameters.declare(node, JoystickSettings)
        self._piloting = parameters.declare(node, PilotingSettings)
        self._takeover = parameters.declare(node, TakeoverSettings)
        self._stick: Joystick | None = None
        self._topics: PilotTopics | None = None
        self._flight: HandFlight | Override | None = None

    @property
    def takes_over(self) -> bool:
        """Whether there is a button for it."""
        return self._takeover.takeover_button >= 0

    def open(self) -> None:
        """Listen to the joystick."""
        node = self._node
        self._joy = node.create_subscription(Joy, "joy", self._on_joy, qos.CONTROL)
        self._services = [
            node.create_service(Trigger, f"~/{name}", self._verdict(act))
            for name, act in VERDICTS.items()
        ]

    def meet(self) -> None:
        """Make what knows the task of the node.

        Raises
        ------
        InputError
            When the joystick is to do what the task does not have.
        """
        task, needed = self._node.task, (self._takeover.takeover_button,)
        self._stick = Joystick(self._joystick, task.actions, task.neutral, needed)
        self._topics = PilotTopics(self._node, self._settings.episodes)

    def demonstrate(self) -> HandFlight:
        """Fly demonstrations."""
        assert self._stick is not None
        assert self._topics is not None
        self._flight = flight = HandFlight(
            self._node, self._settings, self._piloting, self._stick, self._topics
        )
        return flight

    def stand_by(self) -> Override:
        """Be there to take over."""
        assert self._stick is not None
        assert self._topics is not None
        self._flight = override = Override(self._node, self._takeover, self._stick, self._topics)
        return override

    def let_go(self) -> None:
        """Give the vehicle back."""
        if self._topics is not None:
            self._topics.let_go()

    def close(self) -> None:
        """Let everything go."""
        if self._topics is not None:
            self._topics.close()
        self._stick = self._topics = self._flight = None
        self._node.destroy_subscription(self._joy)
        for service in self._services:
            self._node.destroy_service(service)

    def _on_joy(self, message: Joy) -> None:
        stick = self._stick
        if stick is None:
            return
        before = stick.fault
        stick.take(message.axes, message.buttons, message.header.frame_id)
        if stick.fault and stick.fault != before:
            self._node.get_logger().error(f"{stick.fault}; it does not fly")
        if self._node.active and self._flight is not None:
            self._flight.look()

    def _verdict(self, act: Callable[[HandFlight], str]) -> Callable[[Any, Any], Any]:
        def answer(_: Any, response: Any) -> Any:
            try:
                if not isinstance(self._flight, HandFlight):
                    raise InputError("nobody demonstrates by joystick; allowed: while one does")
                response.message, response.success = act(self._flight), True
                self._node.get_logger().info(response.message)
            except InputError as error:
                response.message, response.success = str(error), False
            return response

        return answer

    def diagnose(self, report: Report) -> None:
        """Add how person and joystick are."""
        stick = self._stick
        if stick is None or self._topics is None:
            return
        report.values |= {
            "joystick": "silent" if stick.silent else "there",
            "joystick messages dropped": stick.dropped,
            "messages of other joysticks": stick.others,
            "vehicle": "held" if self._topics.held else "not held",
        }
        report.worry(stick.fault, DiagnosticStatus.ERROR)
        if stick.dropped:
            report.worry(f"{stick.dropped} messages of the joystick were no positions of a stick")
        if stick.others:
            report.worry(f"{stick.others} messages of another joystick were not listened to")
        if not isinstance(self._flight, HandFlight):
            return
        piloting = self._flight.piloting
        report.values |= {
            "piloting": piloting.phase.name.lower().replace("_", " "),
            "kept": piloting.kept, "discarded": piloting.discarded,
        }  # fmt: skip
        if piloting.phase is Phase.PAUSED:
            report.worry(
                "the joystick is silent; its driver must repeat what it says (autorepeat_rate of "
                "joy_node)"
            )
