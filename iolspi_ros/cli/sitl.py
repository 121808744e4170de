"""`iolspi sitl`: the embedded autopilot, to fly on any machine."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Annotated, Any, Optional

import typer

from iolspi_ros.cli.app import app
from iolspi_ros.cli.progress import console


@app.command(epilog="Example: iolspi sitl --like px4 --speed-up 2 --wind 3 --gusts 1")
def sitl(
    like: Annotated[str, typer.Option(help="Whom it imitates: px4 or ardupilot.")] = "ardupilot",
    url: Annotated[
        Optional[list[str]],
        typer.Option(
            help="udpout:HOST:PORT, or udpin:HOST:PORT to wait there; may be repeated. Else to "
            "ports 14540 and 14550 of this machine."
        ),
    ] = None,
    speed_up: Annotated[float, typer.Option(min=0.0, help="Times real time.")] = 1.0,
    wind: Annotated[float, typer.Option(min=0.0, help="From the north [m/s].")] = 0.0,
    gusts: Annotated[float, typer.Option(min=0.0, help="Standard deviation [m/s].")] = 0.0,
    noise: Annotated[float, typer.Option(min=0.0, help="Of the estimated position [m].")] = 0.0,
    delay: Annotated[float, typer.Option(min=0.0, help="Of the link, each way [s].")] = 0.0,
    loss: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Share of datagrams lost, each way.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Of noise, gusts and losses.")] = 0,
    ready_after: Annotated[
        Optional[float],
        typer.Option(min=0.0, help="Seconds after boot until it can be armed, if not as the real."),
    ] = None,
    signing: Annotated[
        Optional[Path],
        typer.Option(help="File with the key of MAVLink signatures: nothing unsigned is taken."),
    ] = None,
    param: Annotated[
        Optional[list[str]], typer.Option(help="NAME=VALUE from boot on; may be repeated.")
    ] = None,
) -> None:
    """A quadrotor with a slung load that speaks MAVLink 2, until it is interrupted.

    It refuses, waits and fails as the autopilot it imitates; docs/embedded_autopilot.md says how
    far. Nothing is sent anywhere but to the addresses given.
    """
    from iolspi_ros.nodes.start import follow_parent
    from sim_nodes.autopilot.server import Sitl, read_key

    follow_parent()
    values: dict[str, float] = {
        "SIM_SPEEDUP": speed_up, "SIM_WIND_SPD": wind, "SIM_WIND_TURB": gusts, "SIM_NOISE": noise,
        "SIM_DELAY": delay, "SIM_LOSS": loss,
    }  # fmt: skip
    values |= dict(_assignment(text) for text in param or ())
    key = None if signing is None else read_key(signing)
    urls = url or ["udpout:127.0.0.1:14540", "udpout:127.0.0.1:14550"]
    with console.status("preparing; the first time this takes some seconds"):
        vehicle = Sitl(like, urls, values, seed, key, ready_after)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: vehicle.stop())
    places = ", ".join(f"{u} from {host}:{port}" for u, (host, port) in
                       zip(urls, vehicle.addresses, strict=True))  # fmt: skip
    console.print(f"{like}: {places}")
    vehicle.run(_Show())
    if vehicle.autopilot.commander.aborted:
        console.print(f"aborted: {vehicle.autopilot.commander.aborted}")
        raise typer.Exit(3)


def _assignment(text: str) -> tuple[str, float]:
    from iolspi_ros.errors import InputError

    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise InputError(f"--param is {text!r}; allowed: NAME=NUMBER") from None


class _Show:
    """Says what changed: the mode, and whether it is armed."""

    def __init__(self) -> None:
        self._said = ""

    def __call__(self, autopilot: Any) -> None:
        commander = autopilot.commander
        armed = "armed" if commander.armed else "disarmed"
        said = f"{autopilot.firmware.names[commander.mode]}, {armed}"
        if said != self._said:
            self._said = said
            console.print(f"{autopilot.now:.1f} s: {said}")
