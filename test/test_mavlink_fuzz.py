"""Whatever an autopilot's port brings: no exception, and only numbers that are some."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from msg_bridge.mavlink.codec import Codec
from msg_bridge.mavlink.telemetry import _OF_LOAD, _OF_VEHICLE, Telemetry

HEARTBEAT = dialect.MAVLink_heartbeat_message(2, 12, 128, 6 << 16, 4, 3)
KINDS = sorted(_OF_VEHICLE.keys() | _OF_LOAD.keys())
CLASSES = {c.msgname: c for c in dialect.mavlink_map.values()}
RANGES = {
    "int8_t": (-(2**7), 2**7 - 1), "uint8_t": (0, 2**8 - 1), "int16_t": (-(2**15), 2**15 - 1),
    "uint16_t": (0, 2**16 - 1), "int32_t": (-(2**31), 2**31 - 1), "uint32_t": (0, 2**32 - 1),
    "int64_t": (-(2**63), 2**63 - 1), "uint64_t": (0, 2**64 - 1),
}  # fmt: skip


def field_of(kind, count):
    if kind == "char":
        return st.binary(max_size=count)
    odd = st.sampled_from([0.0, 1.0, math.nan, math.inf, -math.inf, float(np.float32(3e38))])
    one = odd | (st.floats(width=32) if kind == "float" else st.floats())
    if kind in RANGES:
        low, high = RANGES[kind]
        one = st.sampled_from([0, 1, low, high]) | st.integers(low, high)
    return st.lists(one, min_size=count, max_size=count) if count else one


@st.composite
def messages(draw, kinds=tuple(KINDS)):
    """Any message that the bridge listens to, with any values that its fields can carry."""
    made = CLASSES[draw(st.sampled_from(kinds))]
    fields = zip(made.fieldnames, made.fieldtypes, strict=True)
    sizes = dict(zip(made.ordered_fieldnames, made.array_lengths, strict=True))
    return made(*(draw(field_of(kind, sizes[name])) for name, kind in fields))


@given(st.lists(st.binary(max_size=300), max_size=8))
@pytest.mark.parametrize("key", [None, bytes(range(32))])
def test_any_bytes_are_counted_and_the_next_packet_is_read(key, noise):
    codec, sender = Codec(255, 190, key), Codec(1, 1, key)
    for data in noise:
        list(codec.read(data, whole=True))
    assert [m.get_type() for m in codec.read(sender.pack(HEARTBEAT), whole=True)] == ["HEARTBEAT"]


@given(messages(), st.integers(0, 10_000), st.integers(1, 255))
def test_a_changed_packet_is_none(message, place, change):
    """Its checksum finds every change of one byte; but what is behind it, it does not cover."""
    codec = Codec(255, 190)
    packet = bytearray(Codec(1, 1).pack(message))
    packet[place % len(packet)] ^= change
    assert [m.to_dict() for m in codec.read(bytes(packet), whole=True)] == []


@given(st.lists(st.tuples(messages(), st.sampled_from([1, 2, 77]), st.floats(0, 2)), max_size=20))
def test_any_message_leaves_numbers_that_are_some(sent):
    told = []
    seen = Telemetry(1, 2, on_position=lambda *given: told.append(given))
    codecs = {system: Codec(system, 1) for system in (1, 2, 77)}
    ours, now = Codec(255, 190), 100.0
    for message, system, passed in sent:
        now += passed
        for heard in ours.read(codecs[system].pack(message), whole=True):
            assert seen.take(heard, now) == (system != 77)
    assert np.isfinite(seen.acceleration).all()
    assert np.isfinite(seen.up).all()
    assert math.isfinite(seen.round_trip)
    assert seen.ready in (True, False)
    if seen.position_time > 0.0:
        assert np.isfinite([seen.position, seen.velocity]).all()
    if seen.load_time > 0.0:
        assert np.isfinite(seen.load_offset).all()
    for change, took in told:
        assert np.isfinite(change).all()
        assert 0.0 < took < 1.0
    assert all(isinstance(text, str) for text in seen.texts_since(0.0))
