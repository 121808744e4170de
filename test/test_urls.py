"""Addresses of autopilots: those that others' tools take are understood, or refused by name."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.urls import Address, parse

HOSTS = st.sampled_from(["127.0.0.1", "localhost", "10.0.0.7", "drone.local"])
PORTS = st.integers(1, 65_535)
NETWORK = st.builds(Address, st.sampled_from(["udpin", "udpout", "tcp"]), HOSTS, PORTS)
LINES = st.builds(
    Address,
    st.just("serial"),
    st.sampled_from(["/dev/ttyACM0", "/dev/serial/by-id/usb-3D-if00"]),
    st.sampled_from([9600, 57600, 921600]),
)


@given(NETWORK | LINES)
def test_what_is_written_is_read_again_with_slashes_or_without(address):
    assert parse(str(address)) == address
    assert parse(str(address).replace(":", "://", 1)) == address


@pytest.mark.parametrize(
    ("url", "means"),
    [
        ("udp://127.0.0.1:14540", "udpin:127.0.0.1:14540"),  # MAVSDK before 2, MAVProxy
        ("udp:127.0.0.1:14550", "udpin:127.0.0.1:14550"),
        ("udp://@10.0.0.7:14550", "udpout:10.0.0.7:14550"),  # mavros, remote alone
        ("udp://:14540@127.0.0.1:14557", "udpin:127.0.0.1:14540"),  # PX4's with mavros
        ("udp://10.0.0.2:14540@10.0.0.7:14557/", "udpin:10.0.0.2:14540"),
        ("tcpout://127.0.0.1:5760", "tcp:127.0.0.1:5760"),
        ("tcp://localhost:5760", "tcp:localhost:5760"),
        ("serial:///dev/ttyACM0:921600", "serial:/dev/ttyACM0:921600"),
        ("serial:///dev/ttyACM0", "serial:/dev/ttyACM0:57600"),  # mavros' default
        ("/dev/ttyUSB0,115200", "serial:/dev/ttyUSB0:115200"),  # MAVProxy
        ("/dev/ttyUSB0:115200", "serial:/dev/ttyUSB0:115200"),
    ],
)
def test_forms_of_other_tools_are_understood(url, means):
    assert str(parse(url)) == means


@pytest.mark.parametrize(
    ("url", "right"),
    [
        ("udp://:14540", "udpin:127.0.0.1:14540 for"),
        ("udpin://0.0.0.0:14540", "udpin:127.0.0.1:14540 for"),
        ("udp://:14540@10.0.0.7:14557", "the one address of this machine"),
        ("udp://@:14540", "udpout:127.0.0.1:14540"),
        ("tcp://:5760", "tcp:127.0.0.1:5760"),
        ("tcp-l://127.0.0.1:5760", "tcp:127.0.0.1:5760, which calls"),
        ("tcpin://127.0.0.1:5760", "tcp:127.0.0.1:5760, which calls"),
        ("udp://@10.0.0.7:14550/?ids=1,1", "udp://@10.0.0.7:14550, and the parameter `system`"),
        ("serial:///dev/ttyACM0:fast", "serial:/dev/ttyACM0:57600"),
        ("udpin:127.0.0.1", "udpin:127.0.0.1:14540 (listen)"),
        ("udpin:127.0.0.1:99999", "a port from 1 to 65535"),
        ("14540", "udpin:127.0.0.1:14540 (listen)"),
        ("http://127.0.0.1:80", "udpin:127.0.0.1:14540 (listen)"),
        ("serial:ttyACM0:57600", "serial:/dev/ttyACM0:57600"),
        ("", "udpin:127.0.0.1:14540 (listen)"),
        ("udpin:0:14540", "udpin:127.0.0.1:14540 for"),
        ("udpin:0x0:14540", "udpin:127.0.0.1:14540 for"),
        ("udpin:000.000.000.000:14540", "udpin:127.0.0.1:14540 for"),
        ("tcp:127.0.0.1:²", "udpin:127.0.0.1:14540 (listen)"),
        ("serial:/dev/ttyACM0:²", "serial:/dev/ttyACM0:57600"),
        ("tcp:127.0.0.1:" + "9" * 5000, "udpin:127.0.0.1:14540 (listen)"),
        ("tcp:a b:5760", "udpin:127.0.0.1:14540 (listen)"),
        ("udpout:\0:5760", "udpin:127.0.0.1:14540 (listen)"),
        ("udp://:14540@127.0.0.1:abc", "udpin:127.0.0.1:14540 (listen)"),
    ],
)
def test_what_cannot_be_meant_is_refused_with_the_right_one(url, right):
    with pytest.raises(InputError) as refused:
        parse(url)
    assert repr(url) in str(refused.value)
    assert right in str(refused.value)
