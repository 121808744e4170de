"""Transports, packets and signatures of the bridge."""

import contextlib
import json
import math
import os
import pty
import socket
import struct
import time
import tty

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.codec import Codec, read_key
from msg_bridge.mavlink.link import AutopilotLink
from msg_bridge.mavlink.signing import StampBook, Stream, open_book
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


def listening():
    """A link that listens, and where."""
    free = peer()
    port = free.getsockname()[1]
    free.close()
    return AutopilotLink(open_url(f"udpin:127.0.0.1:{port}"), Telemetry(1, 2)), ("127.0.0.1", port)


def say(link, end, address, message, now, system=1):
    """One packet to a link, taken."""
    end.sendto(Codec(system, 1).pack(message), address)
    link.wait(1.0)
    link.poll(now)


def place(north, system_time=1.0):
    return dialect.MAVLink_local_position_ned_message(round(system_time * 1e3), north, *[0.0] * 5)


def silent(*ends):
    for end in ends:
        end.settimeout(0.05)
        with pytest.raises(TimeoutError):
            end.recv(300)


def test_listening_nothing_is_sent_until_the_autopilot_was_heard():
    """And then only to it."""
    link, address = listening()
    autopilot, stranger, elsewhere = peer(), peer(), peer(host="127.0.0.2")
    link.poll(0.0)
    say(link, stranger, address, HEARTBEAT, 1.0, system=9)
    camera = dialect.MAVLink_heartbeat_message(30, dialect.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3)
    say(link, stranger, address, camera, 1.1)
    say(link, stranger, address, place(1.0), 1.2)
    assert link.sent == 0
    assert link.telemetry.position_time == -math.inf
    say(link, autopilot, address, HEARTBEAT, 2.0)
    assert link.sent > 0
    assert "HEARTBEAT" in kinds(Codec(1, 1).read(autopilot.recv(300)))
    say(link, elsewhere, address, HEARTBEAT, 2.1)  # another host claims to be it
    assert link._transport.dropped == 1
    link.poll(4.0)
    silent(stranger, elsewhere)
    link.close()


def test_a_feed_of_the_load_never_becomes_where_setpoints_go():
    """Also not when it speaks first, and more often than the vehicle."""
    link, address = listening()
    autopilot, feed = peer(), peer()
    say(link, feed, address, place(0.0), 0.0, system=2)
    assert not link.send(HEARTBEAT)
    say(link, autopilot, address, HEARTBEAT, 0.1)
    say(link, autopilot, address, place(0.0), 0.1)
    for k in range(100):
        say(link, feed, address, place(0.0, 1.0 + 0.01 * k), 0.2 + 0.01 * k, system=2)
        assert link.send(HEARTBEAT)
    assert link.telemetry.load_time == pytest.approx(1.19)
    silent(feed)
    link.close()


def test_who_also_says_that_it_is_the_vehicle_is_not_believed_but_named():
    link, address = listening()
    autopilot, liar = peer(), peer()
    say(link, autopilot, address, HEARTBEAT, 0.0)
    say(link, autopilot, address, place(1.0), 0.1)
    for message in (place(90.0, 1.1), HEARTBEAT):
        say(link, liar, address, message, 0.2)
    assert link.telemetry.position[1] == 1.0  # north
    host, port = liar.getsockname()
    assert link.sources.others == {f"system 1 at {host}:{port}": 2}
    (said,) = link.sources.news
    assert f"{host}:{port} are not believed" in said
    silent(liar)
    # Who was restarted may speak from another port, once the old one has been silent.
    say(link, liar, address, place(90.0, 1.2), 3.0)
    assert link.telemetry.position[1] == 1.0
    say(link, liar, address, HEARTBEAT, 3.1)
    say(link, liar, address, place(5.0, 1.3), 3.2)
    assert link.telemetry.position[1] == 5.0
    link.poll(4.5)
    liar.settimeout(5.0)
    assert liar.recv(300)
    link.close()


@pytest.mark.parametrize("key", [None, KEY])
def test_datagrams_too_large_to_be_packets_are_not_looked_into(key):
    end = peer()
    link = AutopilotLink(open_url(f"udpout:127.0.0.1:{end.getsockname()[1]}"), Telemetry(1, 2), key)
    link.send(HEARTBEAT)
    _, ours = end.recvfrom(300)
    end.sendto(b"\xfd" + bytes(60_000), ours)
    end.sendto(Codec(1, 1, key).pack(HEARTBEAT), ours)
    link.wait(1.0)
    assert link.poll(0.0)
    assert (link.codec.rejected, link.codec.received) == (0, 1)
    assert link._transport.dropped == 1
    link.close()


