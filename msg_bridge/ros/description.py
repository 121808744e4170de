"""What a file says of a robot: its task, where variables come from, what actions publish."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

from iolspi_ros import task as tasks
from iolspi_ros.errors import InputError, check_range
from iolspi_ros.task import TaskDescription
from iolspi_ros.task.expressions import Expression
from iolspi_ros.task.rules import Rules, action_values, read_rules
from msg_bridge.ros.fields import Path, message_type

RELIABILITY = ("best_effort", "reliable", "latched")
_OWN = ("inputs", "state", "command", "limits", "allowed", "reset", "max_age", "answer_within")
MOST = 100
"""Topics and fields at most."""


@dataclass(frozen=True)
class Source:
    """Where a variable comes from.

    Attributes
    ----------
    variable : str
    topic, type_name : str
        Empty for one that is the rate of another.
    kind : type
    path : Path
    is_yaw : bool
        The path leads to a quaternion, whose yaw it is.
    scale, offset : float
        The variable is scale times what stands there, plus offset.
    rate_of : str
        Another variable, whose differences it is.
    filter_time : float
        Time constant of those differences' filter [s].
    expression : Expression, optional
        Over the inputs and the variables that topics say, which it is computed from.
    qos : str
    """

    variable: str
    topic: str = ""
    type_name: str = ""
    kind: Any = None
    path: Path | None = None
    is_yaw: bool = False
    scale: float = 1.0
    offset: float = 0.0
    rate_of: str = ""
    filter_time: float = 0.0
    expression: Expression | None = None
    qos: str = "best_effort"


@dataclass(frozen=True)
class Output:
    """What is published for an action.

    Attributes
    ----------
    topic, type_name : str
    kind : type
    fields : tuple of (Path, tuple of float)
        Each with its number for each action.
    constants : tuple of (Path, text, list of texts or number)
        Fields that are the same for each action, such as joint_names.
    qos : str
    """

    topic: str
    type_name: str
    kind: Any
    fields: tuple[tuple[Path, tuple[float, ...]], ...]
    constants: tuple[tuple[Path, Any], ...] = ()
    qos: str = "reliable"

    def message(self, action: int) -> Any:
        """The message of an action."""
        made = self.kind()
        for path, value in self.constants:
            path.set(made, value)
        for path, values in self.fields:
            path.set(made, values[action])
        return made


@dataclass(frozen=True)
class Reset:
    """How an episode begins.

    Attributes
    ----------
    service, topic, type_name : str
        What is called, or where a message is sent; empty for none.
    kind : type
    message : Output, optional
    button : int
        Of `joy`, which a person presses when the robot stands where it is to start; -1 for none.
    settle : float
        Seconds of the neutral action before the first state.
    ready : Expression, optional
        Over the variables: the episode waits until it holds.
    """

    service: str = ""
    type_name: str = ""
    kind: Any = None
    message: Output | None = None
    button: int = -1
    settle: float = 0.5
    ready: Expression | None = None


@dataclass(frozen=True)
class Robot:
    """A robot as its file has it.

    Attributes
    ----------
    task : TaskDescription
    rules : Rules
    inputs : tuple of Source
        What variables are computed from, and is none itself.
    sources : tuple of Source
        In the order of the variables.
    outputs : tuple of Output
    limits : tuple of (float, float)
        Of each variable: outside, the robot is told nothing but the neutral action.
    allowed : mapping of int to Expression
        Over the variables: where it is false the neutral action takes this one's place.
    reset : Reset
    max_age : float
        Seconds after which what a topic said is too old for a state.
    answer_within : float
        Seconds after a state in which it must be answered.
    """

    task: TaskDescription
    rules: Rules
    inputs: tuple[Source, ...]
    sources: tuple[Source, ...]
    outputs: tuple[Output, ...]
    limits: tuple[tuple[float, float], ...]
    allowed: Mapping[int, Expression]
    reset: Reset
    max_age: float
    answer_within: float


def read_robot(path: FilePath) -> Robot:
    """The robot of a file.

    Raises
    ------
    InputError
        Naming the file, the field, its value and what is allowed.
    """
    content = tasks.read_plain(path)
    if not isinstance(content, Mapping):
        raise InputError(
            f"{path} holds no names and values; allowed: a task with state and command"
        )
    described = {key: value for key, value in content.items() if key not in _OWN}
    task, rules = read_rules(described, str(path))
    try:
        return _robot(content, task, rules)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _robot(content: Mapping[str, Any], task: TaskDescription, rules: Rules) -> Robot:
    places = _mapping(content.get("state"), "state")  # of variables, in the robot's topics
    _check_keys(places, task.names, "state", all_of_them=True)
    dt = task.sampling_time
    raw = _mapping(content.get("inputs", {}), "inputs")
    if twice := [name for name in raw if name in task.names]:
        raise InputError(f"inputs has {twice[0]!r}, which is a variable; allowed: another name")
    derived = [
        name for name, said in places.items() if isinstance(said, Mapping) and "expression" in said
    ]
    heard = [*raw, *(name for name in task.names if name not in derived)]
    inputs = tuple(_source(str(name), said, heard) for name, said in raw.items())
    sources = tuple(_source(name, places[name], heard) for name in task.names)
    _check_topics((*inputs, *sources))
    return Robot(
        task, rules, inputs, sources,
        _outputs(content.get("command"), task),
        _limits(content.get("limits", {}), task),
        _allowed(content.get("allowed", {}), task),
        _reset(content.get("reset", {}), task),
        _number(content, "max_age", "the task", dt, 0.0),
        _number(content, "answer_within", "the task", dt / 2, 0.0, dt / 2),
    )  # fmt: skip


# ---------------------------------------------------------------- state


def _source(variable: str, entry: Any, heard: Sequence[str]) -> Source:
    what = f"state of {variable}"
    said = _mapping(entry, what)
    if "expression" in said:
        _check_keys(said, ("expression",), what)
        rule = Expression(said["expression"], heard, f"expression in {what}")
        return Source(variable, expression=rule)
    if "rate_of" in said:
        _check_keys(said, ("rate_of", "filter", "scale"), what)
        if said["rate_of"] not in heard or said["rate_of"] == variable:
            others = ", ".join(name for name in heard if name != variable)
            raise InputError(f"rate_of in {what} is {said['rate_of']!r}; allowed: {others}")
        smooth = _number(said, "filter", what, 0.0, 0.0)
        scale = _constant(said.get("scale", 1.0), f"scale in {what}")
        return Source(variable, rate_of=said["rate_of"], filter_time=smooth, scale=scale)
    _check_keys(said, ("topic", "type", "field", "yaw", "scale", "offset", "qos"), what)
    if ("field" in said) == ("yaw" in said):
        raise InputError(f"{what} must have a field, or a yaw (of a quaternion), and not both")
    kind = message_type(said.get("type"), f"type in {what}")
    return Source(
        variable, _topic(said, what), said["type"], kind,
        Path(said.get("field", said.get("yaw")), kind, f"field in {what}"), "yaw" in said,
        _constant(said.get("scale", 1.0), f"scale in {what}"),
        _constant(said.get("offset", 0.0), f"offset in {what}"),
        qos=_qos(said, what, "best_effort"),
    )  # fmt: skip


def _check_topics(sources: Sequence[Source]) -> None:
    """See that the variables agree on what their topics are."""
    first: dict[str, Source] = {}
    for source in sources:
        other = first.setdefault(source.topic, source)
        for name in ("type_name", "qos"):
            mine, theirs = getattr(source, name), getattr(other, name)
            if source.topic and mine != theirs:
                raise InputError(
                    f"topic {source.topic} has {theirs} in state of {other.variable} and {mine} in "
                    f"state of {source.variable}; allowed: the same"
                )


def _limits(content: Any, task: TaskDescription) -> tuple[tuple[float, float], ...]:
    said = _mapping(content, "limits")
    _check_keys(said, task.names, "limits")
    found = []
    for name in task.names:
        limit = said.get(name, [-math.inf, math.inf])
        if not isinstance(limit, list) or len(limit) != 2:
            raise InputError(f"limits of {name} is {limit!r}; allowed: [lowest, highest]")
        low, high = (_constant(one, f"limits of {name}", finite=False) for one in limit)
        if not low < high:
            raise InputError(f"limits of {name} is {limit!r}; allowed: lowest < highest")
        found.append((low, high))
    return tuple(found)


# ---------------------------------------------------------------- command


def _outputs(content: Any, task: TaskDescription) -> tuple[Output, ...]:
    entries = content if isinstance(content, list) else [content]
    if not 0 < len(entries) <= MOST:
        raise InputError(f"command has {len(entries)} topics; allowed: 1 to {MOST}")
    return tuple(_output(entry, task, "command") for entry in entries)


def _output(entry: Any, task: TaskDescription, what: str) -> Output:
    said = _mapping(entry, what)
    _check_keys(said, ("topic", "type", "fields", "constants", "qos"), what)
    kind = message_type(said.get("type"), f"type in {what}")
    constants = _mapping(said.get("constants", {}), f"constants in {what}")
    fields = _mapping(said.get("fields", {}), f"fields in {what}")
    return Output(
        _topic(said, what), said["type"], kind,
        tuple(_field(text, value, kind, task, what) for text, value in fields.items()),
        tuple(_fixed(text, value, kind, what) for text, value in constants.items()),
        _qos(said, what, "reliable"),
    )  # fmt: skip


def _fixed(text: str, value: Any, kind: Any, what: str) -> tuple[Path, Any]:
    """A field that stays."""
    what = f"constant {text} in {what}"
    path = Path(text, kind, what)
    entries = value if isinstance(value, list) else [value]
    if not all(isinstance(entry, str | bool | int | float) for entry in entries):
        raise InputError(f"{what} is {value!r}; allowed: a text, a number, or a list of such")
    _try(path, kind, value, what)
    return path, value


def _try(path: Path, kind: Any, value: Any, what: str) -> None:
    """See whether a value can be written."""
    try:
        path.set(kind(), value)
    except (TypeError, ValueError, AssertionError, AttributeError) as error:
        raise InputError(f"{what} is {value!r}: {error}; allowed: what the field takes") from None


def _field(
    text: str, value: Any, kind: Any, task: TaskDescription, what: str
) -> tuple[Path, tuple[float, ...]]:
    """A field that is written, and its number for each action, within its limits."""
    what = f"field {text} in {what}"
    said = value if isinstance(value, Mapping) else {"value": value}
    _check_keys(said, ("value", "low", "high"), what)
    path = Path(text, kind, what)
    names = ["action", *action_values(task.actions[0])]
    rule = Expression(said.get("value"), names, what)
    low = _constant(said.get("low", -math.inf), f"low of {what}", finite=False)
    high = _constant(said.get("high", math.inf), f"high of {what}", finite=False)
    numbers = []
    for number, action in enumerate(task.actions):
        found = rule.number({"action": number, **action_values(action)})
        if not low <= found <= high:
            raise InputError(
                f"{what} is {found} for action {action.name}; allowed: {low} to {high}"
            )
        numbers.append(found)
    _try(path, kind, numbers[0], what)
    return path, tuple(numbers)


def _allowed(content: Any, task: TaskDescription) -> dict[int, Expression]:
    said = _mapping(content, "allowed")
    names = [action.name for action in task.actions]
    _check_keys(said, names, "allowed")
    found = {
        names.index(name): Expression(rule, task.names, f"allowed of action {name}")
        for name, rule in said.items()
    }
    if task.neutral in found:
        raise InputError(
            f"allowed speaks of {names[task.neutral]}, the neutral action; it is always allowed"
        )
    return found


# ---------------------------------------------------------------- beginning


def _reset(content: Any, task: TaskDescription) -> Reset:
    said = _mapping(content, "reset")
    known = ("service", "topic", "type", "fields", "constants", "button", "settle", "ready")
    _check_keys(said, known, "reset")
    ways = [way for way in ("service", "topic", "button") if way in said]
    if len(ways) > 1:
        raise InputError(f"reset has {' and '.join(ways)}; allowed: one of them, or none")
    settle = _number(said, "settle", "reset", 0.5, 0.0)
    ready = Expression(said["ready"], task.names, "ready in reset") if "ready" in said else None
    button = said.get("button", -1)
    if isinstance(button, bool) or not isinstance(button, int):
        raise InputError(f"button in reset is {button!r}; allowed: an integer")
    if "service" in said:
        kind = message_type(said.get("type", "std_srvs/srv/Empty"), "type in reset", "srv")
        return Reset(_name(said["service"], "service in reset"), said.get("type", ""), kind,
                     settle=settle, ready=ready)  # fmt: skip
    message = None
    if "topic" in said:
        entry = {key: said[key] for key in known[1:5] if key in said}
        message = _output(entry, task, "reset")
    return Reset(message=message, button=button, settle=settle, ready=ready)


# ---------------------------------------------------------------- values


def _mapping(content: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(content, Mapping):
        raise InputError(f"{what} is {content!r}; allowed: names and values")
    if len(content) > MOST * 10:
        raise InputError(f"{what} has {len(content)} entries; allowed: at most {MOST * 10}")
    return content


def _check_keys(said: Any, known: Any, what: str, *, all_of_them: bool = False) -> None:
    unknown = [str(key) for key in said if key not in known]
    if unknown:
        raise InputError(f"{what} has {unknown[0]!r}; allowed: {', '.join(known)}")
    lacking = [key for key in known if key not in said]
    if all_of_them and lacking:
        raise InputError(f"{what} has no {lacking[0]}; allowed: each of {', '.join(known)}")


def _topic(said: Mapping[str, Any], what: str) -> str:
    return _name(said.get("topic"), f"topic in {what}")


def _name(value: Any, what: str) -> str:
    parts = value.strip("/~").split("/") if isinstance(value, str) else [""]
    if not all(part.replace("_", "a").isalnum() and part.isascii() for part in parts):
        raise InputError(f"{what} is {value!r}; allowed: a name such as /odom")
    return str(value)


def _qos(said: Mapping[str, Any], what: str, usual: str) -> str:
    value = said.get("qos", usual)
    if value not in RELIABILITY:
        raise InputError(f"qos in {what} is {value!r}; allowed: {', '.join(RELIABILITY)}")
    return str(value)


def _constant(value: Any, what: str, *, finite: bool = True) -> float:
    """A number, or an expression of none but numbers."""
    rule = Expression(value, (), what)
    return rule.number({}) if finite else float(rule({}))


def _number(
    said: Mapping[str, Any], key: str, what: str, usual: float, low: float, high: float = 1e6
) -> float:
    value = _constant(said.get(key, usual), f"{key} in {what}")
    check_range(f"{key} in {what}", value, low, high)
    return value
