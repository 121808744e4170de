"""A ground station without a socket, for tests of the embedded autopilot in its own time."""

import copy
import copyreg
import dataclasses
import struct

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sim_nodes.autopilot.autopilot import TICK, Autopilot
from sim_nodes.autopilot.firmware import find_firmware

ACCELERATION, VELOCITY = 0x0C3F, 0x0DC7
GUIDED, OFFBOARD = (4,), (6, 0)


class Peer:
    def __init__(self, like, system=255, share=None, ready_after=None, **settings):
        firmware = find_firmware(like)
        if ready_after is not None:
            firmware = dataclasses.replace(firmware, ready_after=ready_after)
        # Its figures are compared with what was measured: without the estimate's own error.
        known = {"SIM_WANDER": 0.0} | (settings.pop("parameters", None) or {})
        self.autopilot = share or Autopilot(firmware, known, **settings)
        self.link = self.autopilot.connect()
        self.mav = mavlink.MAVLink(None, system, 190)
        self.mav.robust_parsing = True
        self.heard = []  # (time, message)

    @property
    def body(self):
        return self.autopilot.body

    @property
    def now(self):
        return self.autopilot.now

    # ------------------------------------------------------------ out

    def send(self, message):
        self.autopilot.receive(self.link, bytes(message.pack(self.mav)))
        self.mav.seq = (self.mav.seq + 1) % 256
        self.listen()

    def order(self, number, *values, system=1, component=1):
        """Send a command."""
        values = [*values, *[0.0] * (7 - len(values))]
        self.send(mavlink.MAVLink_command_long_message(system, component, number, 0, *values))

    def command(self, number, *values, **target):
        """Send a command and give the results that come at once."""
        before = len(self.heard)
        self.order(number, *values, **target)
        self.run(TICK)
        return [m.result for _, m in self.heard[before:]
                if m.get_type() == "COMMAND_ACK" and m.command == number]  # fmt: skip

    def aim(self, mask, place=(0, 0, 0), speed=(0, 0, 0), push=(0, 0, 0), frame=1, system=1,
            yaw_rate=0.0, component=1):  # fmt: skip
        self.send(mavlink.MAVLink_set_position_target_local_ned_message(
            0, system, component, frame, mask, *place, *speed, *push, 0.0, yaw_rate))  # fmt: skip

    def set(self, name, value):
        number, kind = float(value), 9
        if isinstance(value, int):
            kind = 6
            if self.autopilot.firmware.bytewise:
                number = struct.unpack("<f", struct.pack("<i", value))[0]
        self.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), number, kind))

    def mode(self, *custom):
        return self.command(176, 1, *custom)

    # ------------------------------------------------------------ in

    def listen(self):
        for data in self.link.out:
            self.heard += [(self.now, m) for m in self.mav.parse_buffer(data) or ()]
        self.link.out.clear()

    def of(self, kind, since=0.0, system=1):
        self.listen()
        return [m for at, m in self.heard
                if at >= since and (m.get_type(), m.get_srcSystem()) == (kind, system)]  # fmt: skip

    def texts(self, since=0.0):
        return [m.text for m in self.of("STATUSTEXT", since)]

    @property
    def shown(self):
        """custom_mode of the latest heartbeat."""
        return self.of("HEARTBEAT")[-1].custom_mode

    # ------------------------------------------------------------ time

    def run(self, duration, every=None, rate=20.0):
        """Let time pass, calling `every` (time since the start) at a rate."""
        start, due = self.now, 0.0
        while self.now - start < duration - TICK / 2:
            if every and self.now - start >= due - 1e-9:
                every(self.now - start)
                due += 1.0 / rate
            self.autopilot.advance(TICK)
            self.listen()

    def until(self, holds, deadline, every=None, rate=20.0):
        """Time that passed until something held."""
        start = self.now
        while not holds():
            assert self.now - start < deadline, "it never came about"
            self.run(max(TICK, 1.0 / rate if every else TICK), every, rate)
        return self.now - start


def flying(like, height=5.0, parameters=None, **settings):
    """A vehicle in the air, in the mode for setpoints from outside; a copy of one flown before."""
    key = (like, height, *sorted((parameters or {}).items()), *sorted(settings.items()))
    if key not in _FLOWN:
        _FLOWN[key] = _take_off(like, height, parameters=parameters or {}, **settings)
    return copy.deepcopy(_FLOWN[key])


_FLOWN = {}
copyreg.pickle(struct.Struct, lambda s: (struct.Struct, (s.format,)))  # of pymavlink's parsers


def _take_off(like, height, **settings):
    peer = Peer(like, ready_after=1.0, **settings)
    peer.run(peer.autopilot.firmware.ready_after + 1.0)
    if like == "ardupilot":
        assert peer.mode(*GUIDED) == [0]
        assert peer.command(400, 1) == [0]
        assert peer.command(22, 0, 0, 0, 0, 0, 0, height) == [0]
        peer.run(4.0 + 1.5 * height)
    else:
        rise = (0x0DF8, (0.0, 0.0, -height))
        peer.run(0.5, lambda _: peer.aim(*rise))
        peer.mode(*OFFBOARD)
        assert peer.command(400, 1) == [0]
        peer.run(4.0 + 1.5 * height, lambda _: peer.aim(*rise))
    assert abs(peer.body.height - height) < 0.1
    return peer
