"""Transports, packets and signatures of the bridge."""

import contextlib
import math
import os
import pty
import socket
import struct
import tty

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.codec import Codec, read_key
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.telemetry import Telemetry
from msg_bridge.mavlink.transport import open_url

KEY, OTHER = bytes(range(32)), bytes(reversed(range(32)))
HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)


def kinds(messages):
    return [message.get_type() for message in messages]


def peer(family=socket.SOCK_DGRAM, host="127.0.0.1"):
    end = socket.socket(socket.AF_INET, family)
    end.bind((host, 0))
    end.settimeout(5.0)
    return end


def until(transport, times=200):
    for _ in range(times):
        transport.wait(0.02)
        if data := transport.read():
            return data
    raise AssertionError("nothing came")


@pytest.mark.parametrize(
    "url",
    ["", "udp", "udpin:127.0.0.1", "http://here:1", "udpin:0.0.0.0:14550", "tcp:127.0.0.1:70000",
     "serial:/dev/nothing:57600", "udpin:127.0.0.1:0"],
)  # fmt: skip
def test_an_address_that_is_none_is_refused_with_what_is_allowed(url):
    with pytest.raises(InputError, match=r"allowed|No such file"):
        open_url(url)


def test_calling_only_the_one_who_is_called_is_heard():
    end, stranger = peer(), peer()
    transport = open_url(f"udpout:127.0.0.1:{end.getsockname()[1]}")
    assert transport.write(b"hello")
    data, ours = end.recvfrom(100)
    assert data == b"hello"
    stranger.sendto(b"lie", ours)
    end.sendto(b"truth", ours)
    assert until(transport) == b"truth"
    transport.close()


def test_listening_nothing_is_sent_until_the_autopilot_was_heard():
    """And then only to it, or to where the same host speaks as it again."""
    free = peer()
    port = free.getsockname()[1]
    free.close()
    transport = open_url(f"udpin:127.0.0.1:{port}")
    link = AutopilotLink(transport, Telemetry(1, 2))
    autopilot, stranger, elsewhere = peer(), peer(), peer(host="127.0.0.2")
    link.poll(0.0)
    stranger.sendto(Codec(9, 1).pack(HEARTBEAT), ("127.0.0.1", port))
    transport.wait(1.0)
    link.poll(1.0)
    assert link.sent == 0
    autopilot.sendto(Codec(1, 1).pack(HEARTBEAT), ("127.0.0.1", port))
    transport.wait(1.0)
    link.poll(2.0)
    assert link.sent > 0
    assert "HEARTBEAT" in kinds(Codec(1, 1).read(autopilot.recv(300)))
    elsewhere.sendto(Codec(1, 1).pack(HEARTBEAT), ("127.0.0.1", port))
    transport.wait(0.2)
    assert transport.read() == b""  # another host claims to be it
    link.poll(4.0)
    for end in (stranger, elsewhere):
        end.settimeout(0.05)
        with pytest.raises(TimeoutError):
            end.recv(300)
    link.close()


def test_tcp_comes_back_after_it_broke():
    server = peer(socket.SOCK_STREAM)
    port = server.getsockname()[1]
    transport = open_url(f"tcp:127.0.0.1:{port}")
    transport.wait(0.05)
    assert not transport.write(b"x")  # refused: nobody listens yet
    server.listen()
    for _ in range(2):
        transport.wait(0.2)
        transport.wait(0.2)
        assert transport.write(b"hello")
        end, _ = server.accept()
        end.settimeout(5.0)
        assert end.recv(10) == b"hello"
        end.sendall(b"back")
        assert until(transport) == b"back"
        end.close()
        for _ in range(50):
            transport.wait(0.02)
            transport.read()
            if not transport.write(b""):
                break
    transport.close()
    server.close()


def test_a_serial_line():
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    transport = open_url(f"serial:{os.ttyname(theirs)}:57600")
    assert transport.write(b"hello")
    assert os.read(ours, 10) == b"hello"
    os.write(ours, b"back")
    assert until(transport) == b"back"
    transport.close()
    os.close(ours)
    with contextlib.suppress(OSError):
        os.close(theirs)


def test_packets_there_and_back_in_pieces():
    """A stream may cut a packet anywhere."""
    data = Codec(1, 1).pack(HEARTBEAT) + Codec(1, 1).pack(
        dialect.MAVLink_statustext_message(6, b"x")
    )
    codec = Codec(255, 190)
    found = [m for byte in data for m in codec.read(bytes([byte]))]
    assert kinds(found) == ["HEARTBEAT", "STATUSTEXT"]
    assert codec.rejected == 0


def test_half_a_datagram_does_not_swallow_the_next():
    codec, packet = Codec(255, 190), Codec(1, 1).pack(HEARTBEAT)
    assert not kinds(codec.read(packet[:15], whole=True))
    assert kinds(codec.read(packet, whole=True)) == ["HEARTBEAT"]


@pytest.mark.parametrize(("key", "good"), [(KEY, True), (OTHER, False), (None, False)])
def test_with_a_key_only_what_is_signed_with_it_is_taken(key, good):
    codec = Codec(255, 190, KEY)
    assert bool(kinds(codec.read(Codec(1, 1, key).pack(HEARTBEAT)))) is good
    assert codec.rejected == (not good)


