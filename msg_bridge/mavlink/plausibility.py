"""Whether what the sensors say is possible, by nothing but arithmetic: no model of a task in here.

A position has to go where its velocity leads, a velocity where what was asked for can lead, numbers
that are measured are never the same for long, and a load hangs on its cable. What cannot be is said
in words, and empty words mean that nothing is known against it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_WINDOW = 1.0  # over which a position is compared with its velocity [s]
_GAP = 30.0  # without a word, after which nothing is compared [s]
_FASTEST = 10.0  # over a gap longer than the window [m/s]
_STRAY = 1.2  # that it may be off by then [m]: noise, and a reset of the autopilot's filter
_FROZEN = 0.3  # so long measured numbers may be the same to the last bit [s]...
_SAME = 5  # ...in so many messages
_HELD = 0.9  # so long an acceleration has to be asked for before its effect is looked at [s]
_PAUSE = 0.1  # without a word of ours, after which what is measured is late, too [s]
_EFFECT = 0.4  # at the end of that the velocity has to change as asked for [s]
_WEAK = 1.5  # accelerations below are not told from wind [m/s²]
_DRAG = 1.5  # share of a velocity lost to the air at most [1/s]
_WIND = 1.0  # accelerations that nobody asked for [m/s²]
_NOISE = 0.3  # of the difference of two velocities [m/s]
_LONG = 1.5  # cable lengths, and...
_LATE = 0.5  # ...distance that a feed which is late is off by [m]
_SHORT = 0.3  # of the cable's length, nearer than that no load hangs
_SWING = 3.5  # times sqrt(g L) a load moves at most: from 90° it is 1.41 [m/s]
_G = 9.81


class Sample(NamedTuple):
    """What was measured at a time of the autopilot's clock [s].

    Attributes
    ----------
    time : float
    position, velocity : ndarray of shape (3,)
        [m], [m/s].
    stray : ndarray of shape (3,)
        Of the position from the sum of all velocities [m]: it must stay what it is.
    """

    time: float
    position: Array
    velocity: Array
    stray: Array


class VehicleCheck:
    """Looks at the vehicle's positions and velocities, in the order in which they come."""

    def __init__(self) -> None:
        self._samples: deque[Sample] = deque()
        self._seen = self._since = math.nan
        self._same = 0
        self._jumped = self._off = 0.0
        self._asked: deque[tuple[float, Sequence[float], Sequence[float]]] = deque()

    def forget(self) -> None:
        """What was before has nothing to do with what comes: a restart, or another hand."""
        self._samples.clear()
        self._asked.clear()
        self._same, self._since, self._jumped, self._off = 0, math.nan, 0.0, 0.0

    def see(self, now: float, time: float, position: Array, velocity: Array) -> None:
        """Take what was measured, at a time of the autopilot, and is known now of ours [s]."""
        stray = np.zeros(3)
        if self._samples:
            last = self._samples[-1]
            passed, ours = time - last.time, now - self._seen
            if passed == 0.0:
                return
            if not 0.0 < passed <= _WINDOW:
                # Whatever became of its clock, it can have gone no further.
                gap = max(ours, passed if passed < _GAP else 0.0)
                jump = float(np.linalg.norm(position - last.position)) - _FASTEST * gap
                off = self._off
                self.forget()
                self._jumped, self._off = max(jump, 0.0) * (gap < _GAP), off
            else:
                stray = last.stray + position - last.position
                stray -= 0.5 * passed * (velocity + last.velocity)
                same = (position == last.position).all() and (velocity == last.velocity).all()
                self._same = self._same + 1 if same else 0
                self._since = self._since if self._same > 1 else last.time
        self._samples.append(Sample(time, position.copy(), velocity.copy(), stray))
        self._seen = now
        while time - self._samples[0].time > _WINDOW:
            self._samples.popleft()
        self._off = self._stray()

    def ask(self, now: float, acceleration: Sequence[float], speed: Sequence[float]) -> None:
        """Accelerations were asked for along each axis [m/s²], at speeds along the same [m/s]."""
        if self._asked and now - self._asked[-1][0] > _PAUSE:
            self._asked.clear()
        self._asked.append((now, acceleration, speed))
        while now - self._asked[0][0] > 1.5 * _HELD:
            self._asked.popleft()

    def asked_nothing(self) -> None:
        """The vehicle goes by a position or a velocity, or by somebody else."""
        self._asked.clear()

    def impossible(self) -> str:
        """Why it cannot be so."""
        return self.strayed() or self._frozen() or self._disobedient()

    def strayed(self) -> str:
        """Where the position is, if it has gone elsewhere than its velocity since it was looked at.

        What is where it cannot be does not become right by staying there.
        """
        words = f"the position is {self._off:.1f} m from where its velocity leads"
        return words * (self._off > _STRAY)

    def _stray(self) -> float:
        """How far it has gone from there in the window [m], or ever, if that was impossible."""
        moved = self._samples[-1].stray - self._samples[0].stray if self._samples else np.zeros(3)
        now = float(np.linalg.norm(moved)) + self._jumped
        return max(now, self._off) if self._off > _STRAY else now

    def _frozen(self) -> str:
        if self._same < _SAME:
            return ""
        span = self._samples[-1].time - self._since
        words = f"position and velocity have not changed by a bit for {span:.1f} s"
        return words * (span >= _FROZEN)

    def _disobedient(self) -> str:
        """The velocity does not change as what was asked for can change it.

        Only looked at after the same strong acceleration was asked for all along, so that
        nothing need be known of how late it is followed.
        """
        if not self._asked or self._asked[-1][0] - self._asked[0][0] < _HELD:
            return ""
        axes = range(len(self._asked[-1][1]))
        return next((why for axis in axes if (why := self._ignored(axis))), "")

    def _ignored(self, axis: int) -> str:
        now, asked, speed = self._asked_along(axis)[-1]
        wanted = [a for when, a, _ in self._asked_along(axis) if now - when <= _HELD]
        if math.copysign(1.0, min(wanted)) != math.copysign(1.0, max(wanted)):
            return ""
        least = min(map(abs, wanted))
        if least < _WEAK:
            return ""
        side = math.copysign(1.0, asked)
        begun, _, before = next(
            entry for entry in self._asked_along(axis) if now - entry[0] <= _EFFECT
        )
        # Towards a velocity the air holds it back; away from one it helps.
        lost = _DRAG * max(side * before, side * speed, 0.0) + _WIND
        expected = (least - lost) * (now - begun) - _NOISE
        changed = side * (speed - before)
        if expected <= 0.0 or changed >= expected:
            return ""
        return (
            f"asked to accelerate by {asked:.1f} m/s² its velocity has changed by "
            f"{side * changed:.1f} m/s in {now - begun:.1f} s"
        )

    def _asked_along(self, axis: int) -> list[tuple[float, float, float]]:
        return [(when, push[axis], speed[axis]) for when, push, speed in self._asked]


