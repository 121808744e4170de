"""How well an estimated swing is known: the embedded autopilot flown, beside its truth.

    .venv/bin/python scripts/measure_swing.py [--seeds 3] [--episodes 12] [CASE ...]

Each case is flown with what the accelerometer feels and without; with --careless the load is let
go anywhere near the basket, to see whether the chances that are told are right. Swings are compared
in episodes, while the load hangs; landings with the parabola from the truth when it leaves the
cable. A table, and every release on a line of a JSON file (--out).
"""

from __future__ import annotations

import argparse
import json
import math
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.bench.flying import Act, Flying, pilot
from iolspi_ros.core.samples import Observation
from msg_bridge.mavlink.phases import Phase
from sim_nodes.quadrotor.airframe import UTILITY
from sim_nodes.quadrotor.body import CABLE, LOAD, LOAD_VELOCITY, POSITION, VELOCITY
from sim_nodes.quadrotor.cable import GONE
from sim_nodes.tasks.slung_load import RELEASE, SlungLoad
from sim_nodes.tasks.slung_load.dynamics import landing

Array = NDArray[np.float64]

_CARELESS = 0.06  # of the moments near the basket

MASS = 0.3
"""Of the load, unless the case has another [kg]: a fifth of the vehicle's."""


class Case(NamedTuple):
    """What is flown.

    Attributes
    ----------
    like : str
    world : dict
        Parameters of the autopilot that differ.
    wrong : float
        By how much the bridge's idea of the load's mass is wrong, times the true one.
    kick : float
        Swing rate that the load gets across and along before each episode [1/s].
    """

    like: str
    world: dict[str, float]
    wrong: float = 1.0
    kick: float = 0.0

    @property
    def sensor(self) -> bool:
        """Whether it is another case only for who listens to the accelerometer."""
        return self.wrong != 1.0 or set(self.world) in ({"SIM_ACC_NOISE"}, {"SIM_ACC_BIAS"})


def careless(rng: np.random.Generator) -> Act:
    """Who brings the load in, and now and then lets it go wherever it is not far away."""
    performs = pilot(SlungLoad())

    def act(seen: Observation) -> int | None:
        near = abs(float(seen.state[0])) < 3.5
        return RELEASE if near and rng.random() < _CARELESS else performs(seen)

    return act


CLEAN = {"SIM_WANDER": 0.0, "SIM_ACC_NOISE": 0.0}
CASES = {
    "ardupilot, clean": Case("ardupilot", CLEAN),
    "ardupilot": Case("ardupilot", {}),
    "ardupilot, light load": Case("ardupilot", {"SIM_LOAD_MASS": 0.1}),
    "ardupilot, noise of 1 m/s²": Case("ardupilot", {"SIM_ACC_NOISE": 1.0}),
    "ardupilot, offset of 0.2 m/s²": Case("ardupilot", {"SIM_ACC_BIAS": 0.2}),
    "ardupilot, drag of 0.5 /s": Case("ardupilot", {"SIM_DRAG": 0.5}),
    "ardupilot, 50 ms late": Case("ardupilot", {"SIM_DELAY": 0.05}),
    "ardupilot, mass 30 % too high": Case("ardupilot", {}, 1.3),
    "ardupilot, mass 30 % too low": Case("ardupilot", {}, 0.7),
    "ardupilot, kicked": Case("ardupilot", {}, kick=1.5),
    "ardupilot, wind 3 m/s, gusts 1": Case(
        "ardupilot", {"SIM_WIND_SPD": 3.0, "SIM_WIND_TURB": 1.0}
    ),
    "px4, clean": Case("px4", CLEAN),
    "px4": Case("px4", {}),
    "px4, light load": Case("px4", {"SIM_LOAD_MASS": 0.1}),
    "px4, noise of 1 m/s²": Case("px4", {"SIM_ACC_NOISE": 1.0}),
    "px4, 50 ms late": Case("px4", {"SIM_DELAY": 0.05}),
    "px4, mass 30 % too high": Case("px4", {}, 1.3),
    "px4, mass 30 % too low": Case("px4", {}, 0.7),
    "px4, kicked": Case("px4", {}, kick=1.5),
    "px4, wind 1 m/s, gusts 0.3": Case("px4", {"SIM_WIND_SPD": 1.0, "SIM_WIND_TURB": 0.3}),
}


class Watched:
    """What was seen in one flight."""

    def __init__(self) -> None:
        self.swings: list[Array] = []
        self.honest: list[float] = []
        self.releases: list[dict[str, Any]] = []


def fly(case: Case, felt: bool, seed: int, episodes: int, drops: bool = False) -> Watched:
    """One flight; it ends early when it cannot go on."""
    world = {"SIM_LOAD_RATE": 0.0, "SIM_LOAD_MASS": MASS} | case.world
    share = case.wrong * world["SIM_LOAD_MASS"] / UTILITY.mass if felt else 0.0
    watched = Watched()
    with tempfile.TemporaryDirectory() as folder:
        flying = Flying(
            Path(folder), case.like, autopilot=world, seed=seed, load_source="estimate",
            load_share=share, act=careless(np.random.default_rng(seed)) if drops else None,
        )  # fmt: skip
        with flying as f:
            _follow(f, case, episodes, watched)
    return watched


