"""The wire format: tasks, states, rows of named numbers, and stamps. The one place for it.

The task travels as JSON in a std_msgs/String. A state is a sensor_msgs/JointState where it is the
position and velocity of joints, and a row otherwise. A row is a std_msgs/Float64MultiArray whose
one dimension is labelled with the names of its entries, separated by commas. Rows are read by
name, so entries may come in another order and more may be there. `docs/interfaces.md` is the
contract.
"""

from __future__ import annotations

import array
from collections.abc import Mapping, Sequence
from enum import IntEnum
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros import cdr
from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.errors import InputError
from iolspi_ros.task import TaskDescription, dump, load

NANOSECONDS = 1_000_000_000
ROW = "std_msgs/msg/Float64MultiArray"
KEY = ("episode", "step", "sec", "nanosec")

REWARD = (*KEY, "reward", "terminated", "truncated", "action", "source")
ACTION = (*KEY, "action", "source")
SCORE = (*KEY, "score", "discounted_return", "explored", "interventions")
UPDATE = (
    *KEY, "number", "accepted", "healthy", "weights_norm", "change", "epsilon", "samples",
    "online_steps",
)  # fmt: skip
"""Behind these comes what the learner itself has to say, under its own names."""
DEMONSTRATION = (*KEY, "active", "samples")
TAKEOVER = (*KEY, "held")
PILOTING = (*KEY, "phase", "kept", "discarded", "countdown", "held", "n_episodes")
VERDICT = (*KEY, "kept")
HELP = (*KEY, "asks", "unsure", "vetoes")


class Phase(IntEnum):
    """What a demonstration by joystick waits for: `phase` of `piloting`."""

    NO_STICK = 0
    WAITING = 1
    COUNTDOWN = 2
    FLYING = 3
    REVIEW = 4
    ENDED = 5
    PAUSED = 6


@cache
def _messages() -> Any:
    """Message types, imported when first used: reading bags needs none of them."""
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout, String

    return SimpleNamespace(
        JointState=JointState,
        Array=Float64MultiArray,
        Dimension=MultiArrayDimension,
        Layout=MultiArrayLayout,
        String=String,
    )


def sample_names(variables: Sequence[str]) -> tuple[str, ...]:
    """Names of a sample's entries."""
    after = tuple(f"next.{name}" for name in variables)
    return (*KEY, *variables, "action", "reward", *after, "terminated", "truncated", "source")


class Rows:
    """Writes and reads rows with given names.

    Parameters
    ----------
    what : str
        What the rows are, for messages to people.
    names : sequence of str
        Names of the entries; those in `KEY` come first.
    absent : mapping of str to float, optional
        What entries are where a message does not have them; the others it must have.
    """

    def __init__(
        self, what: str, names: Sequence[str], absent: Mapping[str, float] | None = None
    ) -> None:
        self.what = what
        self.names = tuple(names)
        self._absent = dict(absent or {})
        self.label = ",".join(self.names)
        self.kind = ROW
        self._layout: Any = None
        self._bytes = cdr.RowBytes(self.label, len(self.names))
        self._columns: dict[str, list[int] | None] = {self.label: None}

    def message(self, *values: float) -> Any:
        """A std_msgs/Float64MultiArray of `values`, in the order of the names."""
        types = _messages()
        if self._layout is None:
            n = len(self.names)
            dimension = types.Dimension(label=self.label, size=n, stride=n)
            self._layout = types.Layout(dim=[dimension], data_offset=0)
        return types.Array(layout=self._layout, data=self._doubles(values))

    def pack(self, *values: float) -> bytes:
        """The same, serialised."""
        return self._bytes.pack(self._doubles(values))

    def _doubles(self, values: Sequence[float]) -> array.array[float]:
        if len(values) != len(self.names):
            raise ValueError(f"{len(values)} values for {self.what}; names: {self.label}")
        # Turns whatever numbers come in into the doubles that rclpy does not check.
        return array.array("d", values)

    def read(self, message: Any) -> Sequence[float]:
        """Values in the order of the names, whatever their order in the message.

        Parameters
        ----------
        message : std_msgs/Float64MultiArray, or bytes
            The message itself, or serialised.

        Raises
        ------
        InputError
            When a name is missing or the data are shorter than the label says.
        """
        if isinstance(message, bytes):
            values = self._bytes.unpack(message)
            if values is not None:
                return values
            message = _deserialise(message, _messages().Array)
        dims = message.layout.dim
        label = dims[0].label if len(dims) else ""
        if label not in self._columns:
            self._columns[label] = self._find(label)
        data = message.data
        if len(data) != label.count(",") + 1:
            raise InputError(f"{self.what} has {len(data)} entries for the label {label!r}")
        columns = self._columns[label]
        if columns is None:
            return data
        return [
            self._absent[name] if column < 0 else data[column]
            for name, column in zip(self.names, columns, strict=True)
        ]

    def read_all(self, message: Any) -> dict[str, float]:
        """Every value of a message by its name, also those that are not asked for.

        Raises
        ------
        InputError
            As of `read`.
        """
        self.read(message)
        return dict(zip(message.layout.dim[0].label.split(","), message.data, strict=True))

    def _find(self, label: str) -> list[int]:
        found = label.split(",")
        missing = [n for n in self.names if n not in found and n not in self._absent]
        if missing:
            raise InputError(
                f"{self.what} has no entry {', '.join(missing)} in its label {label!r}; "
                f"allowed: {self.label}"
            )
        return [found.index(name) if name in found else -1 for name in self.names]


