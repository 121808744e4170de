"""The cockpit as a managed node: a graph in the browser, and a stick for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import Joy
from std_srvs.srv import Trigger

from iolspi_ros import parameters, qos, runtime
from iolspi_ros.errors import InputError
from iolspi_ros.managed import ManagedNode
from iolspi_ros.task import TaskDescription
from iolspi_ros.vitals import Report, Vitals
from msg_bridge.cockpit import words
from msg_bridge.cockpit.board import Board
from msg_bridge.cockpit.session import Session
from msg_bridge.cockpit.settings import CockpitSettings, token_for
from msg_bridge.cockpit.virtual_joystick import Deflection
from msg_bridge.cockpit.watching import Watching

if TYPE_CHECKING:
    from msg_bridge.cockpit.server import Server

TUNED = {"speed": ("simulator", "real_time_factor"), "corruption": ("demonstrator", "corruption")}
"""Whose parameter is what a browser may set: those of `words.TUNED`."""


class CockpitNode(ManagedNode):
    """Shows what is on the graph; publishes `joy` while somebody has the stick."""

    def __init__(self, arguments: Sequence[str] | None = None) -> None:
        super().__init__("cockpit", arguments)
        self.settings = parameters.declare(self, CockpitSettings)
        parameters.warn_unknown(self)
        self.n_actions = 0
        self._server: Server | None = None
        self._flying = False  # whether `joy` may be published

    # ------------------------------------------------------------ managed

    def configure(self) -> None:
        """Listen, and serve the page."""
        self.board = Board()
        self._session = Session(self, self.board)
        self._server = self._make_server()
        self._joy = self.create_publisher(Joy, "joy", qos.CONTROL)
        self._verdicts = {
            name: self.create_client(Trigger, f"demonstrator/{name}") for name in words.SERVICES
        }
        self._setting = self._clients_of(SetParameters, "set_parameters")
        self._getting = self._clients_of(GetParameters, "get_parameters")
        self._looking = runtime.wall_timer(self, 1.0, self._look_at_tuned)
        self._watching = Watching(self, self.board, self._on_task, images=True)
        self._vitals = Vitals(self, "showing", (), self._diagnose)
        self._server.start()
        print(f"cockpit: open {self._server.invitation}", flush=True)

    def _clients_of(self, kind: Any, service: str) -> dict[str, Any]:
        return {
            what: self.create_client(kind, f"{node}/{service}") for what, (node, _) in TUNED.items()
        }

    def _make_server(self) -> Server:
        s = self.settings
        token = token_for(s)
        try:  # here, and not above: the page's libraries are an extra
            from msg_bridge.cockpit.page import make_app
            from msg_bridge.cockpit.server import Server
        except ImportError as error:
            raise InputError(
                f"the cockpit's page needs {error.name}, which is not installed; allowed: make "
                "cockpit, or pip install nicegui"
            ) from None
        return Server(self._session, make_app, s.host, s.port, token)

    def activate(self) -> None:
        """Let browsers fly."""
        self._flying = True

    def deactivate(self) -> None:
        """Let browsers watch alone."""
        self._flying = False

    def cleanup(self) -> None:
        """Leave the graph."""
        self.close()
        self._watching.close()
        self._vitals.close()
        runtime.destroy_publishers(self, self._joy)
        self.destroy_timer(self._looking)
        for clients in (self._verdicts, self._setting, self._getting):
            for client in clients.values():
                self.destroy_client(client)

    def close(self) -> None:
        """Serve no more."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _on_task(self, task: TaskDescription) -> None:
        self.n_actions = task.n_actions

    # ------------------------------------------------------------ what a session calls

    def joy(self, at: Deflection) -> None:
        """Publish where the stick is."""
        if not self._flying or not self.n_actions:
            return
        message = Joy(axes=list(at.axes), buttons=list(at.buttons))
        message.header.stamp, message.header.frame_id = self.get_clock().now().to_msg(), "cockpit"
        self._joy.publish(message)

    def call(self, service: str) -> None:
        """Call a service of the demonstrator, and show its answer."""

        def answered(answer: Any) -> None:
            self._said(answer.message or service, good=answer.success)

        if not _ask(self._verdicts[service], Trigger.Request(), answered):
            self._said(f"{service}: there is no demonstrator", good=False)

    def tune(self, what: str, value: float) -> None:
        """Set one of `TUNED`, and show what came of it."""
        node, name = TUNED[what]
        request = SetParameters.Request()
        request.parameters = [Parameter(name, value=value).to_parameter_msg()]

        def answered(answer: Any) -> None:
            result = answer.results[0]
            text = f"{what}: {value:g}" if result.successful else f"{what}: {result.reason}"
            self._said(text, good=result.successful)
            self._look_at_tuned()

        if not _ask(self._setting[what], request, answered):
            self._said(f"{what}: there is no {node}", good=False)

    def _look_at_tuned(self) -> None:
        """Show what `TUNED` is now, whoever has set it."""
        for what, (_, name) in TUNED.items():

            def answered(answer: Any, what: str = what) -> None:
                is_double = (
                    answer.values and answer.values[0].type == ParameterType.PARAMETER_DOUBLE
                )
                value = answer.values[0].double_value if is_double else None
                if value is not None and self.board.get(what) != value:
                    self.board.put(what, value)

            _ask(self._getting[what], GetParameters.Request(names=[name]), answered)

    def _said(self, text: str, *, good: bool) -> None:
        self.board.put("said", {"text": text, "good": good})

    def _diagnose(self) -> Report:
        report = Report("showing" if self.active else "inactive")
        report.values |= self._session.condition()
        report.values |= {"messages ignored": self._watching.ignored}
        if self._server is not None:
            report.values["address"] = self._server.address
        return report


def _ask(client: Any, request: Any, then: Callable[[Any], None]) -> bool:
    """Call a service without waiting for its answer; False when there is none."""
    if not client.service_is_ready():
        return False
    client.call_async(request).add_done_callback(lambda future: then(future.result()))
    return True


def main() -> int:
    """Run the cockpit."""
    return runtime.main(CockpitNode, "cockpit")
