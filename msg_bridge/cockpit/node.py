"""The cockpit as a managed node: a graph in the browser, and a stick for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

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
from msg_bridge.cockpit.stick import Deflection
from msg_bridge.cockpit.watching import Watching

if TYPE_CHECKING:
    from msg_bridge.cockpit.server import Server

PACE = "real_time_factor"
"""The simulator's parameter for slow motion."""


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
        self._set_pace = self.create_client(SetParameters, "simulator/set_parameters")
        self._get_pace = self.create_client(GetParameters, "simulator/get_parameters")
        self._looking = runtime.wall_timer(self, 1.0, self._look_at_pace)
        self._watching = Watching(self, self.board, self._on_task)
        self._vitals = Vitals(self, "showing", (), self._diagnose)
        self._server.start()
        print(f"cockpit: open {self._server.invitation}", flush=True)

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
        self.destroy_publisher(self._joy)
        self.destroy_timer(self._looking)
        for client in (*self._verdicts.values(), self._set_pace, self._get_pace):
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
        message.header.stamp = self.get_clock().now().to_msg()
        runtime.publish(self._joy, message)

    def call(self, service: str) -> None:
        """Call a service of the demonstrator, and show its answer."""

        def answered(answer: Any) -> None:
            self._said(answer.message or service, good=answer.success)

        if not _ask(self._verdicts[service], Trigger.Request(), answered):
            self._said(f"{service}: there is no demonstrator", good=False)

    def speed(self, factor: float) -> None:
        """Set vehicle seconds per second, and show what came of it."""
        request = SetParameters.Request()
        request.parameters = [Parameter(PACE, value=factor).to_parameter_msg()]

        def answered(answer: Any) -> None:
            result = answer.results[0]
            text = f"{factor:g} of real time" if result.successful else f"speed: {result.reason}"
            self._said(text, good=result.successful)
            self._look_at_pace()

        if not _ask(self._set_pace, request, answered):
            self._said("speed: there is no simulator", good=False)

    def _look_at_pace(self) -> None:
        """Show vehicle seconds per second, whoever has set them."""

        def answered(answer: Any) -> None:
            factor = answer.values[0].double_value if answer.values else 0.0
            shown = self.board.get("speed")
            if factor and (shown is None or shown["factor"] != factor):
                self.board.put("speed", {"factor": factor})

        _ask(self._get_pace, GetParameters.Request(names=[PACE]), answered)

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
