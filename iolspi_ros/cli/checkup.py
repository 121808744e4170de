"""What may be wrong with a machine and its environment, and what to do about it."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from iolspi_ros import environment, leftovers, resources
from iolspi_ros.errors import InputError

PACKAGES = ("ros-rclpy", "ros-common-interfaces", "numpy", "scipy", "numba", "rosbags", "mcap")
_ROOM = 10**9
_HEAR = """
import sys, time, rclpy
from std_msgs.msg import String
rclpy.init(); node = rclpy.create_node(sys.argv[1]); heard = []
out = node.create_publisher(String, "iolspi_doctor", 10)
node.create_subscription(String, "iolspi_doctor", lambda m: heard.append(m.data), 10)
end = time.monotonic() + float(sys.argv[2])
while time.monotonic() < end and not (len(set(heard)) > 1):
    out.publish(String(data=sys.argv[1])); rclpy.spin_once(node, timeout_sec=0.05)
for _ in range(20):
    out.publish(String(data=sys.argv[1])); time.sleep(0.02)
sys.exit(len(set(heard)) < 2)
"""


class Finding(NamedTuple):
    """One thing that was looked at.

    Attributes
    ----------
    level : {"ok", "note", "bad"}
    what, found, cure : str
        `cure` is what to do; empty for nothing.
    """

    level: str
    what: str
    found: str
    cure: str = ""


def look(*, discovery: bool = True) -> Iterator[Finding]:
    """Look at everything; what fails to be looked at is a finding, too."""
    checks: list[Callable[[], Iterator[Finding]]] = [
        _python, _packages, _ros, _environment, _shared_memory, _clock, _threads, _disk,
    ]  # fmt: skip
    for check in [*checks, *([_discovery] if discovery else [])]:
        try:
            yield from check()
        except Exception as error:
            yield Finding("bad", check.__name__.strip("_"), f"could not be checked: {error!r}")


def _python() -> Iterator[Finding]:
    version = ".".join(map(str, sys.version_info[:3]))
    good = (3, 11) <= sys.version_info[:2] < (3, 14)
    cure = "" if good else "use Python 3.11, 3.12 or 3.13"
    yield Finding("ok" if good else "bad", "python", f"{version}, {sys.executable}", cure)


def _packages() -> Iterator[Finding]:
    found, lacking = [], []
    for name in PACKAGES:
        try:
            found.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            lacking.append(name)
    own = [name for name in lacking if not name.startswith("ros-")]
    yield Finding("ok" if not own else "bad", "packages", ", ".join(found),
                  f"install {', '.join(own)}" if own else "")  # fmt: skip


def _ros() -> Iterator[Finding]:
    spec = importlib.util.find_spec("rclpy")
    where = str(spec.origin) if spec is not None else "nowhere"
    own = where.startswith(sys.prefix)
    if not own and spec is not None and os.environ.get("PYTHONPATH"):
        yield Finding("note", "rclpy", f"{where} is not of this environment",
                      "a sourced ROS stands before it: unset PYTHONPATH?")  # fmt: skip
    try:
        import rclpy
        from rclpy.utilities import get_rmw_implementation_identifier as rmw
    except ImportError as error:
        yield Finding("bad", "rclpy", f"{where}: {error}", str(environment.no_ros(error) or ""))
        return
    yield Finding("ok", "rclpy", f"{Path(rclpy.__file__).parent}, {rmw()}")
    if os.environ.get("ROS_SECURITY_ENABLE") == "true" and own:
        yield Finding("bad", "SROS 2", "is asked for, and these wheels do not have it",
                      "use a ROS installation, or unset ROS_SECURITY_ENABLE")  # fmt: skip


def _environment() -> Iterator[Finding]:
    try:
        environment.check()
    except InputError as error:
        yield Finding("bad", "environment", str(error), "set it to what is allowed, or unset it")
    if not os.environ.get("HOME"):
        yield Finding("bad", "HOME", "is not set", "set it: ROS writes its logs there")
    chosen = os.environ.get(environment.RANGE, "not set")
    closed = chosen in ("LOCALHOST", "OFF")
    cure = "" if closed else "ros2 run is heard on the whole network then; docs/security.md"
    yield Finding("ok" if closed else "note", environment.RANGE, chosen, cure)
    domain = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", 7410 + 250 * domain))
            yield Finding("ok", "domain", f"{domain}, nobody is there")
        except (OSError, OverflowError):
            yield Finding("note", "domain", f"{domain}, somebody is there",
                          "set ROS_DOMAIN_ID to another; demo and fly find one")  # fmt: skip


def _shared_memory() -> Iterator[Finding]:
    place = leftovers.SHARED_MEMORY
    if not place.is_dir() or not os.access(place, os.W_OK):
        yield Finding("note", "shared memory", f"{place} cannot be used", "messages go by UDP")
        return
    gained, free = leftovers.sweep(), shutil.disk_usage(place).free
    files, size = leftovers.left()
    found = f"{free / 1e6:.0f} MB free, {files} files of Fast DDS with {size / 1e6:.1f} MB"
    if gained:
        found += f"; {gained / 1e6:.1f} MB of killed processes were removed"
    cure = "" if free > 64e6 else "give it more: docker run --shm-size=256m"
    yield Finding("bad" if cure else "ok", "shared memory", found, cure)


def _clock() -> Iterator[Finding]:
    late = []
    for _ in range(100):
        begin = time.monotonic()
        time.sleep(0.001)
        late.append(time.monotonic() - begin - 0.001)
    worst = 1e3 * sorted(late)[98]
    cure = "" if worst < 5.0 else "the machine is busy or shared: steps will be late"
    yield Finding("note" if cure else "ok", "clock",
                  f"1 ms of sleep is late by {worst:.2f} ms (p99)", cure)  # fmt: skip
    load, cores = os.getloadavg()[0], os.cpu_count() or 1
    cure = "" if load <= cores else "other programs take the cores"
    yield Finding("note" if cure else "ok", "load", f"{load:.1f} on {cores} cores", cure)


def _threads() -> Iterator[Finding]:
    names = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")
    many = [f"{name}={os.environ[name]}" for name in names if os.environ.get(name, "1") != "1"]
    cure = "unset them: one thread is faster here, and gives the same bits everywhere"
    yield Finding("note" if many else "ok", "BLAS threads", ", ".join(many) or "1",
                  cure if many else "")  # fmt: skip


def _disk() -> Iterator[Finding]:
    from iolspi_ros.folders import state_folder

    for what, place in (("here", Path.cwd()), ("cache", resources.cache_folder()),
                        ("state", state_folder())):  # fmt: skip
        there = place
        while not there.exists():
            there = there.parent
        free = shutil.disk_usage(there).free
        writable = os.access(there, os.W_OK)
        cure = "" if writable else f"let this user write to {there}"
        if writable and free < _ROOM:
            cure = "make room: bags and checkpoints go there"
        found = f"{place}, {free / 1e9:.1f} GB free{'' if writable else ', not writable'}"
        yield Finding("bad" if not writable else "note" if cure else "ok", f"disk, {what}", found,
                      cure)  # fmt: skip


def _discovery() -> Iterator[Finding]:
    """Two processes on this machine must hear each other."""
    begin = time.monotonic()
    both = [
        subprocess.Popen([sys.executable, "-c", _HEAR, f"iolspi_doctor_{name}", "10"],
                         stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                         env=os.environ | {environment.RANGE: "LOCALHOST"})
        for name in "ab"
    ]  # fmt: skip
    heard = all(process.wait(30.0) == 0 for process in both)
    took = time.monotonic() - begin
    cure = "" if heard else "look for a firewall on localhost, a full /dev/shm, another RMW"
    found = f"two processes heard each other after {took:.1f} s" if heard else "they do not"
    yield Finding("ok" if heard else "bad", "discovery", found, cure)
