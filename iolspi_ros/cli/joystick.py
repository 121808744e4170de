"""`iolspi joystick`: names the axes and buttons of a joystick by moving them."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console
from iolspi_ros.errors import InputError


@app.command(epilog="Example: iolspi joystick --out my_stick.yaml --takeover")
def joystick(
    out: Annotated[Path, typer.Option(help="Parameter file to write.")] = Path("joystick.yaml"),
    button: Annotated[
        Optional[list[int]], typer.Option(help="An action to have a button; may be repeated.")
    ] = None,
    takeover: Annotated[
        bool, typer.Option(help="Ask for the button that takes over, too.")
    ] = False,
    topic: Annotated[str, typer.Option(help="Where the driver says what it reads.")] = "joy",
    patience: Annotated[
        float, typer.Option(min=1.0, help="Give up after so many seconds without an answer.")
    ] = 60.0,
) -> None:
    """Ask for one movement after the other, and write what they are to a parameter file.

    A driver must run: `ros2 run joy joy_node`, or the cockpit.
    """
    import yaml

    from iolspi_ros.nodes.calibration import Calibration

    if out.exists():
        raise InputError(f"{out} exists already; allowed: --out with a file that is not there yet")
    if any(action < 0 for action in button or ()):
        raise InputError("--button is negative; allowed: the number of an action, from 0")
    calibration = Calibration(button or (), takeover=takeover)
    _ask(calibration, topic, patience)
    values = {"source": "joy"} | calibration.parameters()
    text = yaml.safe_dump({"/**/demonstrator": {"ros__parameters": values}}, sort_keys=False)
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise InputError(f"{out} cannot be written: {error.strerror}") from error
    console.print(
        f"{out} is there. Fly with\n    iolspi run demonstrator --ros-args --params-file {out}",
        highlight=False,
    )


def _ask(calibration: Any, topic: str, patience: float) -> None:
    """Put every question, until the joystick has answered it."""
    import rclpy
    from sensor_msgs.msg import Joy

    from iolspi_ros import environment, qos, runtime

    environment.keep_to_this_machine()
    with runtime.session():
        node = rclpy.create_node("calibration")
        heard, since = 0, time.monotonic()

        def take(message: Any) -> None:
            nonlocal heard, since
            heard += 1
            if calibration.take(message.axes, message.buttons):
                since = time.monotonic()
                _say(calibration)

        node.create_subscription(Joy, topic, take, qos.CONTROL)
        _say(calibration)
        with closing(runtime.Loop(node)) as loop:
            while calibration.question:
                runtime.check()
                if time.monotonic() - since > patience:
                    name = node.resolve_topic_name(topic)
                    raise InputError(
                        f"{heard} messages on {name}, and for {patience:g} s none that answers; "
                        "allowed: a driver that repeats, such as ros2 run joy joy_node"
                    )
                loop.once(0.1)
        node.destroy_node()


def _say(calibration: Any) -> None:
    """What was found last, and what is asked for next."""
    for text in filter(None, (calibration.found, calibration.question)):
        console.print(f"Now {text}." if text == calibration.question else f"  {text}",
                      highlight=False)  # fmt: skip
