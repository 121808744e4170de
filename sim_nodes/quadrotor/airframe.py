"""What vehicles are made of: two of them, as numbers with their sources."""

from __future__ import annotations

import math
from typing import NamedTuple

from iolspi_ros.errors import check_range

G = 9.81
"""Gravitational acceleration [m/s²]."""


class Airframe(NamedTuple):
    """A quadrotor with its rotors at the corners of a square, nose between two of them.

    Seen from above: front left, front right, rear right, rear left; the first turns clockwise, so
    that the air turns the body counter-clockwise.
    """

    mass: float  # [kg]
    inertia_x: float  # about the axis ahead [kg m²]
    inertia_y: float  # to the left
    inertia_z: float  # upwards
    arm: float  # from the centre to a rotor [m]
    thrust: float  # of a rotor over its speed squared [N s²]
    torque: float  # the same of its drag [N m s²]
    rotor_time: float  # in which a rotor follows its command [s]
    rotor_low: float  # slowest and fastest [rad/s]
    rotor_high: float
    drag_across: float  # of the air over mass, across the rotors' axis [1/s]
    drag_along: float  # and along it [1/s]

    @property
    def hover(self) -> float:
        """Speed of each rotor that carries the vehicle alone [rad/s]."""
        return math.sqrt(self.mass * G / (4.0 * self.thrust))


class Payload(NamedTuple):
    """A load on an inextensible cable without mass, tied to the vehicle's centre of mass."""

    mass: float = 0.06  # [kg]
    length: float = 1.0  # [m]: T Table 2
    drag: float = 0.02  # of the air over mass [1/s]


AR_DRONE_2 = Airframe(
    mass=0.42, inertia_x=2.237568e-3, inertia_y=2.985236e-3, inertia_z=4.80374e-3, arm=0.1785,
    thrust=8.048e-6, torque=2.423e-7, rotor_time=0.04, rotor_low=125.7, rotor_high=502.7,
    drag_across=0.25, drag_along=0.25,
)  # fmt: skip
"""Parrot AR.Drone 2.0. Mass: T 6-3-1. Inertia, arm, thrust and torque: Q. Li, Grey-Box System
Identification of a Quadrotor Unmanned Aerial Vehicle, MSc thesis, TU Delft, 2014. Speeds: 10,350
to 41,400 /min of the motors (P.-J. Bristeau et al., The Navigation and Control Technology inside
the AR.Drone Micro UAV, IFAC 2011) through a gear of 8.625 (Li). The rotors' time and the drag are
chosen here."""

UTILITY = Airframe(
    mass=1.5, inertia_x=0.0217, inertia_y=0.0217, inertia_z=0.040, arm=0.25,
    thrust=1.3e-5, torque=2.1e-7, rotor_time=0.04, rotor_low=100.0, rotor_high=900.0,
    drag_across=0.1, drag_along=0.1,
)  # fmt: skip
"""The 1.5 kg of the embedded autopilot, with its drag and the lag of its thrust; the rest is
chosen here, as usual for that mass."""

AIRFRAMES = {"ar_drone_2": AR_DRONE_2, "utility": UTILITY}

LOAD_SHARE = 0.5
"""Of the vehicle's mass: with more, it hangs on its load."""


def check_payload(airframe: Airframe, payload: Payload, name: str = "load") -> None:
    """Raise unless the vehicle can carry this.

    Raises
    ------
    InputError
        Naming the field, its value and what is allowed.
    """
    check_range(f"mass of the {name} [kg]", payload.mass, 0.0, LOAD_SHARE * airframe.mass,
                low_open=True)  # fmt: skip
    check_range(f"length of the cable of the {name} [m]", payload.length, 0.1, 20.0)
    check_range(f"drag of the {name} [1/s]", payload.drag, 0.0, 10.0)