def test_a_packet_that_was_recorded_is_not_taken_again():
    codec, packet = Codec(255, 190, KEY), Codec(1, 1, KEY).pack(HEARTBEAT)
    assert kinds(codec.read(packet)) == ["HEARTBEAT"]
    assert not kinds(codec.read(packet))


def test_a_forged_time_stamp_locks_nobody_out():
    codec, honest = Codec(255, 190, KEY), Codec(1, 1, KEY)
    assert kinds(codec.read(honest.pack(HEARTBEAT))) == ["HEARTBEAT"]
    liar = Codec(1, 1, OTHER)
    liar._parser.signing.timestamp += 10**9
    assert not kinds(codec.read(liar.pack(HEARTBEAT)))
    assert kinds(codec.read(honest.pack(HEARTBEAT))) == ["HEARTBEAT"]


def test_keys_are_bytes_or_their_digits(tmp_path):
    for content in (KEY, KEY.hex().encode(), KEY.hex().encode() + b"\n"):
        (tmp_path / "key").write_bytes(content)
        assert read_key(tmp_path / "key") == KEY
    for content in (b"", b"short", KEY + b"x", b"g" * 64):
        (tmp_path / "key").write_bytes(content)
        with pytest.raises(InputError, match="64 hexadecimal digits or 32 bytes"):
            read_key(tmp_path / "key")
    with pytest.raises(InputError, match="No such file"):
        read_key(tmp_path / "none")


def test_all_that_is_said_is_in_the_log(tmp_path):
    with (tmp_path / "a.tlog").open("wb") as file:
        codec = Codec(255, 190, log=file)
        out = codec.pack(HEARTBEAT)
        packet = Codec(1, 1).pack(HEARTBEAT)
        assert kinds(codec.read(packet)) == ["HEARTBEAT"]
    data = (tmp_path / "a.tlog").read_bytes()
    assert data[8 : 8 + len(out)] == out
    assert data[-len(packet) :] == packet
    first, second = (struct.unpack(">Q", data[i : i + 8])[0] for i in (0, 8 + len(out)))
    assert 1.5e15 < first <= second < 1e16  # microseconds since 1970


def test_a_heartbeat_of_another_component_is_not_the_autopilots():
    """A camera or a companion of the same system is neither armed nor in a mode."""
    codec, telemetry = Codec(255, 190), Telemetry(1, 2)

    def hear(component, message, now):
        for taken in codec.read(Codec(1, component).pack(message), whole=True):
            telemetry.take(taken, now)

    camera = dialect.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3)
    hear(100, camera, 1.0)
    assert telemetry.autopilot is None
    hear(1, HEARTBEAT, 2.0)
    hear(191, camera, 3.0)
    assert (telemetry.autopilot, telemetry.mode, telemetry.armed) == (12, 6 << 16, True)


def heard(telemetry, message, now):
    message._header.srcSystem, message._header.srcComponent = 1, 1
    telemetry.take(message, now)


def test_since_when_the_autopilot_does_not_know_where_it_is():
    telemetry = Telemetry(1, 2)
    lost, found = (dialect.MAVLink_ekf_status_report_message(flags, *[0.1] * 5)
                   for flags in (0xA7, 0x33F))  # fmt: skip
    for now in (1.0, 2.0, 3.0):
        heard(telemetry, lost, now)
    assert telemetry.lost_time == 1.0
    heard(telemetry, found, 4.0)
    assert telemetry.lost_time == math.inf
    heard(telemetry, lost, 5.0)
    assert telemetry.lost_time == 5.0


def test_only_answers_to_us_tell_of_the_round_trip():
    telemetry = Telemetry(1, 2)
    for there, back in ((0, 100 * 10**9), (1, 99 * 10**9), (1, 102 * 10**9), (1, 10**9)):
        # A question; an answer; one from the future; one that is older than a minute.
        heard(telemetry, dialect.MAVLink_timesync_message(there, back), 100.0)
    assert list(telemetry.round_trips) == [pytest.approx(1.0)]


def test_a_clock_that_jumps_is_noticed_and_then_followed():
    telemetry = Telemetry(1, 2)

    def position(boot, now):
        heard(telemetry, dialect.MAVLink_local_position_ned_message(
            round(boot * 1e3), *[0.0] * 6), now)  # fmt: skip

    for k in range(10):
        position(50.0 + 0.1 * k, 10.0 + 0.1 * k)
    assert telemetry.jump_time == -math.inf
    position(56.0, 11.0)
    assert (telemetry.jump_time, telemetry.restarts) == (11.0, 0)
    position(56.1, 11.1)
    assert telemetry.jump_time == 11.0
    position(0.5, 12.0)
    assert (telemetry.jump_time, telemetry.restarts) == (12.0, 1)


def test_a_command_that_is_not_finite_is_never_sent():
    end = peer()
    link = AutopilotLink(open_url(f"udpout:127.0.0.1:{end.getsockname()[1]}"), Telemetry(1, 2))
    with pytest.raises(ValueError, match="finite"):
        link.command(22, float("nan"))
    assert link.sent == 0
    link.close()
