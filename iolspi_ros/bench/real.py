"""The bridge on an autopilot that somebody has: whole flights, and bridges killed in flight."""

from __future__ import annotations

import ast
import contextlib
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.bench.reckless import EPISODE
from iolspi_ros.bench.rows import Row, at_least, at_most
from iolspi_ros.errors import InputError
from iolspi_ros.nodes.start import PARENT
from iolspi_ros.settings import from_mapping
from msg_bridge.mavlink.clock import VehicleClock
from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.envelope import Limits
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.memory import Memory
from msg_bridge.mavlink.preflight import Preflight
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url

DUNKS = {"px4": 0.85, "ardupilot": 0.9}
"""Goals of the share of episodes that end with a dunk."""
_MOMENT = (0.05, 4.0)  # after the begin of an episode, at which a bridge dies [s]
_WATCHED = 12.0  # after that: everything stands by then [s]
_ASK = 0.3  # without a position, after which it is asked for [s] of machine time
_READY = 240.0  # until an episode begins [s] of machine time
_END = 120.0  # until it is down [s] of machine time


class Kill(NamedTuple):
    """A bridge that died.

    Attributes
    ----------
    x, speed : float
        Of the vehicle, as first heard after that [m], [m/s].
    least, most : float
        x of the vehicle from then on [m].
    """

    x: float
    speed: float
    least: float
    most: float


def rows(
    commands: list[list[str]], values: dict[str, Any], kills: int, folder: Path,
    show: Callable[[int], None],
) -> list[Row]:  # fmt: skip
    """Fly, kill, and say what came of it.

    Parameters
    ----------
    commands : list of list of str
        Options of `iolspi fly`, for each flight.
    values : dict
        Parameters of the bridge.
    kills : int
        Of bridges.
    folder : Path
        For all that is left.
    show : callable
        Takes how many flights and kills are done.
    """
    before = lent(values)
    found, done = [], 0
    for number, command in enumerate(commands):
        found.append(flown(command, folder / f"flight_{number}"))
        show(done := done + 1)
    name = str(values["autopilot"])
    table = of_flights(name, found) if found else []
    changed = _differing(before, lent(values)) if found else 0
    if kills:
        died = []
        for kill in killed(values, kills, folder):
            died.append(kill)
            (folder / "kills.json").write_text(json.dumps([one._asdict() for one in died]) + "\n")
            show(done := done + 1)
        table += of_kills(name, died, from_mapping(Limits, values, "the bridge"))
        changed += _differing(before, lent(values))
    return [*table, at_most(f"{name}: parameters left changed", float(changed), "", 0.0)]


def lent(values: dict[str, Any]) -> dict[str, float]:
    """Those parameters of the autopilot that a flight changes, as they are now."""
    with _met(values) as preflight:
        profile, client = preflight.find()
        return dict(client.first(change.names) for change in profile.changes)


def _differing(before: dict[str, float], after: dict[str, float]) -> int:
    return sum(after.get(name) != value for name, value in before.items())


@contextlib.contextmanager
def _met(values: dict[str, Any]) -> Iterator[Preflight]:
    link = from_mapping(LinkSettings, values, "the bridge")
    flight = from_mapping(FlightSettings, values, "the bridge")
    telemetry = Telemetry(link.system, link.load_system)
    wire = AutopilotLink(open_url(link.url), telemetry)
    try:
        clock = VehicleClock(flight.real_time_factor)
        yield Preflight(wire, link, flight, clock, Memory(), lambda item: None)
    finally:
        wire.close()


# ---------------------------------------------------------------- flights


def flown(command: list[str], folder: Path) -> dict[str, Any]:
    """One run of `iolspi fly`: its summary, with its exit status and how long it took [s]."""
    begin = time.monotonic()
    with folder.with_suffix(".log").open("w") as log:
        status = subprocess.run(
            [sys.executable, "-m", "iolspi_ros", "fly", *command, "--out", str(folder)],
            stdout=log, stderr=log, check=False,
        ).returncode  # fmt: skip
    seconds = time.monotonic() - begin
    try:
        summary = json.loads((folder / "summary.json").read_text())
    except (OSError, ValueError):
        summary = {}
    return {**summary, "status": status, "seconds": seconds}


def of_flights(name: str, found: list[dict[str, Any]]) -> list[Row]:
    """What the summaries of flights say."""

    def total(key: str) -> float:
        return sum(float(one.get(key) or 0.0) for one in found)

    episodes, releases = total("flown_episodes"), [
        ast.literal_eval(one.get("releases") or "{}") for one in found
    ]  # fmt: skip
    made = sum(n for one in releases for n in one.values())
    moved = sum(n for one in releases for seen, n in one.items() if "seen to" in seen)
    name = f"{name}, {len(found)} flights, {episodes:g} episodes"
    ended = np.mean([one["status"] == 0 for one in found])
    dunks = [one.get("flown_successes", 0) / max(one.get("flown_episodes", 0), 1) for one in found]
    goal = DUNKS.get(str(found[0].get("autopilot")), 0.85)
    return [
        at_least(f"{name}: ended as planned", float(ended), "share", 1.0),
        at_least(f"{name}: dunks", total("flown_successes") / max(episodes, 1.0), "share", goal),
        Row(f"{name}: dunks of the worst flight", min(dunks), "share"),
        at_least(f"{name}: releases that were seen", moved / max(made, 1), "share", 1.0),
        at_most(f"{name}: crashes", total("flown_crashes"), "", 0.0),
        at_most(f"{name}: envelope left", total("envelope_left"), "times", 0.0),
        Row(f"{name}: broken off", total("episodes_abandoned"), "episodes"),
        Row(f"{name}: took, the longest", max(one["seconds"] for one in found) / 60.0, "min"),
    ]


