"""The flight of `iolspi fly`: the graph from preflight to landing, and what a person sees of it."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from iolspi_ros.cli.flight_plan import FlightPlan
from iolspi_ros.cli.following import Follower
from iolspi_ros.cli.progress import bar, console
from iolspi_ros.errors import InputError

if TYPE_CHECKING:
    from iolspi_ros.graph import Graph
    from iolspi_ros.nodes.monitor import Monitor

_LOAD_RATE = 20.0  # of the embedded autopilot's load [Hz]
_STALLED = 180.0, 60.0  # without the end of an episode: vehicle time and, besides, wall time [s]
_LANDING = 120.0  # [s]
_AGAIN = 10.0  # between two of the same words [s]
_WARN = 30  # rcl_interfaces/msg/Log
_SPEAKING = ("bridge", "learner", "demonstrator")
_KEPT = (
    "load",
    "releases",
    "chances",
    "episodes abandoned",
    "envelope left",
    "envelope interventions",
)


class Flown(NamedTuple):
    """How a flight ended.

    Attributes
    ----------
    learned : int
        Episodes that ended while it learned.
    said : dict of str to str
        What the bridge says of it, for the summary.
    trouble : str
        Why it ended before it should; empty when it did not.
    """

    learned: int
    said: dict[str, str]
    trouble: str = ""


class Warnings:
    """Prints what the nodes warn of, from /rosout, as it comes; the same not all the time.

    Parameters
    ----------
    monitor : Monitor
    """

    def __init__(self, monitor: Monitor) -> None:
        from rcl_interfaces.msg import Log

        from iolspi_ros import qos

        self._said: dict[str, float] = {}
        self._more: dict[str, int] = {}
        monitor.create_subscription(Log, "/rosout", self._on_log, qos.REPORTS)

    def _on_log(self, message: Any) -> None:
        if message.name in _SPEAKING and message.level >= _WARN:
            self.take(f"{message.name}: {message.msg}", time.monotonic())

    def take(self, text: str, now: float) -> None:
        """Print it, unless it was printed a moment ago; then it is counted."""
        if now - self._said.get(text, -_AGAIN) < _AGAIN:
            self._more[text] = self._more.get(text, 0) + 1
            return
        self._said[text] = now
        more = self._more.pop(text, 0)
        console.print(f"  {text}" + (f" (said {more} times more)" if more else ""), markup=False)

    def finish(self) -> None:
        """Print what was counted and not said since."""
        for text, more in self._more.items():
            console.print(f"  {text} (said {more} times more)", markup=False)
        self._more.clear()


class Broken:
    """Prints each time that episodes were broken off, so that no count of others hides them."""

    def __init__(self, monitor: Monitor) -> None:
        self._monitor, self._seen = monitor, 0

    @property
    def count(self) -> int:
        """Episodes broken off so far."""
        said = self._monitor.conditions.get("bridge", {}).get("episodes abandoned", "0")
        return int(said)

    def look(self) -> None:
        """Say it when there are more."""
        if (count := self.count) > self._seen:
            self._seen = count
            console.print(f"  broken off so far: {count} episodes; nobody learns from those")


def start_embedded(nodes: Graph, plan: FlightPlan) -> None:
    """Start the embedded autopilot at the other end of the plan's address."""
    from msg_bridge.mavlink import urls
    from sim_nodes.autopilot.firmware import WITH_GRIPPER

    kind, place, port = urls.parse(plan.url)
    there = {"udpin": "udpout", "udpout": "udpin"}[kind]
    booted = {"SIM_LOAD_RATE": _LOAD_RATE} | WITH_GRIPPER[plan.autopilot]
    values = [part for name, value in booted.items() for part in ("--param", f"{name}={value}")]
    nodes.run(
        "sitl", "iolspi_ros", "sitl", "--like", plan.autopilot, "--url", f"{there}:{place}:{port}",
        "--speed-up", str(plan.speed_up), "--ready-after", "5.0", *values,
    )  # fmt: skip


