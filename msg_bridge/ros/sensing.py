"""What a robot's topics said last, made one state: with rates by differences, and with its age."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from iolspi_ros.errors import InputError
from iolspi_ros.task import Variable
from msg_bridge.ros.description import Robot, Source
from msg_bridge.ros.fields import yaw

NANOSECONDS = 1_000_000_000


@dataclass
class _Latest:
    """A variable as it was heard last.

    Attributes
    ----------
    value : float
    heard : int
        When [ns]; -1 for never.
    stamp : int
        Of the message [ns], by the sender's clock.
    """

    value: float = math.nan
    heard: int = -1
    stamp: int = -1


class Sensing:
    """Keeps the newest of each variable.

    Parameters
    ----------
    robot : Robot
    """

    def __init__(self, robot: Robot) -> None:
        # The variables first, in their order, so that a place here is one in the state.
        self._sources = (*robot.sources, *robot.inputs)
        inputs = tuple(Variable(source.variable) for source in robot.inputs)
        self._variables = (*robot.task.variables, *inputs)
        self._max_age = round(robot.max_age * NANOSECONDS)
        self._places = {variable.name: n for n, variable in enumerate(self._variables)}
        self._count = robot.task.n_dims
        self.restart()

    def restart(self) -> None:
        """Forget all: the robot was put somewhere else."""
        self._latest = [_Latest() for _ in self._sources]

    def hear(self, topic: str, message: Any, now: int) -> list[int]:
        """Take a message of a topic, at a time [ns]; places in the state that it says.

        Raises
        ------
        InputError
            When it lacks a field, or has no number there.
        """
        stamp, said = _stamp(message, now), []
        for place, source in enumerate(self._sources):
            if source.topic != topic:
                continue
            value = self._value(source, self._variables[place], message)
            self._difference(place, value, stamp, now)
            self._latest[place] = _Latest(value, now, stamp)
            if place < self._count:
                said.append(place)
        return said

    def _value(self, source: Source, variable: Variable, message: Any) -> float:
        assert source.path is not None
        value = yaw(source.path.get(message)) if source.is_yaw else source.path.number(message)
        return _wrapped(source.scale * value + source.offset, variable)

    def _difference(self, base: int, value: float, stamp: int, now: int) -> None:
        """Update the rates of a variable, before its new value is kept."""
        before = self._latest[base]
        for place, source in enumerate(self._sources):
            if source.rate_of != self._variables[base].name or before.heard < 0:
                continue
            dt = (stamp - before.stamp) / NANOSECONDS
            if dt <= 0.0:  # said twice, or the sender's clock was put back
                continue
            step = _shortest(value - before.value, self._variables[base])
            rate, latest = source.scale * step / dt, self._latest[place]
            if latest.heard >= 0:
                share = dt / (source.filter_time + dt)
                rate = latest.value + share * (rate - latest.value)
            self._latest[place] = _Latest(rate, now, stamp)

    def value(self, place: int) -> float:
        """A variable as it was heard last."""
        return self._latest[place].value

    def state(self, now: int) -> list[float]:
        """The state at a time [ns].

        Raises
        ------
        InputError
            Which variable is missing, or too old, or cannot be computed.
        """
        for place, latest in enumerate(self._latest):
            if self._sources[place].expression:
                continue
            age = now - latest.heard
            if latest.heard < 0 or age >= self._max_age or not math.isfinite(latest.value):
                raise InputError(self._why(place, latest, age))
        values = [latest.value for latest in self._latest]
        said = dict(zip(self._places, values, strict=True))
        for place, source in enumerate(self._sources):
            if source.expression:
                value = source.expression.number(said)
                values[place] = _wrapped(value, self._variables[place])
        return values[: self._count]

    def _why(self, place: int, latest: _Latest, age: int) -> str:
        source = self._sources[place]
        origin = self._sources[self._places[source.rate_of]] if source.rate_of else source
        where = f"{self._variables[place].name} (from {origin.topic or origin.rate_of})"
        if latest.heard < 0:
            return f"{where} was never heard"
        if not math.isfinite(latest.value):
            return f"{where} is {latest.value}"
        oldest = self._max_age / NANOSECONDS
        return f"{where} is {age / NANOSECONDS:.3f} s old; allowed: less than {oldest:g} s"


def _stamp(message: Any, now: int) -> int:
    """When a message was made, by its header; when it was heard, if it has none."""
    header = getattr(message, "header", None)
    if header is None:
        return now
    stamp = header.stamp.sec * NANOSECONDS + header.stamp.nanosec
    return stamp or now


def _wrapped(value: float, variable: Variable) -> float:
    if not variable.periodic:
        return value
    return (value - variable.low) % (variable.high - variable.low) + variable.low


def _shortest(step: float, variable: Variable) -> float:
    if not variable.periodic:
        return step
    period = variable.high - variable.low
    return (step + period / 2) % period - period / 2
