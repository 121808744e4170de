"""`iolspi bridge`: tell a bridge that runs what to do, without a ROS installation."""

from __future__ import annotations

import time
from typing import Annotated, Any

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.errors import InputError, check_choice, check_range

TRANSITIONS = ("configure", "activate", "deactivate", "cleanup")
SERVICES = ("fly", "land", "reset")
PAUSES = {"pause": True, "resume": False}
WORDS = (*TRANSITIONS, *SERVICES, *PAUSES)
_FOUND = 10.0  # a bridge is looked for [s]


@app.command(epilog="Example: ROS_DOMAIN_ID=42 iolspi bridge fly")
def bridge(
    what: Annotated[str, typer.Argument(help=f"One of: {', '.join(WORDS)}.")],
    name: Annotated[str, typer.Option(help="The node.")] = "bridge",
    patience: Annotated[float, typer.Option(help="For the answer [s]: a preflight takes long.")] = (
        150.0
    ),
) -> None:
    """Tell a running bridge what to do.

    configure, activate, deactivate and cleanup are transitions of the managed node. fly checks a
    vehicle that is down and takes off again; land ends the flight; pause holds, resume goes on;
    reset counts episodes from the beginning. Which graph is a matter of ROS_DOMAIN_ID, which
    the commands that start one print.
    """
    import rclpy

    from iolspi_ros import environment, runtime

    check_choice("what", what, WORDS)
    check_range("--patience", patience, 1.0, 3600.0)
    environment.check()
    environment.keep_to_this_machine()
    with runtime.session():
        node = rclpy.create_node("iolspi_bridge")
        try:
            print(_tell(node, runtime.Loop(node), what, name.strip("/"), patience))
        finally:
            node.destroy_node()


def _tell(node: Any, loop: Any, what: str, name: str, patience: float) -> str:
    """What it answers.

    Raises
    ------
    InputError
        When it is not there, or refuses.
    """
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState
    from std_srvs.srv import SetBool, Trigger

    if what in TRANSITIONS:
        request = ChangeState.Request()
        request.transition.id = getattr(Transition, f"TRANSITION_{what.upper()}")
        answer = _call(node, loop, (ChangeState, f"/{name}/change_state", request), patience)
        success, words = answer.success, "done" if answer.success else "see what it says"
    elif what in PAUSES:
        request = SetBool.Request(data=PAUSES[what])
        answer = _call(node, loop, (SetBool, f"/{name}/pause", request), patience)
        success, words = answer.success, answer.message
    else:
        answer = _call(node, loop, (Trigger, f"/{name}/{what}", Trigger.Request()), patience)
        success, words = answer.success, answer.message
    if not success:
        raise InputError(f"/{name} refused to {what}: {words}")
    return f"{name}: {words}"


def _call(node: Any, loop: Any, call: tuple[Any, str, Any], patience: float) -> Any:
    from iolspi_ros import runtime

    kind, service, request = call
    client = node.create_client(kind, service)
    end = time.monotonic() + _FOUND
    while not client.service_is_ready():
        if time.monotonic() > end:
            raise InputError(
                f"nobody offers {service} in this domain; allowed: the ROS_DOMAIN_ID of a graph "
                "with a bridge"
            )
        runtime.check()
        loop.once(0.05)
    future = client.call_async(request)
    end = time.monotonic() + patience
    while not future.done():
        if time.monotonic() > end:
            raise InputError(f"{service} did not answer in {patience:g} s")
        runtime.check()
        loop.once(0.05)
    return future.result()