class LoadCheck:
    """Looks at where a load says that it is.

    Parameters
    ----------
    cable : float
        Its length [m].
    """

    def __init__(self, cable: float) -> None:
        self._cable = cable
        self._last: tuple[float, Array] | None = None

    def see(self, time: float, offset: Array) -> str:
        """Why a load on the cable cannot be there.

        Parameters
        ----------
        time : float
            [s]
        offset : ndarray of shape (3,)
            From the vehicle to the load: two horizontal, and up [m].
        """
        before, self._last = self._last, (time, offset)
        distance, length = float(np.linalg.norm(offset)), self._cable
        if distance > _LONG * length + _LATE:
            return f"it is {distance:.1f} m from the vehicle, on a cable of {length:g} m"
        if offset[2] > _SHORT * length:
            return f"it is {offset[2]:.1f} m above the vehicle"
        if distance < _SHORT * length:
            return f"it is {distance:.2f} m from the vehicle, on a cable of {length:g} m"
        if before is not None and 0.0 < time - before[0] < 0.5 * _WINDOW:
            jump = float(np.linalg.norm(offset - before[1]))
            most = _SWING * math.sqrt(_G * length) * (time - before[0]) + 0.2 * length
            if jump > most:
                return f"it has jumped by {jump:.1f} m in {time - before[0]:.2f} s"
        return ""
