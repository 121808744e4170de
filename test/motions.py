"""Motions of a vehicle by the numbers that tests are about."""

import math

from msg_bridge.mavlink.motion import Motion


def swung(angle, rate=0.0, axis=0):
    """Fields of a `Motion` with a cable that swings in the plane of one axis [rad], [rad/s]."""
    cable, turning = [0.0, 0.0, -math.cos(angle)], [0.0, 0.0, rate * math.sin(angle)]
    cable[axis], turning[axis] = math.sin(angle), rate * math.cos(angle)
    return {"cable": tuple(cable), "cable_rate": tuple(turning)}


def leaning(angle):
    """Fields of a `Motion` whose rotors lean along x [rad]."""
    return {"up": (math.sin(angle), 0.0, math.cos(angle))}


def moved(motion, swing=None, swing_rate=0.0, tilt=None, **fields):
    """A motion with some of these changed."""
    if swing is not None or swing_rate:
        fields |= swung(swing or 0.0, swing_rate)
    if tilt is not None:
        fields |= leaning(tilt)
    return motion._replace(**fields)


def moving(**fields):
    """A motion with some of these."""
    return moved(Motion(), **fields)