class ScoreRows(Rows):
    """Rows of `score`; bags from before say nothing of interventions."""

    def __init__(self) -> None:
        super().__init__("score", SCORE, {"interventions": 0.0})


class RewardRows(Rows):
    """Rows of what an observation says beside its state."""

    def __init__(self) -> None:
        super().__init__("reward", REWARD, {"source": -1.0})

    def of(self, observation: Observation) -> bytes:
        """Serialised message of an observation."""
        o = observation
        return self.pack(
            o.episode, o.step, *split(o.stamp), o.reward, o.terminated, o.truncated, o.action,
            o.source,
        )  # fmt: skip

    def observation(
        self, values: Sequence[float], state: NDArray[np.float64], stamp: int
    ) -> Observation:
        """Observation of a row that `read` gave, and of its state and stamp [ns]."""
        return Observation(
            episode=whole(values[0]),
            step=whole(values[1]),
            state=state,
            reward=float(values[4]),
            action=whole(values[7]),
            terminated=values[5] > 0.5,
            truncated=values[6] > 0.5,
            stamp=stamp,
            source=whole(values[8]),
        )


class SampleRows(Rows):
    """Rows of whole transitions."""

    def __init__(self, variables: Sequence[str]) -> None:
        super().__init__("sample", sample_names(variables))
        self.n_dims = len(variables)

    def of(self, sample: Sample) -> bytes:
        """Serialised message of a sample."""
        t = sample.transition
        return self.pack(
            sample.episode, sample.step, *split(sample.stamp), *t.state, t.action, t.reward,
            *t.next_state, t.terminated, t.truncated, sample.source,
        )  # fmt: skip

    def sample(self, message: Any) -> Sample:
        """Sample of a message.

        Raises
        ------
        InputError
            When it is not a sample of these variables.
        """
        values, d = self.read(message), self.n_dims
        transition = Transition(
            np.array(values[4 : 4 + d], float),
            whole(values[4 + d]),
            float(values[5 + d]),
            np.array(values[6 + d : 6 + 2 * d], float),
            values[6 + 2 * d] > 0.5,
            values[7 + 2 * d] > 0.5,
        )
        stamp = join(values[2], values[3])
        return Sample(whole(values[0]), whole(values[1]), stamp, transition, whole(values[-1]))


def type_name(message: Any) -> str:
    """Name of a message's type, as "std_msgs/msg/Float64MultiArray"."""
    package, _, _ = type(message).__module__.partition(".")
    return f"{package}/msg/{type(message).__name__}"


def _deserialise(data: bytes, kind: Any) -> Any:
    from rclpy.serialization import deserialize_message

    try:
        return deserialize_message(data, kind)
    except RuntimeError as error:  # rclpy's own errors are such
        raise InputError(f"{len(data)} bytes are no {kind.__name__}: {error}") from None


def whole(value: float) -> int:
    """Integer of a float entry; -1 for what is no integer (as NaN)."""
    return int(value) if abs(value) < 2.0**53 and float(value).is_integer() else -1


def split(stamp: int) -> tuple[int, int]:
    """Seconds and nanoseconds of a stamp in nanoseconds."""
    return divmod(stamp, NANOSECONDS)


