"""End flights of an autopilot's simulator in every way, and compare all its parameters each time.

    .venv/bin/python benchmarks/ends.py udpin:127.0.0.1:14540 px4 --start "./my_px4.sh" \
        --checkpoint practised.npz --it-is-a-simulator

`--start` is a command that runs the simulator in the foreground; it is ended and started again for
some of the ends. What is left in the air lands, as a person would have it, then `iolspi fly
--restore` is called. The parameters are read by pymavlink alone. Exit status 1: some were changed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import psutil
from pymavlink import mavutil

from msg_bridge.mavlink import profiles

FLY = [sys.executable, "-m", "iolspi_ros", "fly"]
OWN = ("STAT_", "MOT_THST_HOVER", "BARO1_GND_PRESS", "BARO2_GND_PRESS", "COMPASS_DEC",
       "LND_FLIGHT_T_", "COM_FLIGHT_UUID")  # fmt: skip
"""Beginnings of the names of parameters that an autopilot counts or learns in flight."""
PREFLIGHT, AIR = "Preflight:", "learning online"


class Simulator:
    """An autopilot's simulator: a process group, with its words in a file."""

    def __init__(self, command: str, log: Path) -> None:
        self._command, self._log, self._process = shlex.split(command), log, None

    def start(self) -> None:
        """Run it, with its folder as it was left, where it does not run."""
        if self._process is not None and self._process.poll() is None:
            return
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                start_new_session=True,
            )  # fmt: skip

    def end(self) -> None:
        """Kill it, as a power cut does."""
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()


@contextlib.contextmanager
def met(url: str, profile: profiles.AutopilotProfile) -> Iterator[mavutil.mavfile]:
    """A connection of pymavlink's own, once the autopilot is heard."""
    end = time.monotonic() + 90.0
    while True:  # a bridge whose command was killed is still landing, and has the port
        try:
            link = mavutil.mavlink_connection(url, source_system=254, autoreconnect=True)
            break
        except OSError:
            if time.monotonic() > end:
                raise
            time.sleep(1.0)
    try:
        end = time.monotonic() + 90.0
        while time.monotonic() < end:
            heard = link.recv_match(type="HEARTBEAT", blocking=True, timeout=1.0)
            if heard is not None and heard.autopilot == profile.autopilot:
                yield link
                return
        raise SystemExit(f"nothing is heard of {profile.name} at {url}")
    finally:
        link.close()


def parameters(link: mavutil.mavfile) -> dict[str, float]:
    """All of them, but for those that the autopilot changes by itself."""
    found: dict[int, tuple[str, float]] = {}
    count, asked = None, 0.0
    end = time.monotonic() + 120.0
    while time.monotonic() < end and (count is None or len(found) < count):
        if time.monotonic() - asked > 5.0:
            asked = time.monotonic()
            if count is None or count - len(found) > 50:
                link.param_fetch_all()
            else:
                for index in set(range(count)) - set(found):
                    link.mav.param_request_read_send(
                        link.target_system, link.target_component, b"", index
                    )
        said = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0)
        if said is not None and said.param_index < 65535:
            count = said.param_count
            found[said.param_index] = said.param_id, said.param_value
            asked = time.monotonic()
    if count is None or len(found) < count:
        raise SystemExit(f"{len(found)} of {count} parameters were heard")
    return {name: value for name, value in found.values() if not name.startswith(OWN)}


def landed(link: mavutil.mavfile, profile: profiles.AutopilotProfile) -> None:
    """Wait until it is disarmed; what still flies is told to land now and then."""
    told, end = 0.0, time.monotonic() + 180.0
    while time.monotonic() < end:
        said = link.recv_match(type="HEARTBEAT", blocking=True, timeout=2.0)
        if said is None or said.autopilot != profile.autopilot:
            continue
        if not said.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED:
            return
        if said.custom_mode != profile.landing and time.monotonic() - told > 3.0:
            told = time.monotonic()
            link.mav.command_long_send(
                link.target_system, link.target_component,
                mavutil.mavlink.MAV_CMD_DO_SET_MODE, 0,
                mavutil.mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
                *profile.mode_halves(profile.landing), 0, 0, 0, 0,
            )  # fmt: skip
    raise SystemExit("it does not land")


# ---------------------------------------------------------------- ends


class Run(NamedTuple):
    """One `iolspi fly` that is to end."""

    process: subprocess.Popen[bytes]
    log: Path
    moment: float
    simulator: Simulator

    def wait_for(self, words: str) -> None:
        """Until some time after it has printed something, or until it has ended."""
        end = time.monotonic() + 240.0
        while time.monotonic() < end and self.process.poll() is None:
            if words in self.log.read_text():
                break
            time.sleep(0.02)
        time.sleep(self.moment)


def by_itself(run: Run) -> None:
    """As it comes."""


def signalled(number: int, words: str) -> Callable[[Run], None]:
    """By a signal to the command, some time after words of it."""

    def end(run: Run) -> None:
        run.wait_for(words)
        run.process.send_signal(number)

    return end


