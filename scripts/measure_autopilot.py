#!/usr/bin/env python3
"""Fly an autopilot's simulator and say how far it is from what the embedded one imitates.

IT ARMS AND FLIES what it finds there: up to 15 m high and some 40 m to the east, with setpoints
that stop in flight. Nothing but a simulator may be at the address, one that was just started.

    python scripts/measure_autopilot.py tcp:127.0.0.1:5760 --it-is-a-simulator
    python scripts/measure_autopilot.py udpin:127.0.0.1:14540 --it-is-a-simulator

It prints the differences, and leaves measured.json, measured.md and flight.tlog in --out. Send
them in with the version of your autopilot. Exit status: 0 when all rows agree, 1 when one differs,
2 for bad input.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from pathlib import Path


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("url", nargs="?", default="udpin:127.0.0.1:14540")
    parser.add_argument("--it-is-a-simulator", action="store_true")
    parser.add_argument("--system", type=int, default=1)
    parser.add_argument("--speed-up", type=float, default=1.0)
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--out", type=Path, default=Path("out/measured"))
    chosen = parser.parse_args()
    if not chosen.it_is_a_simulator:
        parser.error("it arms and flies what is there: --it-is-a-simulator says that it may")
    return chosen


def main() -> int:
    """Measure, compare, write down."""
    from iolspi_ros.bench import measuring
    from iolspi_ros.bench.stand import Stand
    from iolspi_ros.errors import InputError
    from msg_bridge.mavlink.clock import VehicleClock
    from msg_bridge.mavlink.transport import open_url
    from sim_nodes.autopilot.figures import FIGURES

    chosen = arguments()
    chosen.out.mkdir(parents=True, exist_ok=True)
    clock = VehicleClock(chosen.speed_up)

    def tell(what: str) -> None:
        print(f"{clock.now():6.1f} s  {what}", flush=True)

    try:
        transport = open_url(chosen.url)
        stand = Stand(transport, clock, chosen.system, log=chosen.out / "flight.tlog")
        with contextlib.closing(stand.link):
            found = measuring.measure(stand, tell, chosen.repeat)
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    lines = measuring.compare(found, FIGURES[stand.profile.name])
    table = measuring.markdown(lines)
    print(table)
    (chosen.out / "measured.md").write_text(table)
    (chosen.out / "measured.json").write_text(json.dumps(
        {"autopilot": stand.profile.name, "url": chosen.url, "speed_up": chosen.speed_up,
         "samples": found}, indent=1) + "\n")  # fmt: skip
    return 1 if any(line.holds is False for line in lines) else 0


if __name__ == "__main__":
    sys.exit(main())
