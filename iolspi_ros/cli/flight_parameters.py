"""What `iolspi fly` does with an autopilot without a graph: look who it is, give back."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from iolspi_ros.cli.progress import console
from iolspi_ros.errors import InputError

if TYPE_CHECKING:
    from iolspi_ros.cli.flight_plan import FlightPlan
    from msg_bridge.mavlink.memory import Remembered
    from msg_bridge.mavlink.preflight import Preflight
    from msg_bridge.mavlink.settings import FlightSettings, LinkSettings

_PATIENCE = 15.0  # for somebody to be heard [s]


def look(plan: FlightPlan) -> None:
    """See who is there, before minutes of practice; nothing is changed.

    Raises
    ------
    InputError
        When it is nobody, not who is to be flown, or as fast as was not said.
    """
    link, flight = plan.settings()
    console.print(f"Looking for {plan.autopilot} at {plan.url} …")
    with _met(link, flight) as preflight:
        preflight.look()


def restore(url: str | None, bridge: Mapping[str, Any] = MappingProxyType({})) -> int:
    """Show what is remembered, and give it back to who answers; the exit status.

    Parameters
    ----------
    url : str, optional
        Where they are now; otherwise where they were met.
    bridge : mapping
        Of the link there: `system`, `signing_key` and the like.
    """
    from iolspi_ros.settings import from_mapping
    from msg_bridge.mavlink.memory import Memory
    from msg_bridge.mavlink.settings import LinkSettings
    from msg_bridge.mavlink.urls import parse

    memory = Memory()
    for vehicle, kept in memory.all():
        number = f", number {vehicle.uid}" if vehicle.uid else ""
        console.print(f"{vehicle.autopilot}, system {vehicle.system}{number}: since {kept.since}, "
                      f"at {kept.url}")  # fmt: skip
        _show(kept)
    for kept in memory.old():
        console.print(
            f"Left by an older version: {kept.place}. With --url as in its name it is given back; "
            "delete it when its vehicle has these values, or was an embedded one."
        )
        _show(kept)
    for damaged in memory.damaged():
        console.print(
            f"Cannot be read: {damaged}. Look at its vehicle's parameters by hand, and delete it."
        )
    places = [(url or kept.url, vehicle.system) for vehicle, kept in memory.all()]
    if url and (not places or memory.old()):
        places.append((url, LinkSettings().system))
    for place, system in dict.fromkeys(places):
        if not url and not _means_one(place):
            continue  # what is remembered, but not where
        values = {"url": str(parse(place)), "system": system, **bridge}
        _give_back(from_mapping(LinkSettings, values, "--bridge"))
    left = [kept for _, kept in memory.all()] + memory.old()
    if not left:
        console.print("Nothing is left changed, as far as is remembered.")
        return 0
    console.print(
        f"{len(left)} still remembered. Start the autopilot and say this again, with --url if it "
        "is elsewhere now."
    )
    return 1


def _means_one(url: str) -> bool:
    """Whether a URL that was written down is one."""
    from msg_bridge.mavlink.urls import parse

    try:
        parse(url)
    except InputError:
        return False
    return True


def _show(kept: Remembered) -> None:
    for name, value in kept.before.items():
        now = f", set to {kept.changed[name]:g}" if name in kept.changed else ""
        console.print(f"  {name} was {value:g}{now}")


def _give_back(link: LinkSettings) -> None:
    from msg_bridge.mavlink.settings import FlightSettings

    console.print(f"Looking at {link.url} …")
    try:
        with _met(link, FlightSettings()) as preflight:
            preflight.find()
            if preflight.armed:
                raise InputError("it is armed: nothing is changed; land it first")
            for failed in preflight.restore(lambda text: console.print(f"  {text}")):
                console.print(f"  {failed}")
    except InputError as error:
        console.print(f"  {error}", markup=False)


@contextmanager
def _met(link: LinkSettings, flight: FlightSettings) -> Iterator[Preflight]:
    """A preflight of who is at an address, without a node."""
    from pathlib import Path

    from msg_bridge.mavlink.clock import VehicleClock
    from msg_bridge.mavlink.codec import read_key
    from msg_bridge.mavlink.link import AutopilotLink
    from msg_bridge.mavlink.memory import Memory
    from msg_bridge.mavlink.preflight import Preflight
    from msg_bridge.mavlink.telemetry import Telemetry
    from msg_bridge.mavlink.transport import open_url

    key = read_key(Path(link.signing_key)) if link.signing_key else None
    telemetry = Telemetry(link.system, link.load_system)
    wire = AutopilotLink(open_url(link.url), telemetry, key)
    patient = dataclasses.replace(link, patience=min(link.patience, _PATIENCE))
    try:
        yield Preflight(
            wire, patient, flight, VehicleClock(flight.real_time_factor), Memory(),
            lambda item: console.print(f"  {item.name}: {item.found}", markup=False),
            say=lambda level, text: console.print(f"  {text}", markup=False),
        )  # fmt: skip
    finally:
        wire.close()