def test_strangers_are_looked_into_a_little_but_the_vehicle_always():
    link, address = listening()
    autopilot, stranger = peer(), peer()
    say(link, autopilot, address, HEARTBEAT, 0.0)
    for k in range(60):
        stranger.sendto(bytes(4000), address)
        say(link, autopilot, address, place(float(k), 0.1 + 0.01 * k), 0.01 * k)
        assert link.telemetry.position[1] == k
    assert 50 < link.unread < 60
    assert link.codec.rejected > 0
    link.close()


def test_tcp_comes_back_after_it_broke():
    server = peer(socket.SOCK_STREAM)
    port = server.getsockname()[1]
    transport = open_url(f"tcp:127.0.0.1:{port}")
    transport.wait(0.05)
    assert not transport.write(b"x")  # refused: nobody listens yet
    assert "refused" in transport.trouble
    server.listen()
    for _ in range(2):
        written_until(transport, b"hello")
        assert not transport.trouble
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
        assert "has broken" in transport.trouble
    transport.close()
    server.close()


def written_until(transport, data, times=400):
    """Until it could be sent."""
    for _ in range(times):
        transport.wait(0.02)
        if transport.write(data):
            return
    raise AssertionError(transport.trouble)


def attempts(monkeypatch, transport, of, seconds=1.5):
    """How often something is called while one waits for a line that is gone, and how often that
    wait returns at once."""
    made, begun, real = [], time.monotonic(), getattr(transport, of)
    monkeypatch.setattr(transport, of, lambda: made.append(1) or real())
    waits = 0
    while time.monotonic() - begun < seconds:
        transport.wait(0.02)
        transport.read()
        transport.write(b"x")
        waits += 1
    return len(made), waits


def test_a_connection_that_is_refused_is_tried_ever_more_seldom(monkeypatch):
    end = peer(socket.SOCK_STREAM)  # bound, so that nobody else listens there
    transport = open_url(f"tcp:127.0.0.1:{end.getsockname()[1]}")
    made, waits = attempts(monkeypatch, transport, "_connect")
    assert 2 <= made <= 6  # after 0.1, 0.2, 0.4 and 0.8 s
    assert waits < 150  # and nobody polls without a pause
    end.close()


def test_a_serial_line():
    ours, theirs = raw_line()
    transport = open_url(f"serial:{os.ttyname(theirs)}:57600")
    assert transport.write(b"hello")
    assert os.read(ours, 10) == b"hello"
    os.write(ours, b"back")
    assert until(transport) == b"back"
    transport.close()
    os.close(ours)
    with contextlib.suppress(OSError):
        os.close(theirs)


def test_a_serial_line_that_was_pulled_is_opened_again(monkeypatch, tmp_path):
    link = tmp_path / "line"
    ours, theirs = raw_line()
    link.symlink_to(os.ttyname(theirs))
    transport = open_url(f"serial:{link}:57600")
    assert transport.write(b"hello")
    os.close(ours)
    os.close(theirs)
    link.unlink()
    made, waits = attempts(monkeypatch, transport, "_open")
    assert 2 <= made <= 6
    assert waits < 150
    assert "is gone; it is opened again" in transport.trouble
    ours, theirs = raw_line()
    link.symlink_to(os.ttyname(theirs))
    written_until(transport, b"again")
    assert os.read(ours, 10) == b"again"
    assert not transport.trouble
    os.write(ours, b"back")
    assert until(transport) == b"back"
    transport.close()
    os.close(ours)


def raw_line():
    ours, theirs = pty.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)
    return ours, theirs


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
    ahead = StampBook()
    ahead.take(Stream(0, 1, 1), ahead.next(Stream(0, 1, 1)) + 10**9)
    liar = Codec(1, 1, OTHER, book=ahead)
    assert not kinds(codec.read(liar.pack(HEARTBEAT)))
    assert kinds(codec.read(honest.pack(HEARTBEAT))) == ["HEARTBEAT"]


def recorded(n=1, system=1, link=0):
    """Signed packets, as somebody may have recorded them."""
    sender = Codec(system, 1, KEY)
    sender._parser.signing.link_id = link
    return [sender.pack(HEARTBEAT) for _ in range(n)]


