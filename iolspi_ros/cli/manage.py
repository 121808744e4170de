"""`iolspi manage`: configure and activate a node, as `ros2 lifecycle` does where there is ROS."""

from __future__ import annotations

import time
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.errors import InputError, check_choice

TRANSITIONS = ("configure", "activate", "deactivate", "cleanup", "shutdown")
_THERE = 10.0  # for the node to be found [s]
_ANSWER = 240.0  # for a transition: a preflight takes its time [s]


@app.command(epilog="Example: iolspi manage bridge configure; then: iolspi manage bridge activate")
def manage(
    node: Annotated[str, typer.Argument(help="Name of the node, such as bridge or /v1/learner.")],
    transition: Annotated[
        Optional[str], typer.Argument(help=f"One of: {', '.join(TRANSITIONS)}; none to only look.")
    ] = None,
) -> None:
    """Make a managed node configure, activate, deactivate or clean up; say its state."""
    from iolspi_ros import environment

    if transition is not None:
        check_choice("transition", transition, TRANSITIONS)
    environment.check()
    environment.keep_to_this_machine()
    console.print(f"{node}: {change(node, transition)}")


def change(node: str, transition: str | None) -> str:
    """Ask a node for a transition; its state then.

    Raises
    ------
    InputError
        When it is not there, or refuses.
    """
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState, GetState

    from iolspi_ros import runtime

    place = f"/{node.lstrip('/')}"
    with runtime.session(["manage"]):
        import rclpy

        asking = rclpy.create_node("manage")
        loop = runtime.Loop(asking)
        try:
            if transition is not None:
                request = ChangeState.Request()
                request.transition.label = transition
                name = f"TRANSITION_{transition.upper()}"
                if transition == "shutdown":
                    state = _call(asking, loop, GetState, f"{place}/get_state", GetState.Request())
                    name = f"TRANSITION_{state.current_state.label.upper()}_SHUTDOWN"
                request.transition.id = getattr(Transition, name)
                answer = _call(asking, loop, ChangeState, f"{place}/change_state", request)
                if not answer.success:
                    raise InputError(f"{place} refused to {transition}; its log says why")
            state = _call(asking, loop, GetState, f"{place}/get_state", GetState.Request())
            return str(state.current_state.label)
        finally:
            loop.close()
            asking.destroy_node()


def _call(node: Any, loop: Any, kind: Any, service: str, request: Any) -> Any:
    from iolspi_ros import runtime

    client = node.create_client(kind, service)

    def wait(ready: Any, seconds: float, what: str) -> None:
        end = time.monotonic() + seconds
        while not ready():
            runtime.check()
            if time.monotonic() > end:
                raise InputError(what)
            loop.once(0.05)

    wait(
        client.service_is_ready, _THERE,
        f"nobody answers {service} in this ROS_DOMAIN_ID; allowed: a managed node that runs here",
    )  # fmt: skip
    future = client.call_async(request)
    wait(future.done, _ANSWER, f"{service} did not answer within {_ANSWER:g} s")
    return future.result()