# ---------------------------------------------------------------- kills


def killed(values: dict[str, Any], n: int, folder: Path) -> Iterator[Kill]:
    """Bridges that are killed at random moments of episodes; the last one lands.

    Raises
    ------
    InputError
        When no episode begins any more.
    """
    rng = np.random.default_rng([int(values.get("seed", 0)), 29])
    factor = float(values["real_time_factor"])
    for seed in range(n):
        process = _start(values, seed, folder)
        try:
            _until_episode(process, folder / f"{seed}.log")
            time.sleep(float(rng.uniform(*_MOMENT)) / factor)
            process.kill()
        except BaseException:
            process.terminate()  # it lands
            raise
        finally:
            process.wait(_END)
        yield watch(values, folder / f"{seed}_after.tlog")
    process = _start(values, n, folder)
    try:
        _until_episode(process, folder / f"{n}.log")
    finally:
        process.terminate()
        process.wait(_END)


def _start(values: dict[str, Any], seed: int, folder: Path) -> subprocess.Popen[bytes]:
    given = json.dumps(values | {"seed": seed})
    with (folder / f"{seed}.log").open("wb") as log:
        return subprocess.Popen(
            [sys.executable, "-m", "iolspi_ros.bench.reckless", given, str(seed), str(folder)],
            stdout=log, stderr=log, env=os.environ | {PARENT: str(os.getpid())},
        )  # fmt: skip


def _until_episode(process: subprocess.Popen[bytes], log: Path) -> None:
    end = time.monotonic() + _READY
    while EPISODE not in (said := log.read_text()):
        if process.poll() is not None or time.monotonic() > end:
            last = said.strip().splitlines()[-1:] or ["nothing"]
            raise InputError(f"no episode begins; {log} ends with: {last[0]}")
        time.sleep(0.002)


def watch(values: dict[str, Any], log: Path | None = None) -> Kill:
    """Hear where the vehicle goes that nobody flies any more; nothing is sent but a request.

    Parameters
    ----------
    values : dict
        Parameters of the bridge.
    log : Path, optional
        A .tlog of all that is heard.

    Raises
    ------
    InputError
        When nothing of it is heard.
    """
    link, flight = (
        from_mapping(kind, values, "the bridge") for kind in (LinkSettings, FlightSettings)
    )
    clock = VehicleClock(flight.real_time_factor)
    track = Track((flight.origin[0], flight.origin[1]), flight.heading)
    telemetry = Telemetry(link.system, link.load_system)
    transport = open_url(link.url)
    wire = AutopilotLink(transport, telemetry, log=log)
    places: list[tuple[float, float]] = []
    asked = clock.elapsed()
    try:
        while clock.now() < _WATCHED:
            heard = telemetry.position_time
            transport.wait(0.02)
            while data := transport.read():  # all of it, and without a heartbeat of ours
                transport.answer(transport.source)
                for message in wire.codec.read(data, whole=transport.datagrams):
                    telemetry.take(message, clock.now())
            if telemetry.position_time > heard:
                along = float(track.place_here(telemetry.position)[0])
                places.append((along, float(track.here(telemetry.velocity)[0])))
            elif not places and clock.elapsed() - asked > _ASK:
                asked = clock.elapsed()
                wire.command(
                    dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
                    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 2e4,
                )  # fmt: skip
    finally:
        wire.close()
    if not places:
        raise InputError(f"nothing is heard of the vehicle at {link.url} after a kill")
    x = [place for place, _ in places]
    return Kill(*places[0], min(x), max(x))


def of_kills(name: str, kills: list[Kill], limits: Limits) -> list[Row]:
    """How near they came to the walls."""
    low, high = limits.box
    name = f"{name}, bridge killed {len(kills)} times"
    rooms = [min(kill.least - low, high - kill.most) for kill in kills]
    ways = [max(kill.most - kill.x, kill.x - kill.least) for kill in kills]
    return [
        at_least(f"{name}: least distance to a wall", min(rooms), "m", 0.0),
        Row(f"{name}: the same, median", float(np.median(rooms)), "m"),
        Row(f"{name}: longest way to rest", max(ways), "m"),
        Row(f"{name}: fastest", max(abs(kill.speed) for kill in kills), "m/s"),
    ]
