"""Where the load is: heard of from a second system, or told from the quadrotor's acceleration."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sim_nodes.tasks.base import G

Array = NDArray[np.float64]

_STEP = 0.02  # longest step of the integration [s]
_UPWARDS = np.array([0.0, 0.0, G])
_CABLE, _RATE, _OFFSET, _DRAG = slice(0, 3), slice(3, 6), slice(6, 8), 8
_SIZE = 9
_STILL = (0.05, 0.1)  # deviations of a load that hangs still: direction, and its rate [1/s]
_GUST = 0.3  # of accelerations that nobody measures, per sqrt(Hz) [m/s²], unless told otherwise
_BIAS = (0.1, 0.05, 0.1)  # of an accelerometer: deviation [m/s²]; how it walks, in all and by drag
_AIR = (0.5, 0.6, 0.07)  # drag over mass where nothing is known, deviation, how it walks [1/s]
_SLOW = 0.7  # slower than that nothing is learned of the drag [m/s]
_SHAKING = (0.03, 0.3, 3.0)  # noise of an accelerometer: least, at first, greatest [m/s²]
_MASS = 0.2  # deviation of the load's mass from what it is thought to be, as a share of it
_LEARNING = 0.01  # share of it that is learned with each sample
_ODD = 25.0  # squared deviations beyond which a sample is no news of the load


class LoadObserver:
    """Where the cable points to, by an extended Kalman filter on the spherical pendulum.

    It is carried along by the quadrotor's changes of velocity, which telemetry measures, and
    corrected by what is measured of the load: a direction that a feed tells, or the cable's pull
    that an accelerometer feels across the rotors' axis (`feel`), where nothing but the air pulls
    besides. Without either it is the swing that a load would have which hung still at `still`; a
    slight damping lets what was not known of it fade. In one plane it is T Eq. 18.

    Its state is direction and rate of the cable, the accelerometer's offset in the horizontal
    (which steady wind is, too), and the air's drag; its covariance is kept to what can turn.

    Parameters
    ----------
    cable : float
        Its length [m].
    share : float
        Mass of the load over that of the vehicle, for `feel`.
    feed_noise : float
        Standard deviation of a measured angle [rad].
    gust : float
        Standard deviation of accelerations that nobody measures, per sqrt(Hz) [m/s²].
    damping : float
        [1/s].

    Attributes
    ----------
    direction, rate : ndarray of shape (3,)
        Unit vector from the quadrotor to the load, and its rate [1/s].
    covariance : ndarray of shape (9, 9)
        Of direction, rate, offset [m/s²] and drag [1/s].
    gust : float
        As above; it may change.

    References
    ----------
    T IV-B, Eq. 18.
    """

    def __init__(
        self,
        cable: float,
        share: float = 0.0,
        feed_noise: float = 0.02,
        gust: float = _GUST,
        damping: float = 0.05,
    ) -> None:
        self._cable, self._share, self._noise = cable, share, feed_noise**2
        self._damping, self.gust = damping, gust
        self._offset, self._drag = np.zeros(2), _AIR[0]
        self._shaking = _SHAKING[1] ** 2
        self.covariance = np.diag([*[0.0] * 6, *[_BIAS[0] ** 2] * 2, _AIR[1] ** 2])
        self.still()

    @property
    def drag(self) -> float:
        """Of the air over the vehicle's mass, as far as it was felt [1/s]."""
        return float(self._drag)

    def still(self) -> None:
        """The load hangs still, as far as we know."""
        self.direction, self.rate = np.array([0.0, 0.0, -1.0]), np.zeros(3)
        self.covariance[:6], self.covariance[:, :6] = 0.0, 0.0
        level = np.array([1.0, 1.0, 0.0])
        self.covariance[:6, :6] = np.diag([*_STILL[0] ** 2 * level, *_STILL[1] ** 2 * level])

    # ------------------------------------------------------------ time passes

    def move(self, acceleration: Array, dt: float, gust: float | None = None) -> None:
        """Let time pass while the quadrotor accelerates [m/s²], shape (3,), for some time [s].

        `gust` is of what is not measured of that, if it is not as usual.
        """
        n = max(1, math.ceil(dt / _STEP))
        spread = ((self.gust if gust is None else gust) / self._cable) ** 2
        for _ in range(n):
            self._spread(acceleration, dt / n, spread)
            self._advance(acceleration, dt / n)
        walk = _BIAS[1] + _BIAS[2] * abs(self._drag)
        self.covariance[_OFFSET, _OFFSET] += walk**2 * dt * np.eye(2)
        self.covariance[_DRAG, _DRAG] += _AIR[2] ** 2 * dt

    def _advance(self, acceleration: Array, h: float) -> None:
        """A step: u'' = -|u'|² u - (b - (b · u) u) / L - c u', with b = a + g upwards.

        What goes along u is left to `_turn`, which keeps its length.
        """
        pull = acceleration + _UPWARDS
        self.rate = self.rate - h * (pull / self._cable + self._damping * self.rate)
        self._turn(h)

    def _spread(self, acceleration: Array, h: float, gust: float) -> None:
        """The same of small errors, and what nobody measures."""
        u, pull = self.direction, acceleration + _UPWARDS
        jacobian = np.eye(_SIZE)
        jacobian[_CABLE, _RATE] = h * np.eye(3)
        stiffness = float(pull @ u) * np.eye(3) + np.outer(u, pull)
        jacobian[_RATE, _CABLE] = h / self._cable * stiffness
        jacobian[_RATE, _RATE] -= self._damping * h * np.eye(3)
        self.covariance = jacobian @ self.covariance @ jacobian.T
        self.covariance[_RATE, _RATE] += gust * h * np.eye(3)
        self._flatten()

    def _flatten(self) -> None:
        """Neither direction nor rate can err along the cable."""
        across = np.eye(_SIZE)
        across[_CABLE, _CABLE] -= np.outer(self.direction, self.direction)
        across[_RATE, _RATE] = across[_CABLE, _CABLE]
        self.covariance = across @ (0.5 * (self.covariance + self.covariance.T)) @ across

    def _turn(self, h: float) -> None:
        """Turn by the rate for a time [s]: along a great circle, so it stays a unit vector."""
        u = self.direction
        self.rate = self.rate - float(self.rate @ u) * u
        speed = float(np.linalg.norm(self.rate))
        if speed > 0.0:
            sine, cosine = math.sin(speed * h), math.cos(speed * h)
            self.direction = cosine * u + sine / speed * self.rate
            self.rate = cosine * self.rate - speed * sine * u

    # ------------------------------------------------------------ what is measured

    def measure(self, offset: Array) -> None:
        """Take where the load was measured to be from the quadrotor [m], shape (3,)."""
        u = self.direction
        axis = np.cross(u, offset)
        size = float(np.linalg.norm(axis))
        angle = math.atan2(size, float(u @ offset))
        error = angle / size * np.cross(axis, u) if size > 0.0 else np.zeros(3)
        slopes = np.zeros((3, _SIZE))
        slopes[:, _CABLE] = np.eye(3)
        self._correct(error, slopes, self._noise)

    def feel(self, force: Array, axes: Array, velocity: Array) -> None:
        """Take what an accelerometer measures: what pulls at the vehicle across its rotors' axis.

        That is the cable, with the load's mass over the vehicle's times what it holds, and the air.
        How much the accelerometer shakes is learned from what it surprises by.

        Parameters
        ----------
        force : ndarray of shape (3,)
            Acceleration less gravity [m/s²].
        axes : ndarray of shape (2, 3)
            Unit vectors across the rotors' axis, along which it is looked at.
        velocity : ndarray of shape (3,)
            Of the vehicle [m/s].
        """
        u, rate = self.direction, self.rate
        holds = float(rate @ rate) * self._cable - float(force @ u)
        if not self._share or holds <= 0.0:
            return
        across = axes @ u
        expected = self._share * holds * across + axes[:, :2] @ self._offset
        expected -= self._drag * (axes @ velocity)
        slopes = np.zeros((2, _SIZE))
        slopes[:, _CABLE] = self._share * (holds * axes - np.outer(across, force))
        slopes[:, _RATE] = 2.0 * self._share * self._cable * np.outer(across, rate)
        slopes[:, _OFFSET] = axes[:, :2]
        if float(velocity @ velocity) > _SLOW**2:  # else a noisy speed would be taken for the air
            slopes[:, _DRAG] = -axes @ velocity
        error = axes @ force - expected
        surprise = float(error @ error)
        known = float(np.trace(slopes @ self.covariance @ slopes.T))
        noise = self._shaking + (_MASS * self._share * holds) ** 2 * float(across @ across)
        if surprise <= _ODD * (known + 2.0 * noise):  # else a bump
            self._correct(error, slopes, noise)
        shaking = self._shaking + _LEARNING * (0.5 * (surprise - known) - self._shaking)
        self._shaking = min(max(shaking, _SHAKING[0] ** 2), _SHAKING[2] ** 2)

    def _correct(self, error: Array, slopes: Array, noise: float) -> None:
        """The filter's correction by an error, with how it depends on the state."""
        spread = self.covariance @ slopes.T
        gain = spread @ np.linalg.inv(slopes @ spread + noise * np.eye(len(error)))
        change = gain @ error
        keep = np.eye(_SIZE) - gain @ slopes
        self.covariance = keep @ self.covariance @ keep.T + noise * gain @ gain.T  # Joseph's form
        rate = self.rate + change[_RATE]
        self.rate = change[_CABLE]
        self._turn(1.0)
        self.rate = rate - float(rate @ self.direction) * self.direction
        self._offset = self._offset + change[_OFFSET]
        self._drag = max(self._drag + change[_DRAG], 0.0)
        self._flatten()

    def ahead(self, acceleration: Array, dt: float) -> tuple[Array, Array]:
        """Direction and rate a moment later, nothing kept."""
        kept = self.direction, self.rate
        n = max(1, math.ceil(dt / _STEP))
        for _ in range(n):
            self._advance(acceleration, dt / n)
        result = self.direction, self.rate
        self.direction, self.rate = kept
        return result


class Fall:
    """Follows a load that was let go until it crosses the rim's plane.

    Parameters
    ----------
    plane : float
        Height of the rim [m], in the heights' frame of `see`.
    reach : float
        How far below the vehicle a load on the cable is seen at most [m].
    """

    def __init__(self, plane: float, reach: float) -> None:
        self.plane, self._reach = plane, reach
        self.fell = False
        """Whether it was seen lower than the cable lets it be."""
        self._before: Array | None = None
        self.landing: Array | None = None
        """(along, across) where it crossed the plane from above [m]; None as long as it has not."""
        self.lowest = math.inf
        """Least height seen [m]."""

    def see(self, place: Array, height: float) -> None:
        """Take the load's position: along, across, height; and the vehicle's height [m]."""
        before, self._before = self._before, place
        self.fell |= bool(place[2] < height - self._reach)
        self.lowest = min(self.lowest, float(place[2]))
        if before is None or self.landing is not None:
            return
        if before[2] >= self.plane > place[2]:
            part = (before[2] - self.plane) / (before[2] - place[2])
            self.landing = (before + part * (place - before))[:2]
