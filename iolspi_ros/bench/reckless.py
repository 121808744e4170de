"""A bridge that flies episodes of reckless accelerations, in a process that can be killed.

Its first argument is a JSON object of the bridge's parameters, its second a seed, its third a
folder for its log. It prints EPISODE when one begins, and lands on SIGTERM or SIGINT.
"""

from __future__ import annotations

import json
import queue
import signal
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from iolspi_ros.core.samples import Observation
from iolspi_ros.nodes.start import follow_parent
from iolspi_ros.settings import from_mapping
from msg_bridge.mavlink.arbiter import Timeouts
from msg_bridge.mavlink.clock import VehicleClock
from msg_bridge.mavlink.envelope import Limits
from msg_bridge.mavlink.flight import Flight
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.memory import Memory
from msg_bridge.mavlink.phases import Phase
from msg_bridge.mavlink.preflight import Preflight
from msg_bridge.mavlink.runner import Runner
from msg_bridge.mavlink.settings import FlightSettings, LinkSettings
from msg_bridge.mavlink.status import Outputs
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad

EPISODE = "an episode begins"
PUSHES = (0, 1, 2)
"""Back, neutral, on."""
_MIDDLE = -1.75  # of the walls [m]
_LANDING = 60.0  # [s] of vehicle time


def reckless(rng: np.random.Generator, hold: float = 0.6) -> Callable[[Observation], int]:
    """Accelerations held for any time, `hold` [s] in the mean, more often towards the nearer wall.

    Returns
    -------
    callable
        Takes an observation of the slung load, gives an action that releases nothing.
    """
    until, action = 0, 1

    def act(seen: Observation) -> int:
        nonlocal until, action
        if seen.step == 0 or seen.step >= until:
            until = seen.step + 1 + int(rng.exponential(hold) / 0.1)
            towards = 2 if seen.state[0] > _MIDDLE else 0
            action = towards if rng.random() < 0.5 else int(rng.choice(PUSHES))
        return action

    return act


def warm_up(task: SlungLoad) -> None:
    """Compile what is needed in flight, as the bridge's node does: the first call takes long."""
    state = task.initial_states()[0]
    task.step(state, RELEASE)
    task.judge(state, state)


def _say(level: str, text: str) -> None:
    print(f"{level}: {text}", flush=True)


def fly(values: dict[str, Any], seed: int, folder: Path) -> None:
    """Take off, and fly until a signal comes; then land, and give the parameters back."""
    link_settings, settings, limits, timeouts = (
        from_mapping(kind, values, "the bridge")
        for kind in (LinkSettings, FlightSettings, Limits, Timeouts)
    )
    ending = threading.Event()
    clock = VehicleClock(settings.real_time_factor)
    telemetry = Telemetry(link_settings.system, link_settings.load_system)
    link = AutopilotLink(open_url(link_settings.url), telemetry, log=folder / f"{seed}.tlog")
    preflight = Preflight(
        link, link_settings, settings, clock, Memory(),
        lambda item: print(f"{item.name}: {item.found}", flush=True), say=_say,
    )  # fmt: skip
    seen: queue.SimpleQueue[Observation] = queue.SimpleQueue()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ending.set())
    task = SlungLoad()
    warm_up(task)
    try:
        profile = preflight.run()
        flight = Flight(
            task, link, profile, settings, limits, timeouts, Outputs(seen.put, _say),
            preflight.release.output,
        )  # fmt: skip
        runner = Runner(flight, clock, _say)
        runner.start()
        flight.begin(clock.now())
        act = reckless(np.random.default_rng([seed, 17]))
        while not ending.is_set():
            try:
                observation = seen.get(timeout=0.02)
            except queue.Empty:
                continue
            if observation.step == 0:
                print(EPISODE, flush=True)
            if not observation.last:
                flight.act(
                    observation.episode, observation.step, act(observation), clock.now()
                )  # fmt: skip
        flight.land(clock.now(), "the kills are over")
        end = clock.now() + _LANDING
        while flight.phase is not Phase.DOWN and clock.now() < end:
            ending.clear()
            ending.wait(0.05)
        runner.stop()
    finally:
        for failed in preflight.restore():
            print(failed, flush=True)
        link.close()


if __name__ == "__main__":
    follow_parent()
    fly(json.loads(sys.argv[1]), int(sys.argv[2]), Path(sys.argv[3]))
