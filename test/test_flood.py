"""Whoever floods the bridge's port, its setpoints go out: real sockets, counted by ratio."""

import socket
import threading
import time
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink.clock import VehicleClock
from msg_bridge.mavlink.codec import Codec
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.runner import Runner
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url

KEY = bytes(range(32))
UNIT = b"\xfd" + bytes(11)  # the least that looks like a packet, and costs most for its size
HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)


def udp():
    end = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    end.bind(("127.0.0.1", 0))
    return end


def setpoints(seconds, junk, size, rate, own_address):
    """Setpoints sent while somebody sends junk so often; and what the link has counted."""
    with udp() as free:
        port = free.getsockname()[1]
    link = AutopilotLink(open_url(f"udpin:127.0.0.1:{port}"), Telemetry(1, 2), KEY)
    with udp() as vehicle, udp() as stranger:
        vehicle.sendto(Codec(1, 1, KEY).pack(HEARTBEAT), ("127.0.0.1", port))
        link.wait(5.0)
        link.poll(0.0)
        sent = []
        flight = SimpleNamespace(
            link=link,
            rate=50.0,
            listen=link.poll,
            tick=lambda now: sent.append(link.send(HEARTBEAT)),
        )
        runner = Runner(flight, VehicleClock(1.0), lambda *said: pytest.fail(str(said)))
        over = threading.Event()

        def flood():
            data = (UNIT * (size // len(UNIT) + 1))[:size]
            end = vehicle if own_address else stranger
            while not over.wait(1.0 / rate):
                end.sendto(data, ("127.0.0.1", port))

        thread = threading.Thread(target=flood, daemon=True)
        if junk:
            thread.start()
        runner.start()
        time.sleep(seconds)
        runner.stop()
        over.set()
        if junk:
            thread.join()
    link.close()
    assert all(sent)
    return len(sent), link


@pytest.mark.parametrize(
    ("size", "rate", "own_address"),
    [(65_000, 40, False), (65_000, 40, True), (4_000, 900, False), (4_000, 900, True)],
)
def test_a_flood_does_not_silence_the_setpoints(size, rate, own_address):
    """Of datagrams too large, and of as many that are not: from a stranger, or as the vehicle."""
    quiet, _ = setpoints(0.8, False, size, rate, own_address)
    flooded, link = setpoints(0.8, True, size, rate, own_address)
    assert link._transport.dropped + link.codec.rejected + link.unread > 10
    assert flooded > 0.6 * quiet