class Flight:
    """Checks, teaches, flies, shows, lands.

    Parameters
    ----------
    nodes : Graph
    monitor : Monitor
    plan : FlightPlan
    out : Path
        Folder for what is left.
    """

    def __init__(self, nodes: Graph, monitor: Monitor, plan: FlightPlan, out: Path) -> None:
        self._nodes, self._monitor, self._plan = nodes, monitor, plan
        self._out = out.resolve()
        self._follower = Follower(nodes, monitor)
        self._broken = Broken(monitor)
        self._learned = 0
        self._landing = 0.0

    def fly(self) -> Flown:
        """Do it all; what goes wrong in the air ends the flight, and is no error any more.

        Raises
        ------
        InputError
            When nothing flew.
        """
        self._prepare()
        self._monitor.change_state("bridge", "activate")
        try:
            self._learn()
            self._show()
        except InputError as error:
            return self._end(str(error))
        return self._end("")

    def _prepare(self) -> None:
        plan, config = self._plan, self._plan.config
        bridge = {"autostart": "configure", "log": str(self._out / "flight.tlog")}
        self._nodes.start("bridge", bridge | plan.parameters(), config)
        self._check()
        keep = self._out / "checkpoint.npz"
        learner: dict[str, Any] = {
            "seed": plan.seed, "checkpoint": str(keep), "background": True,
        }  # fmt: skip
        if plan.checkpoint:
            shutil.copy(plan.checkpoint, keep)
        self._nodes.start("learner", learner | {"resume": plan.checkpoint is not None}, config)
        self._follower.wait(self._monitor.connected, 60.0, "the start of bridge and learner")
        if plan.bag:
            self._teach(plan.bag)

    def _check(self) -> None:
        """Wait for the preflight, and print its list as it grows."""
        from msg_bridge.mavlink.node import PREFLIGHT

        console.print("Preflight:")
        printed: set[str] = set()

        def passed() -> bool:
            found = self._monitor.conditions.get(PREFLIGHT, {})
            for name, value in found.items():
                if name not in printed and name != "result":
                    printed.add(name)
                    console.print(f"  {name}: {value}", markup=False)
            return found.get("result") == "passed"

        self._follower.wait(passed, 200.0, "the preflight")

    def _teach(self, bag: Path) -> None:
        from iolspi_ros.bags import read_card

        monitor = self._monitor
        monitor.listen_to_samples()
        replay = {"bags": [str(bag)], "source": "bag", "listeners": 2}
        self._nodes.start("demonstrator", replay | {"learner_timeout": 60.0}, self._plan.config)
        samples = int(read_card(bag).get("samples", 1))
        follow = self._follower.follow
        follow("replaying demonstrations", samples, lambda: len(monitor.demonstrated), 60.0)
        follow("learning offline", 1, lambda: monitor.updates, 120.0)

    def _learn(self) -> None:
        """Take off, and fly episodes while learning."""
        if self._plan.episodes:
            self._episodes("learning online [episodes]", self._plan.episodes, 0)
            try:
                self._monitor.trigger("/learner/save")
            except InputError as error:  # it saves by itself, too, and at its end
                console.print(f"  not saved just now: {error}", markup=False)

    def _show(self) -> None:
        """Fly episodes without learning, and land."""
        monitor, plan = self._monitor, self._plan
        monitor.switch("/learner/learn", on=False)
        self._learned = len(monitor.scores)
        monitor.set_parameters("bridge", order="sweep", episodes=plan.shown)
        monitor.trigger("/bridge/reset")
        self._episodes("showing [episodes]", plan.shown, self._learned)
        monitor.wait_for_ends(self._learned + plan.shown, 7.0)
        self._follower.wait(self._down, _LANDING, "landing")

    def _episodes(self, what: str, total: int, before: int) -> None:
        """Follow episodes as long as one ends now and then.

        Raises
        ------
        InputError
            When none does for long.
        """
        vehicle, wall = _STALLED
        patience = wall + vehicle / self._plan.speed_up
        ended, since = before, time.monotonic()
        with bar(what, total) as show:

            def ready() -> bool:
                nonlocal ended, since
                self._broken.look()
                count = len(self._monitor.scores)
                if count > ended:
                    ended, since = count, time.monotonic()
                if time.monotonic() - since > patience:
                    raise InputError(
                        f"{what}: none has ended for {patience:.0f} s, after {count - before} of "
                        f"{total}, with {self._broken.count} broken off; the bridge says: "
                        f"{self._bridge_says()}"
                    )
                show(count - before)
                return count - before >= total

            self._follower.wait(ready, float("inf"), what)

    # ------------------------------------------------------------ the end

    def _down(self) -> bool:
        said = self._monitor.conditions.get("bridge", {})
        return said.get("phase") in ("down", "idle")

    def _bridge_says(self) -> str:
        said = self._monitor.conditions.get("bridge", {})
        return f"{said.get('phase', 'nothing')}, {said.get('authority', '')}: {said.get('reason')}"

    def _end(self, trouble: str) -> Flown:
        """Land what still flies, and gather what is known."""
        if trouble:
            console.print("[bold]The flight ends:[/bold]", end=" ")
            console.print(trouble, markup=False)
            if "bridge" in self._nodes.ended():
                self._abandoned()
            else:
                self._land()
        said = self._monitor.conditions.get("bridge", {})
        known = {name.replace(" ", "_"): said.get(name, "") for name in _KEPT}
        learned = self._learned or len(self._monitor.scores)
        return Flown(min(learned, self._plan.episodes), known, trouble)

    def _land(self) -> None:
        try:
            if not self._down():
                console.print("  landing …")
                self._monitor.change_state("bridge", "deactivate")
                self._follower_of_bridge(self._down)
        except InputError as error:
            console.print(f"  it was not seen to land: {error}", markup=False)

    def _follower_of_bridge(self, ready: Callable[[], bool]) -> None:
        """Wait for the bridge, whoever else has ended."""

        def looked() -> bool:
            if "bridge" in self._nodes.ended():
                raise InputError("the bridge has ended")
            return ready()

        self._monitor.wait(looked, _LANDING, "landing")

    def _abandoned(self) -> None:
        """The bridge is gone: say what flies, and what a person should do."""
        if self._down():
            return
        after = {"px4": "holds its position (HOLD)", "ardupilot": "stops and hovers in GUIDED"}
        console.print(
            "  [bold]The vehicle may still be in the air[/bold]: without a bridge "
            f"{self._plan.vehicle} {after[self._plan.autopilot]} by the time-outs set for that.\n"
            "  Take it over with a ground station or a transmitter, and choose LAND; or run "
            "iolspi fly again, which flies on from the air.\n"
            "  Its parameters are still those of the flight: iolspi fly --restore gives them back."
        )


def end_bridge(nodes: Graph, plan: FlightPlan) -> None:
    """End the bridge before all others, so that it can land and give back; say what is left."""
    from msg_bridge.mavlink.memory import Memory

    nodes.end("bridge", 20.0)
    for vehicle, kept in Memory().all():
        if kept.url == plan.url and not plan.embedded:
            names = ", ".join(f"{name} (was {value:g})" for name, value in kept.before.items())
            console.print(
                f"[bold]Not given back[/bold] to {vehicle.autopilot}, system {vehicle.system}: "
                f"{names}. iolspi fly --restore does it, once {plan.url} answers."
            )
