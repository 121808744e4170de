"""Whether a vehicle is at rest at its start, as well as its own noise lets one tell."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.mavlink.motion import Motion, Vector
from msg_bridge.mavlink.settings import FlightSettings

Array = NDArray[np.float64]

NOISE = ("position [m]", "speed [m/s]", "swing [rad]", "swing rate [rad/s]")
"""What is measured of it."""

_NAMES = ("position", "speed", "swing", "swing rate")
_UNITS = ("m", "m/s", "rad", "rad/s")
_LEAST = (0.1, 0.1)  # tolerances of position [m] and speed [m/s] without noise
_MOST = np.array([0.5, 0.5, 0.2, 0.6])  # whatever the noise
_WITHIN = 2.5  # deviations of what is measured at rest
_NEAR = (0.8, 0.8)  # of the start, where noise is measured: distance [m], speed [m/s]
_CALM = 2.0  # so long near, before it is [s]
_ENOUGH = 3.0  # that a measurement of the noise takes, from then on [s]
_MEMORY = 12.0  # of it [s]
_PERIOD = 0.1  # between two samples [s]
_INTERRUPTED = 2.0  # without a look, after which it begins anew [s]
_MAD = 1.4826  # deviation of a normal distribution over its median absolute deviation
_ACROSS, _HEIGHT = 0.4, 0.6  # [m]


class Settled(NamedTuple):
    """How it stands.

    Attributes
    ----------
    ready : bool
        At rest for long enough.
    waits_for : str
        What is not as it should be, with its tolerance; empty when all is.
    expired : bool
        It takes too long.
    """

    ready: bool = False
    waits_for: str = ""
    expired: bool = False


class Settling:
    """Waits for a vehicle and its load to come to rest at a start.

    What counts as at rest grows with the noise that is measured in flight, between bounds: of
    position, speed, swing and its rate, while the vehicle stays near its start and does not settle.

    Parameters
    ----------
    settings : FlightSettings
    axes : int
        Along how many it has to be at rest; across a single one only its distance is looked at.

    Attributes
    ----------
    noise : ndarray of shape (4,)
        Robust standard deviations of those, of the noisiest axis; zero until they were measured.
    """

    def __init__(self, settings: FlightSettings, axes: int = 1) -> None:
        self._settings, self._axes = settings, axes
        self.noise: Array = np.zeros(4)
        self._samples: deque[tuple[float, Array]] = deque()
        self.begin(0.0)

    def begin(self, now: float) -> None:
        """A way to a start begins; what was measured of the noise stays."""
        self._begun = self._moving = self._far = self._seen = now
        self._samples.clear()

    @property
    def tolerances(self) -> Array:
        """Of position [m], speed [m/s], swing [rad] and its rate [rad/s]; shape (4,).

        When half of the time is over, all that noise could ever allow.
        """
        swing = self._settings.settle_swing
        if self._seen - self._begun > 0.5 * self._settings.settle_timeout:
            return np.maximum(_MOST, [0.0, 0.0, swing, 3.0 * swing])
        least = np.array([*_LEAST, swing, 3.0 * swing])
        return np.maximum(least, np.minimum(_WITHIN * self.noise, _MOST))

    def see(self, now: float, target: Vector, m: Motion) -> Settled:
        """Take where everything is; how it stands.

        Parameters
        ----------
        now : float
            [s]
        target : tuple of float
            x, y and height of the start [m].
        m : Motion
        """
        if now - self._seen > _INTERRUPTED:
            self.begin(now)
        self._seen = now
        errors = np.array([m.plane(axis) for axis in range(self._axes)])
        errors[:, 0] -= target[: self._axes]
        self._measure(now, errors)
        waits_for = self._lacking(errors, m, target)
        if waits_for:
            self._moving = now
        return Settled(
            not waits_for and now - self._moving >= self._settings.settle_time,
            waits_for,
            now - self._begun > self._settings.settle_timeout,
        )

    def _lacking(self, errors: Array, m: Motion, target: Vector) -> str:
        words = [
            f"{name}{where} {error:.2f} {unit} (tolerance {most:.2f})"
            for where, row in zip(("", " in y"), errors, strict=False)
            for name, unit, error, most in zip(_NAMES, _UNITS, row, self.tolerances, strict=True)
            if not abs(error) < most
        ]
        if self._axes == 1 and not abs(m.across) < _ACROSS:
            words.append(f"distance from the track {m.across:.2f} m (tolerance {_ACROSS})")
        if not abs(m.height - target[2]) < _HEIGHT:
            words.append(f"height {m.height - target[2]:.2f} m off (tolerance {_HEIGHT})")
        return ", ".join(words)

    def _measure(self, now: float, errors: Array) -> None:
        """Take the noise from how it moves where it should be at rest."""
        if not (np.abs(errors[:, :2]) < _NEAR).all():
            self._far = now
            self._samples.clear()
        if now - self._far < _CALM:
            return
        if self._samples and now - self._samples[-1][0] < _PERIOD - 1e-9:
            return
        self._samples.append((now, errors.ravel()))
        while now - self._samples[0][0] > _MEMORY:
            self._samples.popleft()
        if now - self._samples[0][0] >= _ENOUGH:
            times = np.array([time - now for time, _ in self._samples])
            values = np.array([sample for _, sample in self._samples])
            creep = np.vander(times, 2)  # what comes to rest slowly is no noise
            rest = values - creep @ np.linalg.lstsq(creep, values)[0]
            rest -= np.median(rest, axis=0)
            spread = np.median(np.abs(rest), axis=0).reshape(errors.shape)
            self.noise = _MAD * spread.max(axis=0)