def join(sec: float, nanosec: float) -> int:
    """Stamp in nanoseconds; -1 when it is none."""
    sec, nanosec = whole(sec), whole(nanosec)
    return sec * NANOSECONDS + nanosec if sec >= 0 and nanosec >= 0 else -1


class JointStates:
    """States that are the position and velocity of each joint in turn.

    Parameters
    ----------
    joints : sequence of str
    """

    kind = "sensor_msgs/msg/JointState"

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._bytes = cdr.JointStateBytes(joints)

    @property
    def type(self) -> Any:
        """Of the messages."""
        return _messages().JointState

    def of(self, observation: Observation) -> bytes:
        """Serialised message of an observation."""
        values = observation.state.tolist()
        return self._bytes.pack(*split(observation.stamp), values[0::2], values[1::2])

    def state(self, message: Any) -> tuple[NDArray[np.float64], int]:
        """State and stamp [ns] of a message, or of its bytes; joints are found by name.

        Raises
        ------
        InputError
            When a joint is missing or has no position or velocity.
        """
        if isinstance(message, bytes):
            found = self._bytes.unpack(message)
            if found is not None:
                sec, nanosec, position, velocity = found
                pairs = [x for pair in zip(position, velocity, strict=True) for x in pair]
                return np.array(pairs), sec * NANOSECONDS + nanosec
            message = _deserialise(message, self.type)
        joints, names = self._joints, list(message.name)
        missing = [joint for joint in joints if joint not in names]
        if missing:
            raise InputError(
                f"state has joints {names}, not {', '.join(missing)}; allowed: {joints}"
            )
        if len(message.position) != len(names) or len(message.velocity) != len(names):
            raise InputError(
                f"state has {len(message.position)} positions and {len(message.velocity)} "
                f"velocities; allowed: {len(names)} of each, one per joint"
            )
        state = np.empty(2 * len(joints))
        for d, joint in enumerate(joints):
            column = names.index(joint)
            state[2 * d] = message.position[column]
            state[2 * d + 1] = message.velocity[column]
        stamp = message.header.stamp
        return state, stamp.sec * NANOSECONDS + stamp.nanosec


class StateRows(Rows):
    """States of any variables."""

    def __init__(self, variables: Sequence[str]) -> None:
        super().__init__("state", (*KEY, *variables))

    @property
    def type(self) -> Any:
        """Of the messages."""
        return _messages().Array

    def of(self, observation: Observation) -> bytes:
        """Serialised message of an observation."""
        o = observation
        return self.pack(o.episode, o.step, *split(o.stamp), *o.state.tolist())

    def state(self, message: Any) -> tuple[NDArray[np.float64], int]:
        """State and stamp [ns] of a message, or of its bytes.

        Raises
        ------
        InputError
            When it is no state of these variables.
        """
        values = self.read(message)
        return np.array(values[len(KEY) :], float), join(values[2], values[3])


def states(task: TaskDescription) -> JointStates | StateRows:
    """How the states of a task travel."""
    return JointStates(task.joints) if task.joints else StateRows(task.names)


def task_message(task: TaskDescription) -> Any:
    """A std_msgs/String of a task description."""
    return _messages().String(data=dump(task))


def read_task(message: Any, where: str) -> TaskDescription:
    """The description in a message.

    Raises
    ------
    InputError
        When it is none.
    """
    return load(message.data, where)


def weights_message(weights: NDArray[np.float64], number: int) -> Any:
    """Weights, shape (n_actions, size), behind one entry that counts the update."""
    types = _messages()
    actions, size = weights.shape
    layout = types.Layout(
        dim=[
            types.Dimension(label="action", size=actions, stride=actions * size),
            types.Dimension(label="feature", size=size, stride=size),
        ],
        data_offset=1,
    )
    return types.Array(layout=layout, data=array.array("d", [number, *weights.ravel()]))


def read_weights(message: Any) -> tuple[NDArray[np.float64], int]:
    """Weights and the number of their update.

    Raises
    ------
    InputError
        When they are none.
    """
    sizes = [dimension.size for dimension in message.layout.dim]
    if len(sizes) != 2 or len(message.data) != 1 + sizes[0] * sizes[1]:
        raise InputError(
            f"weights have dimensions {sizes} and {len(message.data)} entries; allowed: two "
            "dimensions, and the number of the update before the entries"
        )
    return np.array(message.data[1:]).reshape(sizes), whole(message.data[0])
