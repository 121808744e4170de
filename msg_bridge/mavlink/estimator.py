"""From telemetry to what the task and the envelope want to know, carried on to this moment."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.errors import InputError
from msg_bridge.mavlink.convert import Track
from msg_bridge.mavlink.load import Fall, LoadObserver
from msg_bridge.mavlink.motion import Motion, Vector
from msg_bridge.mavlink.plausibility import LoadCheck
from msg_bridge.mavlink.telemetry import Telemetry
from sim_nodes.tasks.base import G

Array = NDArray[np.float64]

_FURTHEST = 0.5  # telemetry is carried on along its velocity for no longer than this [s]
_DOUBTFUL = 0.2  # so long the load may be where it cannot be, as one late position has it [s]
_SILENT = 0.25  # without an accelerometer, after which velocities tell how it accelerates [s]
_FELT_GUST = 0.2  # of accelerations that it does not tell, per sqrt(Hz) [m/s²]
_FORGETS = 1.5  # time in which the error of a speed does [s]
_LEAST_GUST = 0.05  # accelerations that nobody measures, per sqrt(Hz) [m/s²]
_APART = 1.0  # of the places of two receivers on the ground [m]
_SLACK = 1.3  # cable lengths away from the vehicle, a load is no longer on the cable


class StateEstimator:
    """The vehicle and its load in the task's frame.

    Parameters
    ----------
    telemetry : Telemetry
    track : Track
    cable : float
        Its length [m].
    feed : bool
        The load reports its own position; otherwise its swing is estimated.
    share : float
        Mass of the load over that of the vehicle, which then feels its pull; 0 where it does not.
    """

    def __init__(
        self, telemetry: Telemetry, track: Track, cable: float, *, feed: bool, share: float = 0.0
    ) -> None:
        self._telemetry, self._track, self._cable = telemetry, track, cable
        self.feed, self._share = feed, share
        self.load = LoadObserver(cable, share)
        self._felt = -math.inf
        self.fall: Fall | None = None
        """Of a load that was let go; None while it hangs."""
        self._ground = 0.0
        self._check = LoadCheck(cable)
        self._believed, self._doubt = -math.inf, ""
        telemetry.on_position, telemetry.on_load = self._moved, self._load_seen
        telemetry.on_force = self._pulled if share else None

    def stand(self) -> None:
        """The vehicle stands on the ground: heights count from here."""
        if math.isfinite(self._telemetry.position[2]):
            self._ground = float(self._telemetry.position[2])

    def place(self) -> tuple[float, float, float]:
        """Along, across and height, as reported last [m]."""
        along, across, up = self._track.place_here(self._telemetry.position)
        return float(along), float(across), float(up) - self._ground

    def up(self, height: float) -> float:
        """Height above the take-off point in the autopilot's own frame [m]."""
        return height + self._ground

    def motion(self, now: float) -> Motion:
        """Where everything is now."""
        t = self._telemetry
        age = min(max(now - t.position_time, 0.0), _FURTHEST)
        along, across, up = self._track.place_here(t.position + t.velocity * age)
        push = self._track.here(t.acceleration)
        speed, drift, climb = self._track.here(t.velocity) + push * (age, age, 0.0)
        if self._feels:
            age = min(max(now - self._felt, 0.0), _FURTHEST)
        cable, rate = self.load.ahead(push, age)
        return Motion(
            float(along), float(speed), float(across), float(drift), float(up) - self._ground,
            float(climb), _vector(self._track.here(t.up)), _vector(cable), _vector(rate),
        )  # fmt: skip

    def load_age(self, now: float) -> float:
        """Since the load was heard of [s]; zero when nobody has to be heard."""
        return now - self._telemetry.load_time if self.feed and self.fall is None else 0.0

    def load_doubt(self, now: float) -> str:
        """Why what is heard of cannot be the load, for a while now; empty when it may be."""
        if not self.feed or self.fall is not None or now - self._believed < _DOUBTFUL:
            return ""
        return self._doubt

    def check_feed(self) -> None:
        """Refuse to take off with what is too far away to be the load.

        Raises
        ------
        InputError
            When it is.
        """
        distance = float(np.linalg.norm(self._telemetry.load_offset))
        if self.feed and not self._telemetry.armed and distance > _APART + _SLACK * self._cable:
            raise InputError(
                f"system {self._telemetry.load_system} is {distance:.1f} m from the vehicle and "
                f"cannot be its load on a cable of {self._cable:g} m; allowed: load_system with "
                "the load's own number, cable, or load_source: estimate"
            )

    def let_go(self, motion: Motion, rim: float) -> None:
        """The load is to fall from now on; `rim` is the height of the basket's [m].

        A feed may be late, or tell heights wrong: it fell when it is seen lower, by that feed,
        than the cable lets it be.
        """
        hung = self._cable * motion.cable[2]
        up = float(self._telemetry.load_offset[2])
        wrong = up - hung if self.feed and math.isfinite(up) else 0.0
        self.fall = Fall(rim, _SLACK * self._cable - min(wrong, 0.0))
        self.fall.see(np.array(motion.place) + self._cable * np.array(motion.cable), motion.height)

    def hangs(self) -> bool:
        """Whether the load was last seen on the cable; True when nobody sees it."""
        if not self.feed:
            return True
        return float(np.linalg.norm(self._telemetry.load_offset)) < _SLACK * self._cable

    def away(self) -> bool:
        """Whether the load was last seen where no cable holds it."""
        distance = float(np.linalg.norm(self._telemetry.load_offset))
        return self.feed and distance >= _SLACK * self._cable

    def loaded(self) -> None:
        """A load hangs on the cable again, at rest."""
        self.fall = None
        self.load.still()

    def unsteady(self, speed: float) -> None:
        """Of what its changes are the swing is estimated: the vehicle's speed is as noisy [m/s].

        That noise is taken for one that forgets in `_FORGETS`, as measured on PX4. A feed corrects
        gusts besides, and they have to be expected.
        """
        if not self.feed:
            self.load.gust = max(_LEAST_GUST, speed * math.sqrt(2.0 / _FORGETS))

    # ------------------------------------------------------------ what comes in

    @property
    def _feels(self) -> bool:
        """Whether the accelerometer carries the load along, since it was heard of lately."""
        return self._telemetry.position_time - self._felt < _SILENT

    def _moved(self, change: Array, passed: float) -> None:
        if self.fall is None and not self._feels:
            self.load.move(self._track.here(change) / passed, passed)

    def _pulled(self, force: Array, passed: float, now: float) -> None:
        """The vehicle was pulled at: nothing measures better how it accelerates."""
        self._felt = now
        t = self._telemetry
        if self.fall is not None or not 0.0 < passed < _SILENT:
            return
        here = self._track.here(force)
        self.load.move(here - (0.0, 0.0, G), passed, _FELT_GUST)
        axes = np.array([self._track.here(axis) for axis in t.axes[:2]])
        self.load.feel(here, axes, self._track.here(t.velocity))

    def _load_seen(self) -> None:
        if not self.feed:
            return
        t = self._telemetry
        offset = self._track.here(t.load_offset)
        if self.fall is None:
            self._doubt = self._check.see(t.load_time, offset)
            if not self._doubt:
                self._believed = t.load_time
                self.load.measure(offset)
            return
        # The feed and the vehicle are of the same moment here: the offset was made so.
        place = self._track.place_here(t.position + t.velocity * (t.load_time - t.position_time))
        self.fall.see(place + offset - (0.0, 0.0, self._ground), float(place[2]) - self._ground)


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