def _follow(f: Flying, case: Case, episodes: int, watched: Watched) -> None:
    rng = np.random.default_rng(0)
    body, machine, end = f.autopilot.body, f.flight._machine, f.clock.now() + 60.0 * episodes
    hung, phase, pending = True, Phase.IDLE, None
    while len(f.ends) < episodes and f.clock.now() < end and f.flight.in_flight:
        f.world.wait()
        craft, now = body.craft, machine.phase
        if now is Phase.EPISODE and phase is Phase.TRANSIT and case.kick:
            craft[LOAD_VELOCITY] += case.kick * rng.standard_normal(3) * (1.0, 1.0, 0.0)
        if now is Phase.RELEASE and phase is Phase.EPISODE:
            pending = _told(f)
        phase = now
        if hung and craft[CABLE] == GONE and pending is not None:
            watched.releases.append(pending | _true(f))
            pending = None
        hung = bool(craft[CABLE] != GONE)
        if hung and now is Phase.EPISODE:
            _compare(f, watched)


def _compare(f: Flying, watched: Watched) -> None:
    """The swing as it is thought to be, and as it is; in the frame of the task."""
    craft, load = f.autopilot.body.craft, f.flight._estimator.load
    there = craft[LOAD] - craft[POSITION]
    size = float(np.linalg.norm(there))
    cable, rate = there / size, (craft[LOAD_VELOCITY] - craft[VELOCITY]) / size
    rate = rate - cable * float(rate @ cable)
    seen = f.flight.motion
    off = np.array([*(np.array(seen.cable) - cable)[:2], *(np.array(seen.cable_rate) - rate)[:2]])
    watched.swings.append(off)
    spread = load.covariance[:6, :6][np.ix_([0, 1, 3, 4], [0, 1, 3, 4])]
    watched.honest.append(float(off @ np.linalg.solve(spread + 1e-9 * np.eye(4), off)) / 4.0)


def _told(f: Flying) -> dict[str, Any]:
    """Where the load is thought to come down as it is let go, and its chance to be inside."""
    flight = f.flight
    return {"told": landing(np.array(flight.motion.plane(0))), "chance": flight._chances[-1]}


def _true(f: Flying) -> dict[str, Any]:
    """Where it does, from the truth in which it left the cable."""
    craft = f.autopilot.body.craft
    x, speed = craft[POSITION][0], craft[VELOCITY][0]
    load, fast = craft[LOAD] - craft[POSITION], craft[LOAD_VELOCITY] - craft[VELOCITY]
    angle = math.atan2(load[0], -load[2])
    turning = (fast[0] * math.cos(angle) + fast[2] * math.sin(angle)) / math.hypot(load[0], load[2])
    place = landing(np.array([x, speed, angle, turning]))
    dunk = SlungLoad().landed(place) > 0.0
    return {"true": place, "dunk": dunk}


def row(name: str, felt: bool, flights: list[Watched]) -> str:
    """A line of the table."""
    off = np.concatenate([np.array(one.swings).reshape(-1, 4) for one in flights])
    honest = np.concatenate([np.array(one.honest) for one in flights])
    size = np.sqrt((off**2).mean(axis=0))
    releases = [release for one in flights for release in one.releases]
    places = [(r["told"], r["true"]) for r in releases if None not in (r["told"], r["true"])]
    away = math.sqrt(np.mean([(told - true) ** 2 for told, true in places] or [math.nan]))
    dunks, expected = sum(r["dunk"] for r in releases), sum(r["chance"] for r in releases)
    return (
        f"| {name} | {'yes' if felt else 'no'} | {size[0]:.3f}, {size[1]:.3f} | {size[2]:.2f}, "
        f"{size[3]:.2f} | {away:.2f} | {honest.mean():.1f} | {dunks} of {len(releases)} | "
        f"{expected:.1f} |"
    )


def main() -> int:
    """Fly all that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", default=list(CASES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=12)
    parser.add_argument("--careless", action="store_true", help="let go anywhere near the basket")
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args()
    print("| case | felt | swing [rad] | rate [rad/s] | landing [m] | NEES | dunks | expected |")
    for name in chosen.cases:
        for felt in (True,) if CASES[name].sensor else (False, True):
            seeds = range(chosen.first, chosen.first + chosen.seeds)
            flights = [
                fly(CASES[name], felt, seed, chosen.episodes, chosen.careless) for seed in seeds
            ]
            print(row(name, felt, flights), flush=True)
            if chosen.out:
                with chosen.out.open("a") as file:
                    for one in flights:
                        for release in one.releases:
                            file.write(json.dumps({"case": name, "felt": felt} | release) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
