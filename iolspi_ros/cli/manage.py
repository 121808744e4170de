"""`iolspi manage`: what `ros2 lifecycle` and `ros2 service` do, where there is no ROS."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.errors import InputError, check_choice

TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "shutdown")
TRIGGER, SWITCH = "std_srvs/srv/Trigger", "std_srvs/srv/SetBool"
_THERE = 10.0  # for the node to be found [s]
_ANSWER = 240.0  # for an answer: a preflight takes its time [s]


@app.command(epilog="Example: iolspi manage bridge fly; iolspi manage simulator pause on")
def manage(
    node: Annotated[str, typer.Argument(help="Name of the node, such as bridge or /v1/learner.")],
    what: Annotated[
        Optional[str],
        typer.Argument(
            help=f"One of: {', '.join(TRANSITIONS)}, or a service of the node, such as fly, land, "
            "pause or save; none to only look."
        ),
    ] = None,
    switch: Annotated[
        Optional[str], typer.Argument(help="on or off, for a service that wants to know.")
    ] = None,
) -> None:
    """Make a managed node configure, activate, deactivate or clean up, or call its services.

    Says the node's state, or its answer. Which graph is a matter of ROS_DOMAIN_ID, which the
    commands that start one print.
    """
    import rclpy

    from iolspi_ros import environment, runtime

    if switch is not None:
        check_choice("switch", switch, ("on", "off"))
    environment.check()
    environment.keep_to_this_machine()
    with runtime.session(["manage"]):
        asking = rclpy.create_node("manage")
        asked = _Asked(asking, runtime.Loop(asking), f"/{node.lstrip('/')}")
        try:
            if what is None or what in TRANSITIONS:
                answer = asked.change(what)
            else:
                answer = asked.call(what, switch)
        finally:
            asked.loop.close()
            asking.destroy_node()
    console.print(f"{node}: {answer}")


class _Asked:
    """A node that is told what to do.

    Raises
    ------
    InputError
        From its methods, when it is not there, does not answer, or refuses.
    """

    def __init__(self, asking: Any, loop: Any, place: str) -> None:
        self._asking, self.loop, self._place = asking, loop, place

    def change(self, transition: str | None) -> str:
        """Ask for a transition; its state then."""
        from lifecycle_msgs.msg import Transition
        from lifecycle_msgs.srv import ChangeState, GetState

        def state() -> str:
            answer = self._answer(GetState, "get_state", GetState.Request())
            return str(answer.current_state.label)

        if transition is not None:
            before = f"{state().upper()}_" if transition == "shutdown" else ""
            request = ChangeState.Request()
            request.transition.label = transition
            request.transition.id = getattr(Transition, f"TRANSITION_{before}{transition.upper()}")
            if not self._answer(ChangeState, "change_state", request).success:
                raise InputError(f"{self._place} refused to {transition}; its log says why")
        return state()

    def call(self, service: str, switch: str | None) -> str:
        """Call one of its own services; what it answers."""
        from std_srvs.srv import SetBool, Trigger

        offered = self._services()
        if service not in offered:
            allowed = ", ".join((*TRANSITIONS, *sorted(offered)))
            raise InputError(f"{self._place} does not {service}; allowed: {allowed}")
        if (offered[service] == SWITCH) != (switch is not None):
            wanted = "nothing behind it" if switch else "on or off behind it"
            raise InputError(f"{service} of {self._place} wants {wanted}")
        kind = SetBool if switch else Trigger
        request = SetBool.Request(data=switch == "on") if switch else Trigger.Request()
        answer = self._answer(kind, service, request)
        if not answer.success:
            raise InputError(f"{self._place} refused to {service}: {answer.message}")
        return str(answer.message)

    def _services(self) -> dict[str, str]:
        """Those that can be called from here: name and type."""
        found: dict[str, str] = {}

        def there() -> bool:
            for name, kinds in self._asking.get_service_names_and_types():
                place, _, service = name.rpartition("/")
                if place == self._place and kinds[0] in (TRIGGER, SWITCH):
                    found[service] = kinds[0]
            return bool(found)

        self._wait(there, _THERE, self._nobody("services"))
        return found

    def _answer(self, kind: Any, service: str, request: Any) -> Any:
        client = self._asking.create_client(kind, f"{self._place}/{service}")
        self._wait(client.service_is_ready, _THERE, self._nobody(service))
        future = client.call_async(request)
        late = f"{self._place}/{service} did not answer within {_ANSWER:g} s"
        self._wait(future.done, _ANSWER, late)
        return future.result()

    def _nobody(self, service: str) -> str:
        return (
            f"nobody answers {self._place}/{service} in this ROS_DOMAIN_ID; allowed: a node that "
            "runs there"
        )

    def _wait(self, ready: Callable[[], bool], seconds: float, what: str) -> None:
        from iolspi_ros import runtime

        end = time.monotonic() + seconds
        while not ready():
            runtime.check()
            if time.monotonic() > end:
                raise InputError(what)
            self.loop.once(0.05)
