"""How the vehicle answers its sticks: measured, for documents and tests."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_nodes.quadrotor.airframe import Airframe, Payload
from sim_nodes.quadrotor.body import CABLE, ROTORS, hovering
from sim_nodes.quadrotor.cable import GONE
from sim_nodes.quadrotor.control import (
    ACCELERATION,
    ATTITUDE,
    MEMORY,
    VELOCITY,
    Gains,
    begin,
    heading_of,
)
from sim_nodes.quadrotor.flight import STEP, fly_all

Array = NDArray[np.float64]

CHANNELS = {
    "lean": (ATTITUDE, 0, 0.1), "velocity": (VELOCITY, 0, 1.0),
    "climb": (ACCELERATION, 2, 0.5), "turn": (ACCELERATION, 3, 0.5),
}  # fmt: skip
"""Mode, stick and step [rad, m/s, m/s, rad/s] of each answer that is measured."""


class Response(NamedTuple):
    """An answer to a step of a stick.

    Attributes
    ----------
    rise : float
        From 10 % to 90 % [s].
    overshoot : float
        Beyond what was asked for, as a share of it.
    bandwidth : float
        Frequency at which the answer has fallen by 3 dB [Hz].
    """

    rise: float
    overshoot: float
    bandwidth: float


def measure(channel: str, frame: Airframe, payload: Payload | None, time: float = 8.0) -> Response:
    """How a hovering vehicle, with or without its load, answers one step.

    Parameters
    ----------
    channel : str
        One of `CHANNELS`.
    frame : Airframe
    payload : Payload, optional
    time : float
        Watched [s].
    """
    mode, stick, size = CHANNELS[channel]
    state = hovering(frame, payload or Payload(), (0.0, 0.0, 10.0))
    if payload is None:
        state[CABLE], state[ROTORS] = GONE, frame.hover
    memory = np.zeros(MEMORY)
    begin(state, payload.mass / frame.mass if payload else 0.0, memory)
    sticks = np.zeros((1, 4))
    sticks[0, stick] = size
    answer = np.empty(round(time / STEP))
    for k in range(len(answer)):
        fly_all(
            state[None], memory[None], mode, sticks, np.zeros(3), Gains(), frame,
            payload or Payload(), 1,
        )  # fmt: skip
        answer[k] = _read(channel, state) / size
    first, last = np.argmax(answer > 0.1), np.argmax(answer > 0.9)
    return Response(
        float(last - first) * STEP, max(float(answer.max()) - 1.0, 0.0), _bandwidth(answer)
    )


def _read(channel: str, state: Array) -> float:
    w, x, y, z = state[6:10]
    if channel == "lean":
        return float(np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)))
    nose = heading_of(state)
    ahead = np.cos(nose) * state[3] + np.sin(nose) * state[4]
    return float({"velocity": ahead, "climb": state[5], "turn": state[12]}[channel])


def _bandwidth(answer: Array) -> float:
    """From the spectrum of the answer to an impulse, which the step's rate of change is [Hz]."""
    gain = np.abs(np.fft.rfft(np.diff(answer, prepend=0.0), 1 << 16))
    below = gain < gain[0] / np.sqrt(2.0)
    frequencies = np.fft.rfftfreq(1 << 16, STEP)
    return float(frequencies[np.argmax(below)])
