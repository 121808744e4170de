"""The wire format: rows of named numbers, states, and their stamps. The one place for it.

A row is a std_msgs/Float64MultiArray whose one dimension is labelled with the names of its
entries, separated by commas. Rows are read by name, so entries may come in another order and
more may be there. `docs/interfaces.md` is the contract.
"""

from __future__ import annotations

import array
from collections.abc import Sequence
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iolspi_ros.core.samples import Observation, Sample, Transition
from iolspi_ros.errors import InputError

NANOSECONDS = 1_000_000_000
KEY = ("episode", "step", "sec", "nanosec")

REWARD = (*KEY, "reward", "terminated", "truncated", "action")
ACTION = (*KEY, "action", "source")
SCORE = (*KEY, "score", "discounted_return", "explored")
UPDATE = (
    *KEY, "number", "accepted", "weights_norm", "change", "epsilon",
    "condition", "rank", "residual", "samples", "online_steps",
    "status", "iterations", "stop", "delta", "rungs", "doubted",
)  # fmt: skip
DEMONSTRATION = (*KEY, "active", "samples")


@cache
def _messages() -> Any:
    """Message types, imported when first used: reading bags needs none of them."""
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

    return SimpleNamespace(
        JointState=JointState,
        Array=Float64MultiArray,
        Dimension=MultiArrayDimension,
        Layout=MultiArrayLayout,
    )


def state_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Names of a state's entries: position and velocity of each joint in turn."""
    return tuple(f"{joint}.{part}" for joint in joints for part in ("position", "velocity"))


def sample_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Names of a sample's entries."""
    state = state_names(joints)
    following = tuple(f"next.{name}" for name in state)
    return (*KEY, *state, "action", "reward", *following, "terminated", "truncated", "source")


class Rows:
    """Writes and reads rows with given names.

    Parameters
    ----------
    what : str
        What the rows are, for messages to people.
    names : sequence of str
        Names of the entries; those in `KEY` come first.
    """

    def __init__(self, what: str, names: Sequence[str]) -> None:
        self.what = what
        self.names = tuple(names)
        self.label = ",".join(self.names)
        self._layout: Any = None
        self._columns: dict[str, list[int] | None] = {self.label: None}

    def message(self, *values: float) -> Any:
        """A std_msgs/Float64MultiArray of `values`, in the order of the names."""
        types = _messages()
        if self._layout is None:
            n = len(self.names)
            dimension = types.Dimension(label=self.label, size=n, stride=n)
            self._layout = types.Layout(dim=[dimension], data_offset=0)
        if len(values) != len(self.names):
            raise ValueError(f"{len(values)} values for {self.what}; names: {self.label}")
        # array("d") turns whatever numbers come in into the doubles that rclpy does not check.
        return types.Array(layout=self._layout, data=array.array("d", values))

    def read(self, message: Any) -> Sequence[float]:
        """Values in the order of the names, whatever their order in the message.

        Raises
        ------
        InputError
            When a name is missing or the data are shorter than the label says.
        """
        dims = message.layout.dim
        label = dims[0].label if len(dims) else ""
        if label not in self._columns:
            self._columns[label] = self._find(label)
        data = message.data
        if len(data) != label.count(",") + 1:
            raise InputError(f"{self.what} has {len(data)} entries for the label {label!r}")
        columns = self._columns[label]
        return data if columns is None else [data[column] for column in columns]

    def _find(self, label: str) -> list[int]:
        found = label.split(",")
        missing = [name for name in self.names if name not in found]
        if missing:
            raise InputError(
                f"{self.what} has no entry {', '.join(missing)} in its label {label!r}; "
                f"allowed: {self.label}"
            )
        return [found.index(name) for name in self.names]


class RewardRows(Rows):
    """Rows of what an observation says beside its state."""

    def __init__(self) -> None:
        super().__init__("reward", REWARD)

    def of(self, observation: Observation) -> Any:
        """Message of an observation."""
        o = observation
        return self.message(
            o.episode, o.step, *split(o.stamp), o.reward, o.terminated, o.truncated, o.action
        )

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
        )


class SampleRows(Rows):
    """Rows of whole transitions."""

    def __init__(self, joints: Sequence[str]) -> None:
        super().__init__("sample", sample_names(joints))
        self.n_dims = 2 * len(joints)

    def of(self, sample: Sample) -> Any:
        """Message of a sample."""
        t = sample.transition
        return self.message(
            sample.episode, sample.step, *split(sample.stamp), *t.state, t.action, t.reward,
            *t.next_state, t.terminated, t.truncated, sample.source,
        )  # fmt: skip

    def sample(self, message: Any) -> Sample:
        """Sample of a message.

        Raises
        ------
        InputError
            When it is not a sample of these joints.
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


def state_message(joints: Sequence[str], state: NDArray[np.float64], stamp: int) -> Any:
    """A sensor_msgs/JointState of a state [q_1, q̇_1, q_2, …] at a stamp [ns]."""
    message = _messages().JointState()
    return fill_state(message, joints, state, stamp)


def fill_state(message: Any, joints: Sequence[str], state: NDArray[np.float64], stamp: int) -> Any:
    """Put a state into a message that was made before, which saves most of making one."""
    values = state.tolist()
    message.name = list(joints)
    message.position = array.array("d", values[0::2])
    message.velocity = array.array("d", values[1::2])
    message.header.stamp.sec, message.header.stamp.nanosec = split(stamp)
    return message


def read_state(joints: Sequence[str], message: Any) -> tuple[NDArray[np.float64], int]:
    """State and stamp [ns] of a sensor_msgs/JointState; joints are found by name.

    Raises
    ------
    InputError
        When a joint is missing or has no position or velocity.
    """
    names = list(message.name)
    if names != list(joints):
        missing = [joint for joint in joints if joint not in names]
        if missing:
            raise InputError(
                f"state has joints {names}, not {', '.join(missing)}; allowed: {list(joints)}"
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
    """Weights and the number of their update."""
    actions, size = (dimension.size for dimension in message.layout.dim)
    return np.array(message.data[1:]).reshape(actions, size), int(message.data[0])
