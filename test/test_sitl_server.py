"""The embedded autopilot on sockets: the command, its clock, and where its bytes go."""

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from iolspi_ros import cli
from iolspi_ros.errors import InputError
from sim_nodes.autopilot.server import Sitl


class Ground:
    """A ground station on a UDP socket."""

    def __init__(self, port=0):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.settimeout(0.05)
        self.port = self.socket.getsockname()[1]
        self.peer = None
        self.mav = mavlink.MAVLink(None, 255, 190)
        self.mav.robust_parsing = True

    def wait(self, wanted, deadline=60.0):
        """The first message for which `wanted` holds."""
        end = time.monotonic() + deadline
        while time.monotonic() < end:
            try:
                data, self.peer = self.socket.recvfrom(65536)
            except TimeoutError:
                continue
            for message in self.mav.parse_buffer(data) or ():
                if wanted(message):
                    return message
        raise AssertionError("it never came")

    def next(self, kind, **limits):
        return self.wait(lambda m: m.get_type() == kind, **limits)

    def send(self, message):
        self.socket.sendto(message.pack(self.mav), self.peer)

    def set(self, name, value):
        self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 9))

    def drain(self):
        """Forget what has come: a full buffer loses what comes next."""
        with contextlib.suppress(TimeoutError):
            while True:
                self.socket.recvfrom(65536)


@pytest.fixture
def ground():
    station = Ground()
    yield station
    station.socket.close()


def elapsed(ground, duration):
    """Vehicle time that passes in some time of the machine, over it."""
    start = ground.next("SYSTEM_TIME").time_boot_ms
    began = time.monotonic()
    while time.monotonic() - began < duration:
        latest = ground.next("SYSTEM_TIME").time_boot_ms
    return (latest - start) / 1e3 / (time.monotonic() - began)


def test_it_runs_faster_and_stands_still(ground):
    with Sitl("px4", [f"udpout:127.0.0.1:{ground.port}"], {"SIM_SPEEDUP": 10.0}):
        assert elapsed(ground, 1.0) > 4.0  # 10, were the machine all ours
        ground.set("SIM_SPEEDUP", 0.0)
        ground.drain()
        ground.set("SIM_SPEEDUP", 0.0)
        stood = ground.wait(lambda m: m.get_type() == "PARAM_VALUE")
        assert stood.param_value == 0.0
        # It stands still but answers: two clocks asked for one after the other say the same.
        clocks = []
        for asked in (1, 2):
            ground.send(mavlink.MAVLink_timesync_message(0, asked))
            answer = ground.wait(lambda m, a=asked: m.get_type() == "TIMESYNC" and m.ts1 == a)
            clocks.append(answer.tc1)
        assert clocks[0] == clocks[1]
        ground.set("SIM_SPEEDUP", 1.0)
        ground.next("HEARTBEAT")


def test_two_peers_and_nobody_else(ground):
    other = Ground()
    urls = [f"udpout:127.0.0.1:{ground.port}", "udpin:127.0.0.1:0"]
    with Sitl("ardupilot", urls) as sitl:
        ground.next("HEARTBEAT")
        other.peer = sitl.addresses[1]
        other.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        other.next("HEARTBEAT")
        assert {host for host, _ in sitl.addresses} == {"127.0.0.1"}
    other.socket.close()


@pytest.mark.parametrize(
    "url", ["tcp:127.0.0.1:1", "udpout:127.0.0.1", "udpin::1", "udpin:1.2.3.4:9"]
)
def test_bad_addresses(url):
    with pytest.raises(InputError, match="allowed"):
        Sitl("px4", [url])


@pytest.fixture
def command(ground):
    started = []

    def start(*arguments, port=ground.port):
        process = subprocess.Popen(
            [sys.executable, "-m", "iolspi_ros", "sitl", "--url", f"udpout:127.0.0.1:{port}",
             *map(str, arguments)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_command(ground, command, number):
    process = command("--like", "px4", "--speed-up", 5, "--ready-after", 1)
    assert ground.next("HEARTBEAT").autopilot == 12
    assert re.match(rf"px4: udpout:127.0.0.1:{ground.port}", process.stdout.readline())
    process.send_signal(number)
    _, said = process.communicate(timeout=60.0)
    assert process.returncode == 0, said


def test_the_command_aborts_on_an_acceleration_of_nan(ground, command):
    process = command("--like", "ardupilot", "--ready-after", 0)
    ground.next("HEARTBEAT")
    ground.send(mavlink.MAVLink_set_position_target_local_ned_message(
        0, 1, 1, 1, 0x0C3F, *[0.0] * 6, float("nan"), *[0.0] * 4))  # fmt: skip
    said, _ = process.communicate(timeout=60.0)
    assert process.returncode == 3
    assert "aborted" in said


def test_signed(ground, command, tmp_path):
    key = tmp_path / "key"
    key.write_text("5a" * 32)
    command("--like", "ardupilot", "--signing", key)
    ground.mav.signing.allow_unsigned_callback = lambda *_: False
    ground.mav.signing.secret_key = b"\x5a" * 32
    assert ground.next("HEARTBEAT").get_signed()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--like", "apm"], "px4, ardupilot"),
        (["--param", "SIM_LOSS"], "NAME=NUMBER"),
        (["--param", "SIM_LOSS=3"], "0.0 to 1.0"),
        (["--signing", "/no/such/key"], "--signing"),
    ],
)
def test_bad_input_ends_with_status_2(capsys, monkeypatch, arguments, said):
    monkeypatch.setattr(sys, "argv", ["iolspi", "sitl", *arguments])
    assert cli.main() == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error