def killed(*names: str) -> Callable[[Run], None]:
    """Some nodes by SIGKILL in flight; without names the command and all of them at once."""

    def end(run: Run) -> None:
        run.wait_for(AIR)
        command = psutil.Process(run.process.pid)
        everybody = [command, *command.children(recursive=True)]
        for one in everybody:
            with contextlib.suppress(psutil.Error):
                words = " ".join(one.cmdline())
                if not names or any(f"nodes.start {name}" in words for name in names):
                    one.kill()

    return end


def cut_power(run: Run) -> None:
    """The autopilot's."""
    run.wait_for(AIR)
    run.simulator.end()


ENDS = {
    "as planned": by_itself,
    "refused: no load is reported": by_itself,
    "refused: another speed": by_itself,
    "SIGINT in the preflight": signalled(signal.SIGINT, PREFLIGHT),
    "SIGKILL in the preflight": signalled(signal.SIGKILL, PREFLIGHT),
    "SIGINT in flight": signalled(signal.SIGINT, AIR),
    "SIGTERM in flight": signalled(signal.SIGTERM, AIR),
    "SIGHUP in flight": signalled(signal.SIGHUP, AIR),
    "SIGKILL of the command in flight": signalled(signal.SIGKILL, AIR),
    "SIGKILL of the bridge in flight": killed("bridge"),
    "SIGKILL of the learner in flight": killed("learner"),
    "SIGKILL of everything in flight": killed(),
    "the autopilot ends in flight": cut_power,
}
OPTIONS = {
    "refused: no load is reported": {"--load": "feed"},
    "refused: another speed": {"--speed-up": "7"},
}


def fly(
    name: str, chosen: argparse.Namespace, simulator: Simulator, folder: Path, moment: float
) -> int:
    """One flight that ends so; its exit status."""
    options = {
        "--autopilot": chosen.autopilot, "--url": chosen.url, "--load": "estimate",
        "--speed-up": str(chosen.speed_up), "--checkpoint": str(chosen.checkpoint.resolve()),
        "--practice": "0", "--episodes": "2", "--shown": "1", "--out": str(folder),
    } | OPTIONS.get(name, {})  # fmt: skip
    log = folder.with_suffix(".log")
    with log.open("wb") as words:
        process = subprocess.Popen(
            FLY + [part for pair in options.items() for part in pair], stdout=words, stderr=words,
            start_new_session=True,
        )  # fmt: skip
    try:
        ENDS[name](Run(process, log, moment, simulator))
        return process.wait(600.0)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def restore(url: str) -> int:
    """What a person says then; its exit status, 1 while any vehicle is still remembered."""
    command = [*FLY, "--restore", "--url", url]
    return subprocess.run(command, capture_output=True, check=False).returncode


def main() -> int:
    """Ends of every kind, in turn, and what was left changed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("url")
    parser.add_argument("autopilot", choices=("px4", "ardupilot"))
    parser.add_argument("--start", required=True, help="Command that runs the simulator.")
    parser.add_argument("--checkpoint", type=Path, required=True, help="What is flown.")
    parser.add_argument("--speed-up", type=float, default=1.0)
    parser.add_argument("--ends", type=int, default=2 * len(ENDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/ends"), help="A new folder.")
    parser.add_argument("--it-is-a-simulator", action="store_true")
    chosen = parser.parse_args()
    if not chosen.it_is_a_simulator:
        parser.error("it arms, flies and ends what is there: --it-is-a-simulator says it may")
    if chosen.out.exists():
        parser.error(f"--out {chosen.out} is there; allowed: a folder that is not there yet")
    chosen.out.mkdir(parents=True)
    profile, rng = profiles.PROFILES[chosen.autopilot], random.Random(chosen.seed)
    simulator = Simulator(chosen.start, chosen.out / "simulator.log")
    simulator.start()
    bad, rows = 0, []
    try:
        restore(chosen.url)  # what an earlier run may have left
        with met(chosen.url, profile) as link:
            before = parameters(link)
        print(f"{len(before)} parameters are compared", flush=True)
        for number in range(chosen.ends):
            name = list(ENDS)[number % len(ENDS)]
            status = fly(name, chosen, simulator, chosen.out / f"{number}", rng.uniform(0.0, 8.0))
            simulator.start()
            with met(chosen.url, profile) as link:
                landed(link, profile)
                left = _differing(before, parameters(link))
            restored = restore(chosen.url)
            with met(chosen.url, profile) as link:
                after = _differing(before, parameters(link))
            bad += bool(after)
            rows.append({"end": name, "status": status, "before_restore": left, "after": after,
                         "restore": restored})  # fmt: skip
            (chosen.out / "ends.json").write_text(json.dumps(rows, indent=1) + "\n")
            print(f"{number:3} {name} (status {status}): changed {left or 'nothing'}, "
                  f"after --restore {after or 'nothing'}", flush=True)  # fmt: skip
    finally:
        simulator.end()
    print(f"{chosen.ends} ends, {bad} left something changed")
    return int(bad > 0)


def _differing(before: dict[str, float], after: dict[str, float]) -> dict[str, list[str]]:
    """Names, and both values; values are compared by their bits, as integers may travel so."""
    names = sorted(before.keys() | after.keys())
    found = {name: [repr(before.get(name)), repr(after.get(name))] for name in names}
    return {name: pair for name, pair in found.items() if pair[0] != pair[1]}


if __name__ == "__main__":
    sys.exit(main())