def taken(codec, packets):
    return [bool(kinds(codec.read(packet, whole=True))) for packet in packets]


def test_a_packet_that_was_recorded_is_not_taken_by_another_link_of_ours(tmp_path):
    packets = recorded(3)
    one, other = (Codec(255, 190, KEY, book=open_book(KEY, tmp_path)) for _ in range(2))
    assert taken(one, packets) == [True] * 3
    assert taken(other, packets) == [False] * 3
    assert other.stale == 3


@pytest.mark.parametrize("ended", [True, False])
def test_nor_after_a_restart(tmp_path, ended):
    """Whether it had ended well or was killed."""
    packets, path = recorded(3), tmp_path / "stamps.json"
    book = StampBook(path)
    codec = Codec(255, 190, KEY, book=book)
    sent = codec.pack(HEARTBEAT)
    assert taken(codec, packets) == [True] * 3
    if ended:
        codec.close()
    end = time.monotonic() + 20.0
    while stamps(path) != stamps_of(book):  # by its thread, when nobody closes it
        assert time.monotonic() < end
        time.sleep(0.02)
    again = Codec(255, 190, KEY, book=StampBook(path))
    assert taken(again, packets) == [False] * 3
    assert taken(again, recorded()) == [True]
    later = again.pack(HEARTBEAT)
    assert stamp(later) > stamp(sent)


def stamp(packet):
    return int.from_bytes(packet[-12:-6], "little")


def stamps(path):
    return {Stream(*row[:3]): row[3] for row in json.loads(path.read_text())}


def stamps_of(book):
    return dict(book._stamps)


def test_what_was_recorded_on_another_link_of_the_same_vehicle_is_not_taken_here():
    """A link that is new may be a minute behind, but not who was heard since."""
    radio = recorded(3, link=1)
    codec = Codec(255, 190, KEY)
    assert taken(codec, recorded(2, link=0)) == [True] * 2
    assert taken(codec, radio) == [False] * 3
    assert taken(codec, recorded(2, link=1)) == [True] * 2


def test_who_was_not_heard_yet_may_be_a_minute_behind_and_no_more():
    book = StampBook()
    now = book.next(Stream(0, 255, 190))
    assert book.fresh(Stream(0, 1, 1), now - 59 * 100_000)
    assert not book.fresh(Stream(0, 1, 1), now - 61 * 100_000)


def test_two_processes_with_one_key_keep_each_others_stamps(tmp_path):
    path = tmp_path / "stamps.json"
    one, other = StampBook(path), StampBook(path)
    one.take(Stream(0, 1, 1), 10)
    other.take(Stream(0, 2, 1), 20)
    one.take(Stream(0, 3, 1), 31)
    other.take(Stream(0, 3, 1), 30)
    one.save()
    other.save()
    assert stamps(path) == {Stream(0, 1, 1): 10, Stream(0, 2, 1): 20, Stream(0, 3, 1): 31}


@pytest.mark.parametrize("content", [b"", b"{}x", b"[[1, 2, 3]]", b"\xff"])
def test_stamps_that_cannot_be_read_are_not_taken_for_none(tmp_path, content):
    (tmp_path / "stamps.json").write_bytes(content)
    with pytest.raises(InputError, match="recorded packets would be taken again"):
        StampBook(tmp_path / "stamps.json")
    assert (tmp_path / "stamps.json").read_bytes() == content


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
    assert telemetry.jump == "the autopilot's clock has jumped by +5.0 s"
    position(56.1, 11.1)
    assert telemetry.jump_time == 11.0
    position(0.5, 12.0)
    assert (telemetry.jump_time, telemetry.restarts) == (12.0, 1)
    position(0.6, 14.1)
    assert telemetry.jump == "the autopilot's clock stood still for 2.0 s"
    position(2.6, 14.1)
    assert telemetry.jump == "what the autopilot says came 2.0 s late"
    telemetry.behind = True  # we stood still, and it did not
    position(2.7, 17.0)
    position(5.5, 17.0)
    assert telemetry.jump_time == 14.1


def test_a_command_that_is_not_finite_is_never_sent():
    end = peer()
    link = AutopilotLink(open_url(f"udpout:127.0.0.1:{end.getsockname()[1]}"), Telemetry(1, 2))
    with pytest.raises(ValueError, match="finite"):
        link.command(22, float("nan"))
    assert link.sent == 0
    link.close()
